#version 460
// Reads one word an invocation, wherever the push constant says. `readonly`: else synchronization validation is blind.
layout(local_size_x = 1) in;
layout(set = 0, binding = 0, std430) writeonly buffer CanaryOut { uint canary_out[]; };
layout(set = 0, binding = 1, std430) readonly buffer CanaryIn { uint canary_in[]; };
layout(push_constant) uniform CanaryPush { uint at; } push;

void main() {
    canary_out[gl_GlobalInvocationID.x] = canary_in[gl_GlobalInvocationID.x + push.at];
}
