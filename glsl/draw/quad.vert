#version 460
// A quad into the only layer.
#include "quad.glsl"

void main() {
    quad();
}
