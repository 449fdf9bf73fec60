#version 460
// The device's ceiling: a point of a given size, transformed once. No disk, no normal, no test.
layout(location = 0) in vec4 in_geometry;
layout(push_constant) uniform BarePush {
    mat4 clip_from_cloud;
    float size;     // [px]
} push;

void main() {
    gl_Position = push.clip_from_cloud * vec4(in_geometry.xyz, 1.0);
    gl_PointSize = push.size;
}
