#version 460
// Four vertices a point, pulled from storage; six indices to draw them.
#include "raw.glsl"
layout(set = 0, binding = 0, std430) readonly buffer Positions { vec4 positions[]; };

void main() {
    vec4 center = transformed(positions[gl_VertexIndex >> 2].xyz);
    vec2 side = mix(vec2(-1.0), vec2(1.0), bvec2((gl_VertexIndex & 1) != 0, (gl_VertexIndex & 2) != 0));
    gl_Position = vec4(center.xy + side * push.half_size, center.zw);
}
