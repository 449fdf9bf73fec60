// Light on the interpolated normal. `n` and `v` (towards the viewer) are unit vectors in eye space. `agreement` is the
// mean normal's length: with it the diffuse term is the mean of the splats' own. Where normals disagree, at silhouettes
// and in leaves, their normalised mean would face the viewer and be lit.
const int SHADE_NONE = 0;
const int SHADE_HEADLIGHT = 1;
const int SHADE_PHONG = 2;

vec3 shade(int model, vec3 c, vec3 n, float agreement, vec3 v) {
    if (model == SHADE_HEADLIGHT) {
        return c * mix(agreement * max(dot(n, v), 0.0), 1.0, frame.ambient);
    }
    if (model == SHADE_PHONG) {
        vec3 l = frame.light.xyz;
        float nl = dot(n, l);
        float highlight = nl > 0.0 ? agreement * pow(max(dot(reflect(-l, n), v), 0.0), frame.light.w) : 0.0;
        return c * mix(agreement * max(nl, 0.0), 1.0, frame.ambient) + frame.specular * highlight;
    }
    return c;
}
