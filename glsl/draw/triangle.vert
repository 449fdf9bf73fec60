#version 460
// A face's corner into the only layer.
#include "triangle.glsl"

void main() {
    triangle();
}
