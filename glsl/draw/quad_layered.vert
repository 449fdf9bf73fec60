#version 460
#extension GL_ARB_shader_viewport_layer_array : require
// A quad into the layer of its splat's group.
#include "quad.glsl"

layout(set = 1, binding = 3, std430) readonly buffer Groups { uint groups[]; };     // a byte a splat

void main() {
    quad();
    uint i = splat_index();
    gl_Layer = int(groups[i >> 2] >> (8u * (i & 3u)) & 0xffu);
}
