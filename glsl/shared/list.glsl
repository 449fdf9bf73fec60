// Stable compaction: the numbers of the points in the cut, in stored order, as an index list and what draws it. Tiles of
// consecutive points are marked a bit a point, tiles of a range are summed up, then every tile writes from its own place on.
// No atomic decides an order: two runs write the same bytes. Twin: src/draw/list.rs.
const uint LANES = 64u;             // few, since many tiles are not full
const uint TILE = 512u;             // points
const uint WORDS = TILE / 32u;      // marks of a tile

struct Range {
    uint first;     // tile
    uint tiles;     // number of them
    uint base;      // where in the list its part begins
    uint unused;
};

// VkDrawIndexedIndirectCommand of points and VkDrawIndirectCommand of quads, a range.
struct Command {
    uint indices;
    uint instances;
    uint first_index;
    uint vertex_offset;
    uint first_instance;
    uint vertices;
    uint quad_instances;
    uint first_vertex;
    uint first_quad_instance;
};

layout(set = 2, binding = 1, std430) readonly buffer Tiles { uvec2 tiles[]; };     // first point in the chunk, number
