#version 460
// Weighted sums of what passes the depth test (two-pass, second pass), or the nearest fragment's values (opaque).
#include "footprint.glsl"
#include "blend/weight.glsl"

layout(location = 0) out vec4 out_color;    // Σ w c, Σ w
layout(location = 1) out vec4 out_normal;   // Σ w n
layout(location = 2) out vec4 out_front;    // −min z

void main() {
    float z;
    float u2 = footprint(gl_FragCoord.xy, z);
    if (u2 > 1.0) {
        discard;
    }
    float w = weight(u2);
    out_color = vec4(v_color, 1.0) * w;
    out_normal = vec4(v_normal, 0.0) * w;
    out_front = vec4(-z, 0.0, 0.0, 0.0);
    gl_FragDepth = internal_depth(z);
}
