// One point primitive a splat, fed by vertex attributes.
#include "splat.glsl"
#include "emit.glsl"

// As packing.glsl has them.
layout(location = 0) in vec4 in_geometry;
layout(location = 1) in uint in_normal;
layout(location = 2) in uint in_color;

void point() {
    uint i = uint(gl_VertexIndex);
    Point p = streamed(i, in_geometry, in_normal, in_color);
    Splat s = project(i, p);
    emit_attributes(s, p.color);
    gl_Position = NOWHERE;
    gl_PointSize = 1.0;
    if (is_drawn(s)) {
        vec2 size = s.box.zw - s.box.xy;
        gl_Position = clip_position(0.5 * (s.box.xy + s.box.zw), s.depth);
        gl_PointSize = max(size.x, size.y) + 0.25;
    }
}
