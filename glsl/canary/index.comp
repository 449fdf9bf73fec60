#version 460
// Picks a descriptor of an array of two, whichever the push constant says.
layout(local_size_x = 1) in;
layout(set = 0, binding = 0, std430) writeonly buffer CanaryOut { uint canary_out[]; };
layout(set = 0, binding = 1, std430) readonly buffer CanaryPick { uint canary_pick[]; } picks[2];
layout(push_constant) uniform CanaryPush { uint at; } push;

void main() {
    canary_out[gl_GlobalInvocationID.x] = picks[push.at].canary_pick[0];
}
