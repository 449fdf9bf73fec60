#version 460
// A point from its number alone: no memory is read. src/standalone/raw/scene.rs places the others so too.
#include "raw.glsl"

void main() {
    uint h = hash(uint(gl_VertexIndex));
    uvec2 corner = uvec2(h & 0xffffu, h >> 16u) % push.places;
    uint depth = (hash(h) & 1u) != 0u ? 49152u : 16384u;
    gl_Position = transformed(vec3(corner, depth) / 65535.0);
    gl_PointSize = push.size;
}
