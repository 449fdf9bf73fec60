// One fragment of `groups`, into the layer of its splat's group: the vertex stage has chosen that.
#include "footprint.glsl"
#include "blend/weight.glsl"
#include "blend/voronoi.glsl"

layout(location = 0) out vec4 out_color;    // w c, w
layout(location = 1) out vec4 out_front;    // z + ε, z

// Sets colour, front and the depth that decides; returns the weight. Discards where nothing is.
float layered() {
    float z;
    float u2 = footprint(gl_FragCoord.xy - params.middle, z);
    if (u2 > 1.0) {
        discard;
    }
    float w = weight(u2);
    out_color = vec4(fragment_color(), 1.0) * w;
    float epsilon = fragment_epsilon();
    out_front = vec4(z + epsilon, z, 0.0, 0.0);
    gl_FragDepth = decisive(z, epsilon, u2);
    return w;
}
