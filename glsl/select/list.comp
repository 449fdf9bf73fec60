#version 460
// Every tile writes the numbers of its marked points, in order, from its own place on.
#include "params.glsl"
#include "list.glsl"

layout(local_size_x = 64) in;

layout(set = 2, binding = 3, std430) readonly buffer Marks { uint marks[]; };
layout(set = 2, binding = 4, std430) readonly buffer Places { uint places[]; };
layout(set = 2, binding = 5, std430) writeonly buffer List { uint list[]; };

shared uint words[WORDS];
shared uint before[WORDS];

void main() {
    uint lane = gl_LocalInvocationIndex;
    uint number = run.first + gl_WorkGroupID.x;
    uvec2 tile = tiles[number];
    if (lane < WORDS) {
        words[lane] = marks[number * WORDS + lane];
    }
    barrier();
    if (lane < WORDS) {
        uint sum = places[number];
        for (uint word = 0u; word < lane; word++) {
            sum += bitCount(words[word]);
        }
        before[lane] = sum;
    }
    barrier();
    for (uint at = lane; at < tile.y; at += LANES) {
        uint word = words[at >> 5];
        uint bit = at & 31u;
        if ((word >> bit & 1u) != 0u) {
            list[before[at >> 5] + bitCount(word & ((1u << bit) - 1u))] = tile.x + at;
        }
    }
}
