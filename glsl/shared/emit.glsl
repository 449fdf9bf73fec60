// The vertex stage's last step, the same for sprites and quads.
#define VARYING out
#include "varyings.glsl"
#include "srgb.glsl"

const vec4 NOWHERE = vec4(2.0, 2.0, 2.0, 1.0);

bool is_cast(Splat s) {
    return LARGE == LARGE_ONLY || (LARGE == LARGE_TOO && s.status == TOO_LARGE);
}

bool is_drawn(Splat s) {
    return LARGE == LARGE_TOO ? s.status <= TOO_LARGE : s.status == (LARGE == LARGE_ONLY ? TOO_LARGE : DRAWN);
}

void emit_attributes(Splat s, uint color) {
    v_frame = is_cast(s) ? vec4(s.centre, s.radius) : s.inverse;
    v_centre = vec4(s.whole, s.depth, is_cast(s) ? -s.radius : s.radius);
    v_plane = vec4(s.slope, s.rest);
    v_color = vec4(HAS_COLOR ? linear_from_srgb(unpackUnorm4x8(color).rgb) : params.base_color.rgb, s.epsilon);
    v_normal = s.normal;
}

vec4 clip_position(vec2 pixel, float z) {
    return vec4(pixel / params.middle, clamp(internal_depth(max(z, params.near)), 0.0, 1.0), 1.0);
}
