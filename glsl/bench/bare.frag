#version 460
// A constant, added.
layout(location = 0) out vec4 out_color;

void main() {
    out_color = vec4(0.25, 0.5, 0.75, 1.0);
}
