#version 460
// The same, with what light needs.
#include "fuzzy.glsl"

layout(input_attachment_index = 0, set = 3, binding = 0) uniform subpassInput in_color;
layout(input_attachment_index = 1, set = 3, binding = 1) uniform subpassInput in_front;
layout(input_attachment_index = 2, set = 3, binding = 2) uniform subpassInput in_normal;

layout(location = 0) out vec4 out_color;    // Σ w c, Σ w
layout(location = 1) out vec4 out_front;    // limit, zd
layout(location = 2) out vec4 out_normal;   // Σ w n

void main() {
    float z;
    vec4 color;
    vec3 normal;
    if (!fragment(z, color, normal)) {
        discard;
    }
    State s = State(subpassLoad(in_color), subpassLoad(in_normal).xyz, subpassLoad(in_front).xy);
    if (!fuzzy(s, z, fragment_epsilon(), color, normal)) {
        discard;
    }
    out_color = s.color;
    out_front = vec4(s.front, 0.0, 0.0);
    out_normal = vec4(s.normal, 0.0);
}
