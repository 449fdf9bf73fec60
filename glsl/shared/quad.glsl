// Four vertices a splat, pulled from storage; six indices to draw them.
#include "splat.glsl"
#include "emit.glsl"

layout(set = 1, binding = 0, std430) readonly buffer Geometry { vec4 geometry[]; };
layout(set = 1, binding = 1, std430) readonly buffer Normals { uint normals[]; };
layout(set = 1, binding = 2, std430) readonly buffer Colors { uint colors[]; };

void quad() {
    uint i = uint(gl_VertexIndex) >> 2;
    Splat s = project(geometry[i], HAS_NORMAL ? normals[i] : NO_NORMAL);
    emit_attributes(s, HAS_COLOR ? colors[i] : 0u);
    gl_Position = NOWHERE;
    if (is_drawn(s)) {
        bvec2 high = bvec2((gl_VertexIndex & 1) != 0, (gl_VertexIndex & 2) != 0);
        // A sixteenth of a pixel for the rasteriser's grid.
        vec4 box = s.box + vec4(-0.0625, -0.0625, 0.0625, 0.0625);
        gl_Position = clip_position(mix(box.xy, box.zw, high), s.depth);
    }
}
