#version 460
// Marks which points of each tile are in the cut, and counts them.
#include "params.glsl"
#include "packing.glsl"
#include "interval.glsl"
#include "list.glsl"

layout(local_size_x = 64) in;

layout(set = 2, binding = 3, std430) writeonly buffer Marks { uint marks[]; };
layout(set = 2, binding = 4, std430) writeonly buffer Places { uint places[]; };

shared uint words[WORDS];
shared uint total;

void main() {
    uint lane = gl_LocalInvocationIndex;
    uint number = run.first + gl_WorkGroupID.x;
    uvec2 tile = tiles[number];
    if (lane < WORDS) {
        words[lane] = 0u;
    }
    if (lane == 0u) {
        total = 0u;
    }
    barrier();
    for (uint at = lane; at < tile.y; at += LANES) {
        uint i = tile.x + at;
        if (in_interval(i, pulled_place(i))) {
            atomicOr(words[at >> 5], 1u << (at & 31u));
        }
    }
    barrier();
    if (lane < WORDS) {
        marks[number * WORDS + lane] = words[lane];
        atomicAdd(total, bitCount(words[lane]));
    }
    barrier();
    if (lane == 0u) {
        places[number] = total;
    }
}
