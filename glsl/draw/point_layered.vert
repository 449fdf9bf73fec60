#version 460
#extension GL_ARB_shader_viewport_layer_array : require
// A point primitive into the layer of its group.
#include "point.glsl"

layout(location = 3) in uint in_group;

void main() {
    point();
    gl_Layer = int(in_group);
}
