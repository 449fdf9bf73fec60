#version 460
// What `groups` have drawn into their layers as internal depth: the limit beyond which the fold takes nothing more.
#include "layer_front.glsl"

layout(constant_id = 0) const bool HOST_DEPTH = false;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    float limit = nearest_limit(at);
    float host;
    if (HOST_DEPTH && host_front(at, host)) {
        limit = min(limit, host);
    }
    gl_FragDepth = internal_depth(frame.views[push.view], limit);
}
