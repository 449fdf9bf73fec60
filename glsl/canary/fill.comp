#version 460
// Writes one word an invocation, wherever the push constant says: also past the end, which is the canary's purpose.
layout(local_size_x = 1) in;
layout(set = 0, binding = 0, std430) writeonly buffer CanaryOut { uint canary_out[]; };
layout(push_constant) uniform CanaryPush { uint at; } push;

void main() {
    canary_out[gl_GlobalInvocationID.x + push.at] = push.at;
}
