// One fragment of `fuzzy`, wherever the pixel's state comes from.
#include "footprint.glsl"
#include "blend/weight.glsl"
#include "blend/fuzzy.glsl"

// The fragment's share; false: nothing here.
bool fragment(out float z, out vec4 color, out vec3 normal) {
    float u2 = footprint(gl_FragCoord.xy - params.middle, z);
    float w = weight(u2);
    color = vec4(fragment_color(), 1.0) * w;
    normal = fragment_normal() * w;
    return u2 <= 1.0;
}
