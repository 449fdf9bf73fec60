#version 460
// First of two passes: the least z + ε of every pixel, as internal depth.
#include "footprint.glsl"

void main() {
    float z;
    if (footprint(gl_FragCoord.xy - params.middle, z) > 1.0) {
        discard;
    }
    gl_FragDepth = internal_depth(z + fragment_epsilon());
}
