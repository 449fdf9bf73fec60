// What the vertex shaders of `surfel bench raw` share: a transform, nothing else.
layout(push_constant) uniform RawPush {
    mat4 clip_from_cloud;
    vec2 half_size;     // of a square, in clip coordinates
    uvec2 places;       // corners of squares lie in 0 .. places - 1 [px]
    float size;         // [px]
} push;

// Two passes compare their depths.
invariant gl_Position;

vec4 transformed(vec3 p) {
    return push.clip_from_cloud * vec4(p, 1.0);
}

// PCG (Jarzynski and Olano, Hash Functions for GPU Rendering, 2020).
uint hash(uint v) {
    uint state = v * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}
