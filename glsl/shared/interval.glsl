// Which entries of a sequential list are in the cut, decided for each by itself (Dachsbacher, Vogelgsang, Stamminger:
// Sequential Point Trees, 2003, section 3.6). Twin, bit for bit: Test in src/structure/nodes.rs. Sums, differences and
// products are rounded alike everywhere as long as none is fused with the next; roots and quotients are not.
const uint NO_NODE = 0xffffffffu;
const int RULE_SPLIT = 1;
const float SPLIT_REACH = 2.0;

layout(set = 1, binding = 4, std430) readonly buffer Links { uvec2 links[]; };  // own node and parent's, a point
// (place, error) a node, or that and (normal, e_t) where the rule has use for it; the chunk's own, and its points' parents.
layout(set = 1, binding = 5, std430) readonly buffer Nodes { vec4 nodes[]; };

vec4 place_of(uint node) { return nodes[RULE == RULE_SPLIT ? 2u * node : node]; }

float square(vec3 v) {
    precise float sum = (v.x * v.x + v.y * v.y) + v.z * v.z;
    return sum;
}

bool passes(uint node) {
    vec4 place = place_of(node);
    precise vec3 to = place.xyz * params.test_eye.w - params.test_eye.xyz;
    float distance_square = square(to);
    precise float limit = (params.tau * params.tau) * distance_square;
    precise float error = place.w * place.w;
    if (RULE != RULE_SPLIT) {
        return error <= limit;
    }
    vec4 normal = nodes[2u * node + 1u];
    precise float cosine = abs((normal.x * to.x + normal.y * to.y) + normal.z * to.z);
    precise float sine_square = max(distance_square - cosine * cosine, 0.0);
    precise float left = params.tau * distance_square - normal.w * cosine;
    precise float both = error + normal.w * normal.w;
    precise float reach = (SPLIT_REACH * SPLIT_REACH) * limit;
    precise float seen = error * sine_square;
    precise float allowed = left * left;
    return left >= 0.0 && seen <= allowed && both <= reach;
}

float error_of(uint node) {
    float error = place_of(node).w;
    return RULE == RULE_SPLIT ? length(vec2(error, nodes[2u * node + 1u].w)) : error;
}

// Whether point i, at this place, is drawn.
bool in_interval(uint i, vec3 place) {
    if (INTERVAL == INTERVAL_OFF) {
        return true;
    }
    uvec2 link = links[i];
    if (INTERVAL == INTERVAL_EXACT) {
        return (link.x == NO_NODE || passes(link.x)) && (link.y == NO_NODE || !passes(link.y));
    }
    float reach = params.tau * length(place * params.test_eye.w - params.test_eye.xyz);
    if (link.x != NO_NODE && error_of(link.x) > reach) {
        return false;
    }
    return link.y == NO_NODE
        || reach < error_of(link.y) + params.tau * params.test_eye.w * distance(place, place_of(link.y).xyz);
}
