#version 460
// How many splats are drawn, and how many are not, by what: only where statistics are asked for.
#include "splat.glsl"

layout(local_size_x = 64) in;

layout(set = 2, binding = 0, std430) buffer Counts {
    uint drawn;
    uint too_large;     // drawn too, by the other pipeline
    uint outside;
    uint back_face;
    uint invalid;
    uint not_in_cut;
} counts;

shared uint local[6];

void main() {
    uint lane = gl_LocalInvocationIndex;
    if (lane < 6u) {
        local[lane] = 0u;
    }
    barrier();
    // A grid-stride loop: 65,535 groups at most, whatever the cloud.
    uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint at = gl_GlobalInvocationID.x; at < run.count; at += stride) {
        uint i = run.first + at;
        Splat s = project(i, pulled(i));
        atomicAdd(local[s.status], 1u);
    }
    barrier();
    if (lane == 0u) {
        atomicAdd(counts.drawn, local[DRAWN]);
        atomicAdd(counts.too_large, local[TOO_LARGE]);
        atomicAdd(counts.outside, local[OUTSIDE]);
        atomicAdd(counts.back_face, local[BACK_FACE]);
        atomicAdd(counts.invalid, local[INVALID]);
        atomicAdd(counts.not_in_cut, local[NOT_IN_CUT]);
    }
}
