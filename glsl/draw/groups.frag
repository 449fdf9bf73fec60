#version 460
// Colour and depth of the fragment that wins in its layer.
#include "groups.glsl"

void main() {
    layered();
}
