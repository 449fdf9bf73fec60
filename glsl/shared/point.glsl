// One point primitive a splat, fed by vertex attributes.
#include "splat.glsl"
#include "emit.glsl"

layout(location = 0) in vec4 in_geometry;
layout(location = 1) in uint in_normal;
layout(location = 2) in uint in_color;

void point() {
    Splat s = project(uint(gl_VertexIndex), in_geometry, in_normal);
    emit_attributes(s, in_color);
    gl_Position = NOWHERE;
    gl_PointSize = 1.0;
    if (is_drawn(s)) {
        vec2 size = s.box.zw - s.box.xy;
        gl_Position = clip_position(0.5 * (s.box.xy + s.box.zw), s.depth);
        gl_PointSize = max(size.x, size.y) + 0.25;
    }
}
