#version 460
// Colour alone: weighted sums of what passes the depth test (two-pass), or the nearest fragment's values (opaque).
#include "accumulate.glsl"

layout(location = 0) out vec4 out_color;    // Σ w c, Σ w

void main() {
    vec4 surface;
    if (!accumulate(out_color, surface)) {
        discard;
    }
}
