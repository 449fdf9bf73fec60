#version 460
// The host's depth as the limit of `fuzzy`: nothing behind it is blended, and there is no front yet.
#include "host_depth.glsl"

layout(location = 1) out vec4 out_front;

const float NOTHING = 3.402823466e38;

void main() {
    float z;
    bool there = host_front(ivec2(floor(gl_FragCoord.xy)), z);
    out_front = vec4(there ? z : NOTHING, NOTHING, 0.0, 0.0);
}
