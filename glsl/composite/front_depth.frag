#version 460
// What `fuzzy` has drawn as internal depth: the limit beyond which it blends nothing more.
#include "frame.glsl"

layout(set = 0, binding = 5) uniform sampler2DArray front;
layout(push_constant) uniform PassPush {
    int view;
    int layers;     // of groups
} push;

void main() {
    float limit = texelFetch(front, ivec3(ivec2(gl_FragCoord.xy), push.view), 0).x;
    gl_FragDepth = internal_depth(frame.views[push.view], limit);
}
