#version 460
#extension GL_ARB_shader_viewport_layer_array : require
// A face's corner into a layer of its own, behind those of the groups.
#include "triangle.glsl"

void main() {
    triangle();
    gl_Layer = int(run.count);
}
