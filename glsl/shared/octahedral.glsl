// Twin: src/structure/octahedral.rs.
const uint NO_NORMAL = 0x80008000u;

// From eight bits each: whole numbers, 127 becomes 32767.
uint widened(uint code) {
    ivec2 v = ivec2(int(code << 24) >> 24, int(code << 16) >> 24);
    ivec2 w = sign(v) * (abs(v) * 258 + (abs(v) >> 6));
    return code == 0x8080u ? NO_NORMAL : (uint(w.x) & 0xffffu) | uint(w.y) << 16;
}

vec3 octahedral(uint code) {
    vec2 e = max(vec2(int(code << 16) >> 16, int(code) >> 16) / 32767.0, vec2(-1.0));
    float z = 1.0 - abs(e.x) - abs(e.y);
    float fold = max(-z, 0.0);
    vec2 s = vec2(e.x >= 0.0 ? 1.0 : -1.0, e.y >= 0.0 ? 1.0 : -1.0);
    return normalize(vec3(e - fold * s, z));
}
