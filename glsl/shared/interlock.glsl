// The state of `fuzzy` in storage images. BEGIN and END are the critical section, or nothing where a device runs the
// fragments of a pixel in order anyway.
#include "fuzzy.glsl"

layout(set = 4, binding = 0, rgba32f) uniform image2D color_image;  // Σ w c, Σ w
layout(set = 4, binding = 1, rg32f) uniform image2D front_image;    // limit, zd
layout(set = 4, binding = 2, rgba32f) uniform image2D normal_image; // Σ w n; unused where there is no light

layout(constant_id = 10) const bool LIT = false;

void main() {
    float z;
    vec4 color;
    vec3 normal;
    bool covered = fragment(z, color, normal);
    ivec2 at = ivec2(gl_FragCoord.xy);
    BEGIN;
    if (covered) {
        State s = State(imageLoad(color_image, at), vec3(0.0), imageLoad(front_image, at).xy);
        if (LIT) {
            s.normal = imageLoad(normal_image, at).xyz;
        }
        if (fuzzy(s, z, fragment_epsilon(), color, normal)) {
            imageStore(color_image, at, s.color);
            imageStore(front_image, at, vec4(s.front, 0.0, 0.0));
            if (LIT) {
                imageStore(normal_image, at, vec4(s.normal, 0.0));
            }
        }
    }
    END;
}
