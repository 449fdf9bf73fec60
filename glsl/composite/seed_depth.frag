#version 460
// The host's depth as internal depth: a front with ε = 0 that nothing behind it passes.
#include "host_depth.glsl"

void main() {
    float z;
    bool there = host_front(ivec2(floor(gl_FragCoord.xy)), z);
    ViewParams p = frame.views[push.view];
    float d = (p.depth_map.x * z + p.depth_map.y) / (p.depth_map.z * z + p.depth_map.w);
    gl_FragDepth = there ? clamp(d, 0.0, 1.0) : 0.0;
}
