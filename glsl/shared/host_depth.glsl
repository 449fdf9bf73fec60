// The host's depth.
#include "frame.glsl"

layout(set = 0, binding = 3) uniform sampler2DArray host_depth;
layout(push_constant) uniform PassPush {
    int view;
    int layers;     // of groups
} push;

// Linear depth of the host's geometry at a pixel of the picture; false where nothing is.
bool host_front(ivec2 pixel, out float z) {
    ivec2 at = pixel + ivec2(floor(frame.offset));
    float depth = texelFetch(host_depth, ivec3(at, push.view), 0).x;
    ViewParams p = frame.views[push.view];
    // The difference is exact where standard depth is crowded; where the host's far plane is infinite, nothing is there.
    bool perspective = p.depth_map.z != 0.0;
    float beyond = depth - p.host_depth.x;
    z = perspective ? p.host_depth.y / beyond : beyond / p.host_depth.y;
    return !(perspective && (beyond == 0.0 || z <= 0.0));
}
