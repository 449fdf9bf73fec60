// A stored point, however many bytes it has. Twin, bit for bit: src/structure/packing. Integers, exact products (steps have three
// significant bits, counts of them ten) and one rounded sum.
//
// stream     full                   exact                          quantised                 ... with normals and colours
// geometry   vec4: place, radius    vec3: place                    3 × 10 bits: place        and 2 high bits of the colour
// normals    2 × 16 bits            2 × 8 bits                     -                         8 bits: radius
// colors     rgb                    rgb, radius                    rgb or normal, radius     normal, 16 bits of the colour
#include "octahedral.glsl"

layout(set = 1, binding = 0, std430) readonly buffer Geometry { vec4 geometry[]; };
layout(set = 1, binding = 0, std430) readonly buffer GeometryWords { uint geometry_words[]; };
layout(set = 1, binding = 1, std430) readonly buffer Normals { uint normals[]; };
layout(set = 1, binding = 2, std430) readonly buffer Colors { uint colors[]; };
layout(set = 1, binding = 6, std430) readonly buffer Frames { uvec4 frames[]; };    // corner, steps: a run of 256 points

struct Point {
    vec4 geometry;  // place and radius
    uint normal;    // octahedral code
    uint color;     // sRGB bytes
};

bool is_quantised() { return PACKING >= PACKING_QUANTISED; }

// Three fields of ten bits.
uvec3 tens(uint word) { return uvec3(word, word >> 10, word >> 20) & 1023u; }

float radius_of(uint code) {
    return code == 0u ? 0.0 : uintBitsToFloat(params.radius_most - (255u - code) * params.radius_step);
}

vec3 place_in(uint i, uvec3 at) {
    uvec4 frame = frames[i >> 8];
    precise vec3 place = uintBitsToFloat(frame.xyz) + vec3(at) * uintBitsToFloat(tens(frame.w) << 21);
    return place;
}

// The rest of a packed point: `aside` is what its normals stream holds, `above` the two bits over a quantised place.
Point unpack(vec3 place, uint above, uint aside, uint word) {
    if (PACKING == PACKING_EXACT) {
        return Point(vec4(place, radius_of(word >> 24)), HAS_NORMAL ? widened(aside) : NO_NORMAL, word);
    }
    if (PACKING == PACKING_QUANTISED) {
        return Point(vec4(place, radius_of(word >> 24)), HAS_NORMAL ? widened(word & 0xffffu) : NO_NORMAL, word);
    }
    uint packed = word >> 16 | above << 16;
    uvec3 six = uvec3(packed, packed >> 6, packed >> 12) & 63u;
    uvec3 color = six << 2 | six >> 4;
    return Point(vec4(place, radius_of(aside)), widened(word & 0xffffu), color.x | color.y << 8 | color.z << 16);
}

vec3 exact_place(uint i) {
    return uintBitsToFloat(uvec3(geometry_words[3u * i], geometry_words[3u * i + 1u], geometry_words[3u * i + 2u]));
}

// Where point i of the chunk lies.
vec3 pulled_place(uint i) {
    if (PACKING == PACKING_FULL) {
        return geometry[i].xyz;
    }
    return is_quantised() ? place_in(i, tens(geometry_words[i])) : exact_place(i);
}

// Point i of the chunk, from storage.
Point pulled(uint i) {
    if (PACKING == PACKING_FULL) {
        return Point(geometry[i], HAS_NORMAL ? normals[i] : NO_NORMAL, HAS_COLOR ? colors[i] : 0u);
    }
    if (is_quantised()) {
        uint word = geometry_words[i];
        uint radius = PACKING == PACKING_ASIDE ? normals[i >> 2] >> 8u * (i & 3u) & 0xffu : 0u;
        return unpack(place_in(i, tens(word)), word >> 30, radius, colors[i]);
    }
    return unpack(exact_place(i), 0u, HAS_NORMAL ? normals[i >> 1] >> 16u * (i & 1u) & 0xffffu : 0u, colors[i]);
}

// The same from vertex attributes. Quantised places come as fractions of 1023 and 3.
Point streamed(uint i, vec4 place, uint aside, uint word) {
    if (PACKING == PACKING_FULL) {
        return Point(place, aside, word);
    }
    if (is_quantised()) {
        uvec4 fields = uvec4(place * vec4(1023.0, 1023.0, 1023.0, 3.0) + 0.5);
        return unpack(place_in(i, fields.xyz), fields.w, aside, word);
    }
    return unpack(place.xyz, 0u, aside, word);
}
