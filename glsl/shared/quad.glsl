// Four vertices a splat, pulled from storage; six indices to draw them. From a list: six vertices a splat.
#include "splat.glsl"
#include "emit.glsl"

layout(set = 2, binding = 5, std430) readonly buffer List { uint list[]; };

// The splat of this vertex.
uint splat_index() {
    uint v = uint(gl_VertexIndex);
    return LISTED ? list[v / 6u] : v >> 2;
}

void quad() {
    uint i = splat_index();
    Point p = pulled(i);
    Splat s = project(i, p);
    emit_attributes(s, p.color);
    gl_Position = NOWHERE;
    if (is_drawn(s)) {
        // Of six vertices 0 1 2, 2 1 3: two bits each.
        int corner = LISTED ? 0xDA4 >> 2 * (gl_VertexIndex % 6) : gl_VertexIndex;
        bvec2 high = bvec2((corner & 1) != 0, (corner & 2) != 0);
        // A sixteenth of a pixel for the rasteriser's grid.
        vec4 box = s.box + vec4(-0.0625, -0.0625, 0.0625, 0.0625);
        gl_Position = clip_position(mix(box.xy, box.zw, high), s.depth);
    }
}
