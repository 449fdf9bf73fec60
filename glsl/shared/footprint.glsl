// What a fragment sees: u² and depth, and what it carries. Of a disk this is the fragment's side of splat.glsl; compiled with
// TRIANGLE, of a triangle.
#include "params.glsl"

const float MISS = 1e30;

#ifdef TRIANGLE
#include "face.glsl"
#else
#define VARYING in
#include "varyings.glsl"

vec3 fragment_color() { return v_color.rgb; }       // linear light
vec3 fragment_normal() { return v_normal; }         // eye space, unit
float fragment_epsilon() { return v_color.w; }
float fragment_radius() { return abs(v_centre.w); }

// Returns u² (more than 1: nothing here) and the linear depth.
float footprint(vec2 fragment, out float z) {
    z = v_centre.z;
    vec2 d = fragment - v_centre.xy;
    if (PAIRS) {
        // The first difference was exact.
        d -= v_plane.zw;
    }
    if (FOOTPRINT == FOOTPRINT_PIXELS) {
        return max(abs(d.x), abs(d.y)) <= 0.5 * params.pixel_size ? 0.0 : MISS;
    }
    float on_disk = MISS;
    if (LARGE == LARGE_ONLY || (LARGE == LARGE_TOO && v_centre.w < 0.0)) {
        vec3 base, direction;
        pixel_ray(fragment, base, direction);
        vec3 c = v_frame.xyz;
        vec3 n = v_normal;
        float facing = dot(n, direction);
        float hit = dot(n, c - base) / facing;
        if (facing != 0.0 && (hit > 0.0 || !PERSPECTIVE)) {
            vec3 x = base + hit * direction - c;
            on_disk = dot(x, x) / (v_frame.w * v_frame.w);
            z = hit;
        }
    } else {
        vec2 affine = vec2(dot(v_frame.xy, d), dot(v_frame.zw, d));
        bool exact = !APPROXIMATE && PERSPECTIVE;
        float s = exact ? v_centre.z - dot(affine, v_plane.xy) : 1.0;
        if (s > 0.0) {
            vec2 ab = affine * (exact ? v_centre.z / s : 1.0);
            on_disk = dot(ab, ab);
            z = v_centre.z + dot(ab, v_plane.xy);
        }
    }
    z = clamp(z, v_centre.z - abs(v_centre.w), v_centre.z + abs(v_centre.w));
    if (z < params.near) {
        return MISS;
    }
    float on_screen = dot(d, d) / (params.low_pass * params.low_pass);
    return min(on_disk, on_screen);
}
#endif
