// A corner of a face, pulled from storage: three vertices a face.
#include "params.glsl"
#include "octahedral.glsl"
#include "srgb.glsl"
#define VARYING out
#include "face_varyings.glsl"

layout(set = 1, binding = 0, std430) readonly buffer Vertices { float vertices[]; };    // position, normal, colour
layout(set = 1, binding = 1, std430) readonly buffer Faces { uvec4 faces[]; };          // corners, size

const uint VERTEX = 5u;     // words
const vec4 NOWHERE = vec4(2.0, 2.0, 2.0, 1.0);

vec3 corner(uint vertex) {
    uint at = VERTEX * vertex;
    return vec3(vertices[at], vertices[at + 1u], vertices[at + 2u]);
}

void triangle() {
    uvec4 face = faces[uint(gl_VertexIndex) / 3u];
    uint vertex = face[uint(gl_VertexIndex) % 3u];
    vec3 a = corner(face.x);
    vec3 b = corner(face.y);
    vec3 c = corner(face.z);
    vec3 position = corner(vertex);
    vec3 centre = vec4(position - params.about.xyz, 1.0) * params.eye_from_cloud;
    v_eye = centre;
    v_place = position * params.test_eye.w - params.test_eye.xyz;
    vec3 across = cross(b - a, c - a);
    vec3 turned = vec4(across, 0.0) * params.eye_from_cloud;
    float size = length(turned);
    v_face = vec4(size > 0.0 ? turned / size : vec3(0.0, 0.0, 1.0), uintBitsToFloat(face.w));
    uint code = floatBitsToUint(vertices[VERTEX * vertex + 3u]);
    v_normal = HAS_NORMAL && code != NO_NORMAL ? normalize(vec4(octahedral(code), 0.0) * params.eye_from_cloud) : vec3(0.0);
    uint color = floatBitsToUint(vertices[VERTEX * vertex + 4u]);
    v_color = HAS_COLOR ? linear_from_srgb(unpackUnorm4x8(color).rgb) : params.base_color.rgb;

    vec4 h = vec4(centre, 1.0);
    float z = -centre.z;
    // Only the near plane clips, as it does splats: without perspective what lies beyond the far plane is kept up to 16 times
    // as deep.
    float depth = PERSPECTIVE ? params.near : 1.0 - (1.0 - internal_depth(z)) / 16.0;
    gl_Position = vec4(dot(params.pixel_x, h) / params.middle.x, dot(params.pixel_y, h) / params.middle.y, depth, dot(params.pixel_w, h));
    // In the cloud's own frame, whatever the hand of eye space.
    if (CULL_BACK && dot(across, a * params.test_eye.w - params.test_eye.xyz) > 0.0) {
        gl_Position = NOWHERE;
    }
}
