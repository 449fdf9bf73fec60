#version 460
// One group a range: from the number of marks of each tile to where the tile writes, and the commands that draw them all.
#include "params.glsl"
#include "list.glsl"

layout(local_size_x = 256) in;

layout(set = 2, binding = 2, std430) readonly buffer Ranges { Range ranges[]; };
layout(set = 2, binding = 4, std430) buffer Places { uint places[]; };
layout(set = 2, binding = 6, std430) writeonly buffer Commands { Command commands[]; };

const uint SUMS = 256u;

shared uint sums[SUMS];

void main() {
    uint lane = gl_LocalInvocationIndex;
    uint number = run.first + gl_WorkGroupID.x;
    Range range = ranges[number];
    uint before = 0u;
    for (uint start = 0u; start < range.tiles; start += SUMS) {
        uint i = start + lane;
        uint own = i < range.tiles ? places[range.first + i] : 0u;
        sums[lane] = own;
        barrier();
        // Hillis and Steele 1986.
        for (uint step = 1u; step < SUMS; step <<= 1) {
            uint left = lane >= step ? sums[lane - step] : 0u;
            barrier();
            sums[lane] += left;
            barrier();
        }
        if (i < range.tiles) {
            places[range.first + i] = range.base + before + sums[lane] - own;
        }
        before += sums[SUMS - 1u];
        barrier();
    }
    if (lane == 0u) {
        commands[number] = Command(before, 1u, range.base, 0u, 0u, 6u * before, 1u, 6u * range.base, 0u);
    }
}
