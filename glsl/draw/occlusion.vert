#version 460
// The icosahedron round a ball of cloud coordinates, the faces towards the eye: 60 vertices (Gobbetti, Marton: Layered Point Clouds, 2004,
// section 4.3). Whatever lies in the ball lies behind those faces, pixel by pixel. All of it lies beyond the near plane.
#include "params.glsl"
#include "layered.glsl"

// Corners at 0, ± SHORT, ± LONG: an icosahedron whose faces touch the unit ball.
const float SHORT = 0.6615845;
const float LONG = 1.0704662;
const vec4 NOWHERE = vec4(2.0, 2.0, 2.0, 1.0);

// Corners of the faces, four bits each.
const uint FACES[20] = uint[](
    0x410u, 0x610u, 0x840u, 0x960u, 0x980u, 0xa41u, 0xb61u, 0xba1u, 0x532u, 0x732u,
    0x852u, 0x972u, 0x982u, 0xa53u, 0xb73u, 0xba3u, 0x854u, 0xa54u, 0x976u, 0xb76u
);

vec3 corner(uint k) {
    vec2 at = vec2((k & 1u) != 0u ? SHORT : -SHORT, (k & 2u) != 0u ? LONG : -LONG);
    uint axis = k >> 2;
    return axis == 0u ? vec3(0.0, at) : axis == 1u ? vec3(at.y, 0.0, at.x) : vec3(at, 0.0);
}

void main() {
    vec4 ball = uintBitsToFloat(steps[run.table]);
    uint face = FACES[uint(gl_VertexIndex) / 3u];
    vec3 out_ward = corner(face & 15u) + corner(face >> 4 & 15u) + corner(face >> 8);
    vec3 way = corner(face >> 4 * (uint(gl_VertexIndex) % 3u) & 15u);
    vec3 position = ball.xyz + ball.w * way;
    // Towards the eye: the other side of the face's plane.
    bool faces_away = dot(out_ward, params.test_eye.xyz - position * params.test_eye.w) < 0.0;
    vec4 h = vec4(vec4(position - params.about.xyz, 1.0) * params.eye_from_cloud, 1.0);
    float depth = PERSPECTIVE ? params.near : internal_depth(-h.z);
    gl_Position = vec4(dot(params.pixel_x, h) / params.middle.x, dot(params.pixel_y, h) / params.middle.y, depth, dot(params.pixel_w, h));
    if (faces_away) {
        gl_Position = NOWHERE;
    }
}
