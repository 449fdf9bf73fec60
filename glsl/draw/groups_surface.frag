#version 460
// The same, with what light needs.
#include "groups.glsl"

layout(location = 2) out vec4 out_normal;   // w n

void main() {
    float w = layered();
    out_normal = vec4(fragment_normal() * w, 0.0);
}
