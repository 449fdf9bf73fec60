#version 460
#extension GL_EXT_multiview : require
// The last step, inside the host's pass: divide, shade, darken, encode; colour premultiplied, depth of the front.
#include "frame.glsl"
#include "shade.glsl"
#include "srgb.glsl"
#include "blend/hidden.glsl"

const int HIDDEN_STENCIL = 0;
const int HIDDEN_SIGN = 1;      // in the sign of Σ w
const int HIDDEN_SOLID = 2;     // opaque: coverage is all or nothing

// Set in src/composite/resolve.rs.
layout(constant_id = 0) const int SHADE = SHADE_NONE;
layout(constant_id = 1) const bool EYE_DOME = false;
layout(constant_id = 2) const bool WRITE_DEPTH = true;
layout(constant_id = 3) const bool ENCODE_SRGB = false;  // the target's format does not encode by itself
layout(constant_id = 4) const int HIDDEN = HIDDEN_STENCIL;   // where it stands that the front hides something of ours
layout(constant_id = 5) const bool FRONT = false;        // the front's depth is in `front`, not in `surface`

layout(set = 0, binding = 1) uniform sampler2DArray color_sum;
layout(set = 0, binding = 2) uniform sampler2DArray surface;    // Σ w n, −z of the front

layout(set = 0, binding = 4) uniform usampler2DArray hidden;    // not 0: the front hides something of ours
layout(set = 0, binding = 5) uniform sampler2DArray front;      // limit, z of the front

layout(location = 0) out vec4 out_color;

float front_depth(ivec2 at, int view) {
    return FRONT ? texelFetch(front, ivec3(at, view), 0).y : -texelFetch(surface, ivec3(at, view), 0).w;
}

// Eye-dome lighting (Boucheny 2009): mean over eight neighbours of how many octaves of depth this pixel lies behind them.
float shadow(ivec2 at, int view, float z) {
    float sum = 0.0;
    for (int i = 0; i < 8; i++) {
        float angle = 0.78539816339 * float(i);
        ivec2 other = ivec2(floor(vec2(at) + 0.5 + frame.edl_radius * vec2(cos(angle), sin(angle))));
        if (any(lessThan(other, ivec2(0))) || any(greaterThanEqual(other, frame.extent))) {
            continue;
        }
        if (abs(texelFetch(color_sum, ivec3(other, view), 0).a) > 0.0) {
            sum += max(0.0, log2(max(z, 1e-30)) - log2(max(front_depth(other, view), 1e-30)));
        }
    }
    return exp(-100.0 * frame.edl_strength * sum / 8.0);
}

void main() {
    int view = gl_ViewIndex;
    vec2 pixel = gl_FragCoord.xy - frame.offset;
    ivec2 at = ivec2(floor(pixel));
    vec4 sum = texelFetch(color_sum, ivec3(at, view), 0);
    bool marked = HIDDEN == HIDDEN_SIGN && is_hidden(sum.a);
    sum.a = abs(sum.a);
    if (!(sum.a > 0.0)) {
        discard;
    }
    ViewParams p = frame.views[view];
    vec3 c = sum.rgb / sum.a;
    if (SHADE != SHADE_NONE) {
        vec3 ray = p.ray_0.xyz + p.ray_x.xyz * pixel.x + p.ray_y.xyz * pixel.y;
        vec3 v = p.depth_map.z != 0.0 ? -normalize(ray) : normalize(p.eye.xyz);
        vec3 n = texelFetch(surface, ivec3(at, view), 0).xyz / sum.a;
        float agreement = length(n);
        c = shade(SHADE, c, agreement > 0.0 ? n / agreement : v, agreement, v);
    }
    float z = 0.0;
    if (EYE_DOME || WRITE_DEPTH) {
        z = front_depth(at, view);
    }
    if (EYE_DOME) {
        c *= shadow(at, view, z);
    }
    if (ENCODE_SRGB) {
        c = srgb_from_linear(c);
    }
    // Where the front hides another fragment, what its soft rim would let through is not the background.
    bool solid = HIDDEN == HIDDEN_SOLID || marked;
    if (HIDDEN == HIDDEN_STENCIL) {
        solid = texelFetch(hidden, ivec3(at, view), 0).x != 0u;
    }
    float alpha = solid ? 1.0 : min(1.0, 2.0 * sum.a);
    out_color = vec4(c * alpha, alpha);
    float depth = WRITE_DEPTH
        ? p.host_depth.x + (p.depth_map.z != 0.0 ? p.host_depth.y / z : p.host_depth.y * z)
        : gl_FragCoord.z;
    // Beyond a finite far plane the host draws nothing.
    if (depth < 0.0 || depth > 1.0) {
        discard;
    }
    gl_FragDepth = depth;
}
