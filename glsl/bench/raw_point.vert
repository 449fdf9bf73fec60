#version 460
// A point from a vertex stream.
#include "raw.glsl"
layout(location = 0) in vec3 in_position;

void main() {
    gl_Position = transformed(in_position);
    gl_PointSize = push.size;
}
