#version 460
// Anything, so that there is a pipeline to misuse.
layout(location = 0) out vec4 out_color;

void main() {
    out_color = vec4(1.0);
}
