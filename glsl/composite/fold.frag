#version 460
// The layers of `groups` into one (Zhang and Pajarola 2006, figure 5): the least z + ε, then the sums of what lies before
// it. Light and division follow with every other blend's.
#include "layer_front.glsl"
#include "blend/hidden.glsl"

layout(constant_id = 0) const bool SURFACE = false;     // normals or the front's depth are wanted
layout(constant_id = 1) const bool NORMALS = false;     // there are normals
layout(constant_id = 2) const bool HOST_DEPTH = false;

layout(set = 1, binding = 0) uniform sampler2DArray layer_color;    // w c, w
layout(set = 1, binding = 2) uniform sampler2DArray layer_normal;   // w n

layout(location = 0) out vec4 out_color;    // Σ w c, Σ w
layout(location = 1) out vec4 out_surface;  // Σ w n, −z of the front

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    float limit = nearest_limit(at);
    if (limit == NOTHING) {
        discard;
    }
    float host;
    if (HOST_DEPTH && host_front(at, host)) {
        limit = min(limit, host);
    }
    vec4 color = vec4(0.0);
    vec3 normal = vec3(0.0);
    float front = NOTHING;
    bool hidden = false;
    for (int k = 0; k < push.layers; k++) {
        ivec3 place = ivec3(at, k);
        float z = texelFetch(layer_front, place, 0).y;
        if (z <= limit) {
            color += texelFetch(layer_color, place, 0);
            if (NORMALS) {
                normal += texelFetch(layer_normal, place, 0).xyz;
            }
            front = min(front, z);
        } else {
            hidden = hidden || z < NOTHING;
        }
    }
    color.a = with_hidden(color.a, hidden);
    out_color = color;
    if (SURFACE) {
        out_surface = vec4(normal, -front);
    }
}
