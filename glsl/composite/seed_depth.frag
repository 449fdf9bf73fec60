#version 460
// The host's depth as internal depth: a front with ε = 0 that nothing behind it passes.
#include "host_depth.glsl"

void main() {
    float z;
    bool there = host_front(ivec2(floor(gl_FragCoord.xy)), z);
    gl_FragDepth = there ? internal_depth(frame.views[push.view], z) : 0.0;
}
