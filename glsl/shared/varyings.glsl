// What a splat's fragments are given, all flat.
// Defined by the including stage: VARYING is `out` or `in`.
layout(location = 0) flat VARYING vec4 v_frame;     // inverse matrix; where the fragment casts its ray: (c, r)
layout(location = 1) flat VARYING vec4 v_centre;    // projected centre [whole px from the picture's middle], linear depth, radius (negative: cast)
layout(location = 2) flat VARYING vec4 v_plane;     // slope, unused where cast; rest of the projected centre [px]
layout(location = 3) flat VARYING vec4 v_color;     // linear light, ε
layout(location = 4) flat VARYING vec3 v_normal;    // eye space
