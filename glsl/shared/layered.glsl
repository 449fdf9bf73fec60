// What a cut says of each sample of a layered point cloud: whether it is there, and how large (Gobbetti, Marton: Layered Point
// Clouds, 2004, section 4). Twins, bit for bit: Cut::deepest and rank in src/select/layered; src/draw/cuts.rs writes the table.
// Comparisons and integers alone.
const uint NO_STEP = 0xffffffffu;
const uint LEAF = 3u;       // the axis of what has no plane

// By slot of a chunk: the number of its step.
layout(set = 2, binding = 7, std430) readonly buffer Slots { uint slots[]; };
// Two a step: plane, its axis, the steps on either side; radius, limit of ranks, what ranks differ by, whether that radius counts.
layout(set = 2, binding = 7, std430) readonly buffer Steps { uvec4 steps[]; };

// Whether sample i of the chunk is shown; its radius becomes at least that of the deepest step that has its place.
bool in_layers(uint i, inout vec4 geometry) {
    uint at = slots[run.table + (i >> params.slot_shift)];
    uvec4 own = steps[at + 1u];
    if ((bitfieldReverse(i & ((1u << params.slot_shift) - 1u)) ^ own.z) > own.y) {
        return false;
    }
    uvec4 cut = steps[at];
    while (cut.y != LEAF) {
        uint child = geometry[cut.y] < uintBitsToFloat(cut.x) ? cut.z : cut.w;
        if (child == NO_STEP) {
            break;
        }
        at = child;
        cut = steps[at];
    }
    uvec4 deepest = steps[at + 1u];
    // Of a leaf that is there in full, samples have their own; before, those that lie alone are no smaller than they will be.
    if (deepest.w != 0u) {
        geometry.w = max(geometry.w, uintBitsToFloat(deepest.x));
    }
    return true;
}
