#version 460
// One triangle over the picture (vertices 0 to 2), or two that stay inside it (3 to 8): see `resolve` in
// src/composite/resolve.rs.
const vec2 CORNER[9] = vec2[](
    vec2(-1, -1), vec2(3, -1), vec2(-1, 3),
    vec2(-1, -1), vec2(1, -1), vec2(-1, 1), vec2(-1, 1), vec2(1, -1), vec2(1, 1));

void main() {
    gl_Position = vec4(CORNER[gl_VertexIndex], 0.0, 1.0);
}
