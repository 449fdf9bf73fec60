// A triangle's fragment: a splat's with w = 1, u = 0 and exact depth (MODEL, "Splat"). It is there where the face's size is
// larger than the threshold, decided by each fragment for itself: where a triangle reaches across that border, a part of it
// is drawn, and points beyond (Dachsbacher, Vogelgsang, Stamminger: Sequential Point Trees, 2003, section 3.8).
#define VARYING in
#include "face_varyings.glsl"
#include "tolerance.glsl"

vec3 fragment_color() { return v_color; }
float fragment_radius() { return 0.0; }

vec3 ray_direction() { return normalize(PERSPECTIVE ? v_eye - params.eye.xyz : -params.eye.xyz); }

// Interpolated, and turned to the viewer as a splat's is.
vec3 fragment_normal() {
    float size = length(v_normal);
    vec3 n = size > 1e-6 ? v_normal / size : v_face.xyz;
    return dot(n, ray_direction()) > 0.0 ? -n : n;
}

// The points beside it are off its plane by at most the threshold: that is its radius here.
float fragment_epsilon() {
    vec3 v = ray_direction();
    vec2 pixel = gl_FragCoord.xy - params.middle;
    float w = dot(params.pixel_w, vec4(v_eye, 1.0));
    vec3 area = cross(params.pixel_x.xyz - pixel.x * params.pixel_w.xyz, params.pixel_y.xyz - pixel.y * params.pixel_w.xyz);
    float radius = params.tau * length(v_place) * params.radius_scale;
    return tolerance(radius, w * inversesqrt(abs(dot(area, v))), min(dot(fragment_normal(), v), -1e-6));
}

float footprint(vec2 fragment, out float z) {
    z = -v_eye.z;
    return v_face.w * v_face.w > params.tau * params.tau * dot(v_place, v_place) ? 0.0 : MISS;
}
