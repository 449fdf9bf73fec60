// What a splat's fragments are given, all flat. `plane` means (slope, perspective, ε), or (n, ε) where LARGE.
// Defined by the including stage: VARYING is `out` or `in`.
layout(location = 0) flat VARYING vec4 v_frame;     // inverse matrix; LARGE: (c, r)
layout(location = 1) flat VARYING vec4 v_centre;    // projected centre [whole px from the picture's middle], linear depth, radius
layout(location = 2) flat VARYING vec4 v_plane;
layout(location = 3) flat VARYING vec3 v_color;     // linear light
layout(location = 5) flat VARYING vec2 v_rest;      // of the projected centre, beyond whole pixels
layout(location = 4) flat VARYING vec3 v_normal;    // eye space
