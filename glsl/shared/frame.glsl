// What the full-screen passes of one frame need. Twin: src/gpu/layout.rs.
const int MAX_VIEWS = 4;

struct ViewParams {
    vec4 eye;           // as in DrawParams
    vec4 ray_0;
    vec4 ray_x;
    vec4 ray_y;
    vec4 depth_map;     // internal depth from linear depth, as in DrawParams
    vec4 host_depth;    // host's depth = host_depth.x + host_depth.y / z, orthographic: host_depth.x + host_depth.y z
};

layout(set = 0, binding = 0, std140) uniform FrameParams {
    ViewParams views[MAX_VIEWS];
    vec4 light;         // towards the light, eye space, unit; w: exponent of the highlight
    vec2 offset;        // of the picture in the host's target [px]
    ivec2 extent;       // of the picture [px]
    float ambient;
    float specular;
    float edl_strength;
    float edl_radius;   // [px]
} frame;

// Internal depth of a linear one.
float internal_depth(ViewParams p, float z) {
    return clamp((p.depth_map.x * z + p.depth_map.y) / (p.depth_map.z * z + p.depth_map.w), 0.0, 1.0);
}
