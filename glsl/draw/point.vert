#version 460
// A point primitive into the only layer.
#include "point.glsl"

void main() {
    point();
}
