// What a fragment adds: Σ w c and Σ w in one attachment; where light or the front's depth are needed, Σ w n and the
// greatest −z in another.
#include "footprint.glsl"
#include "blend/weight.glsl"

// Also sets the depth that the fixed test compares. False: nothing here.
bool accumulate(out vec4 color, out vec4 surface) {
    float z;
    float u2 = footprint(gl_FragCoord.xy - params.middle, z);
    if (u2 > 1.0) {
        return false;
    }
    float w = weight(u2);
    color = vec4(fragment_color(), 1.0) * w;
    surface = vec4(fragment_normal() * w, -z);
    gl_FragDepth = internal_depth(z);
    return true;
}
