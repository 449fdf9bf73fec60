#version 460
// The same, with what light and depth need.
#include "accumulate.glsl"

layout(location = 0) out vec4 out_color;    // Σ w c, Σ w
layout(location = 1) out vec4 out_surface;  // Σ w n, max −z

void main() {
    if (!accumulate(out_color, out_surface)) {
        discard;
    }
}
