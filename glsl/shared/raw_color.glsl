// One fragment, in each of ATTACHMENTS attachments: 1, or the smallest step of eight bits.
layout(constant_id = 0) const uint EIGHT_BITS = 0;

layout(location = 0) out vec4 color0;
#if ATTACHMENTS > 1
layout(location = 1) out vec4 color1;
#endif
#if ATTACHMENTS > 2
layout(location = 2) out vec4 color2;
#endif
#if ATTACHMENTS > 3
layout(location = 3) out vec4 color3;
#endif

void main() {
    vec4 one = vec4(EIGHT_BITS != 0u ? 1.0 / 255.0 : 1.0);
    color0 = one;
#if ATTACHMENTS > 1
    color1 = one;
#endif
#if ATTACHMENTS > 2
    color2 = one;
#endif
#if ATTACHMENTS > 3
    color3 = one;
#endif
}
