// What one cloud in one view needs. Twin: src/gpu/layout.rs.
// Eye space: x right, y up, the viewer looks along −z. Linear depth z = −z_eye [world units]. Pixels: x right, y down, from
// the picture's middle: floats are twice as fine there as from a corner, and the middle's rays need no correction.
layout(set = 0, binding = 0, std140) uniform DrawParams {
    mat3x4 eye_from_cloud;  // rows, to multiply (position − about, 1) from the right: rotation, uniform scale, translation
    vec4 about;             // the point that positions are taken from before they are turned; w: see pixel.glsl
    mat3x4 pixel_hi;        // rows of pixel x, y and w of (position − about, 1), split in two: see pixel.glsl
    mat3x4 pixel_lo;
    vec4 pixel_x;           // (pixel_x · P) / (pixel_w · P) is the pixel's x of the eye-space point P = (p, 1)
    vec4 pixel_y;
    vec4 pixel_w;           // equals the linear depth (perspective) or 1 (orthographic)
    vec4 eye;               // centre of projection: (x, y, z, 1), or the direction towards the viewer and 0
    vec4 ray_0;             // A(pixel) = ray_0 + ray_x·x + ray_y·y: see pixel_ray()
    vec4 ray_x;
    vec4 ray_y;
    vec4 depth_map;         // internal depth d = (depth_map.x z + depth_map.y) / (depth_map.z z + depth_map.w), 1 is near
    vec4 base_color;        // linear light, for clouds without colours
    vec2 middle;            // half the picture's size [px]
    float near;             // linear depth of the near plane [world units]
    float radius_scale;     // style × instance; 1/√2 of that for hard discs
    float tolerance_absolute;
    float tolerance_relative;   // in units of the splat's radius
    float low_pass;         // ρ [px]
    float sprite_limit;     // largest point size [px]; quads: 3·10³⁸
    float pixel_size;       // side of FOOTPRINT_PIXELS [px]
    float slab_near;        // linear depth where the first slab begins, see blend/voronoi.glsl
    float slab_thickness;   // [world units]
    float slab_count;
    vec4 test_eye;          // the eye relative to the cloud's origin and 1, or the direction towards the viewer and 0
    float tau;              // what the interval test compares errors with, per unit of distance
    uint radius_most;       // codes of radii: see packing.glsl
    uint radius_step;
    uint slot_shift;        // layered: a patch's slot is a point's number shifted right by so many bits
} params;

// What a run of points has of its own. Twin: src/gpu/layout.rs.
layout(push_constant) uniform RunPush {
    uint first;             // compute: first point in the chunk, or first tile
    uint count;             // compute: number of points; triangles: their layer
    float least;            // least stored radius of its points, see Span
    uint table;             // layered: where the steps of the chunk's slots begin; occlusion: the ball
} run;

const int FOOTPRINT_SPLAT = 0;      // Gaussian disk
const int FOOTPRINT_DISC = 1;       // hard disc
const int FOOTPRINT_PIXELS = 2;     // square of a given size

const int LARGE_NEVER = 0;      // they are left out
const int LARGE_ONLY = 1;       // nothing else is drawn
const int LARGE_TOO = 2;        // everything is, in stored order

const int VORONOI_OFF = 0;      // the nearest fragment of a group
const int VORONOI_CONES = 1;    // the least z + min(ε, r) u
const int VORONOI_SLABS = 2;    // as published

const int INTERVAL_OFF = 0;         // every point
const int INTERVAL_EXACT = 1;       // passes, and its parent at its own place does not
const int INTERVAL_PUBLISHED = 2;   // passes, and its parent would not at the point's distance and some more

const int PACKING_FULL = 0;
const int PACKING_EXACT = 1;
const int PACKING_QUANTISED = 2;
const int PACKING_ASIDE = 3;        // quantised, with normals and colours: radii in a stream of their own

// Set in src/draw/variant.rs.
layout(constant_id = 0) const int FOOTPRINT = FOOTPRINT_SPLAT;
layout(constant_id = 1) const bool APPROXIMATE = false; // affine image of the disk (Coconu and Hege 2002, eqs 4 and 5)
layout(constant_id = 2) const bool CULL_BACK = false;
layout(constant_id = 3) const bool HAS_NORMAL = true;
layout(constant_id = 4) const bool HAS_COLOR = true;
layout(constant_id = 6) const bool CASTS = false;       // what comes near the eye is bounded: LARGE, and counting
layout(constant_id = 7) const bool PAIRS = false;       // projected centres in pairs of floats: see pixel.glsl
layout(constant_id = 5) const int LARGE = LARGE_NEVER;  // what becomes of the splats that a sprite cannot hold
layout(constant_id = 8) const int VORONOI = VORONOI_OFF;
layout(constant_id = 9) const bool FRONT_FIRST = false; // the front is the fragment that came first (as published)

layout(constant_id = 11) const int INTERVAL = INTERVAL_OFF;
layout(constant_id = 12) const int RULE = 0;            // what errors are: see interval.glsl
layout(constant_id = 13) const bool LISTED = false;     // quads: points are numbered by a list
layout(constant_id = 14) const int PACKING = PACKING_FULL;
layout(constant_id = 15) const bool LAYERED = false;    // radii, and which samples there are, come from a cut: see layered.glsl
// Not asked of depth_map: software devices run both sides of a branch, and lavapipe (Mesa 22.3) compiles a shader that branches
// on parameters anew whenever it is bound, and keeps all of that.
layout(constant_id = 16) const bool PERSPECTIVE = true; // orthographic otherwise

float internal_depth(float z) {
    return (params.depth_map.x * z + params.depth_map.y) / (params.depth_map.z * z + params.depth_map.w);
}

// The ray of a pixel: base + z·direction is its eye-space point at linear depth z.
void pixel_ray(vec2 pixel, out vec3 base, out vec3 direction) {
    vec3 a = params.ray_0.xyz + params.ray_x.xyz * pixel.x + params.ray_y.xyz * pixel.y;
    base = PERSPECTIVE ? params.eye.xyz : a;
    direction = PERSPECTIVE ? a : -params.eye.xyz / params.eye.z;
}
