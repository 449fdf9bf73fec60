#version 460
// The host's depth as internal depth: a front with ε = 0 that nothing behind it passes.
#include "frame.glsl"

layout(set = 0, binding = 3) uniform sampler2DArray host_depth;
layout(push_constant) uniform SeedPush { int view; } push;

void main() {
    ivec2 at = ivec2(floor(gl_FragCoord.xy + frame.offset));
    float depth = texelFetch(host_depth, ivec3(at, push.view), 0).x;
    ViewParams p = frame.views[push.view];
    // The difference is exact where standard depth is crowded; where the host's far plane is infinite, nothing is there.
    bool perspective = p.depth_map.z != 0.0;
    float beyond = depth - p.host_depth.x;
    float z = perspective ? p.host_depth.y / beyond : beyond / p.host_depth.y;
    bool infinite = perspective && (beyond == 0.0 || z <= 0.0);
    float d = (p.depth_map.x * z + p.depth_map.y) / (p.depth_map.z * z + p.depth_map.w);
    gl_FragDepth = infinite ? 0.0 : clamp(d, 0.0, 1.0);
}
