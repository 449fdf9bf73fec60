// Ordered depth test and blending (Dachsbacher, Vogelgsang, Stamminger: Sequential Point Trees, 2003, section 5), with two
// departures: every splat has its own tolerance, the incoming one's where it replaces and the front's where it is tested;
// and sums are kept instead of means, which saves the division of every fragment.
#include "blend/hidden.glsl"

struct State {
    vec4 color;     // Σ w c, Σ w with the sign of hidden.glsl
    vec3 normal;    // Σ w n
    vec2 front;     // limit zd + ε, zd
};

// Blends a fragment in; false: nothing changes.
bool fuzzy(inout State s, float z, float epsilon, vec4 color, vec3 normal) {
    float weight = abs(s.color.a);
    bool hidden = is_hidden(s.color.a);
    bool reject = z > s.front.x;
    if (reject && hidden) {
        return false;
    }
    bool replace = z + epsilon < s.front.y;
    vec4 sum = vec4(s.color.rgb, weight);
    s.color = reject ? sum : replace ? color : sum + color;
    s.normal = reject ? s.normal : replace ? normal : s.normal + normal;
    s.color.a = with_hidden(s.color.a, hidden || reject || (replace && weight > 0.0));
    if (!reject && (replace || !FRONT_FIRST)) {
        s.front = min(s.front, vec2(z + epsilon, z));
    }
    return true;
}
