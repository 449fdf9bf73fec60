// The fronts of the layers of `groups`.
#include "host_depth.glsl"

layout(set = 1, binding = 1) uniform sampler2DArray layer_front;    // z + ε, z

const float NOTHING = 3.402823466e38;

// The least z + ε of a pixel over all layers.
float nearest_limit(ivec2 at) {
    float limit = NOTHING;
    for (int k = 0; k < push.layers; k++) {
        limit = min(limit, texelFetch(layer_front, ivec3(at, k), 0).x);
    }
    return limit;
}
