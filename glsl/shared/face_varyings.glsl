// What a triangle's fragments are given. Defined by the including stage: VARYING is `out` or `in`.
layout(location = 0) smooth VARYING vec3 v_eye;     // eye space
layout(location = 1) smooth VARYING vec3 v_place;   // from the eye [cloud units]; without perspective of length 1
layout(location = 2) smooth VARYING vec3 v_color;   // linear light
layout(location = 3) smooth VARYING vec3 v_normal;  // eye space; 0 where there is none
layout(location = 4) flat VARYING vec4 v_face;      // unit normal, eye space; size [cloud units]
