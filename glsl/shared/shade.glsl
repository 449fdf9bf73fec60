// Light on the interpolated normal. `n` and `v` (towards the viewer) are unit vectors in eye space.
const int SHADE_NONE = 0;
const int SHADE_HEADLIGHT = 1;
const int SHADE_PHONG = 2;

vec3 shade(int model, vec3 c, vec3 n, vec3 v) {
    if (model == SHADE_HEADLIGHT) {
        return c * mix(max(dot(n, v), 0.0), 1.0, frame.ambient);
    }
    if (model == SHADE_PHONG) {
        vec3 l = frame.light.xyz;
        float nl = dot(n, l);
        float highlight = nl > 0.0 ? pow(max(dot(reflect(-l, n), v), 0.0), frame.light.w) : 0.0;
        return c * mix(max(nl, 0.0), 1.0, frame.ambient) + frame.specular * highlight;
    }
    return c;
}
