#version 460
// A point pulled from storage.
#include "raw.glsl"
layout(set = 0, binding = 0, std430) readonly buffer Positions { vec4 positions[]; };

void main() {
    gl_Position = transformed(positions[gl_VertexIndex].xyz);
    gl_PointSize = push.size;
}
