// Twin: src/structure/octahedral.rs.
const uint NO_NORMAL = 0x80008000u;

vec3 octahedral(uint code) {
    vec2 e = max(vec2(int(code << 16) >> 16, int(code) >> 16) / 32767.0, vec2(-1.0));
    float z = 1.0 - abs(e.x) - abs(e.y);
    float fold = max(-z, 0.0);
    vec2 s = vec2(e.x >= 0.0 ? 1.0 : -1.0, e.y >= 0.0 ? 1.0 : -1.0);
    return normalize(vec3(e - fold * s, z));
}
