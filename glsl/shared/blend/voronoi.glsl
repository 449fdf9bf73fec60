// What decides between the fragments of one group at one pixel, as internal depth: greater wins.
//
// Cones (Hoff et al. 1999): z + min(ε, r) u. Where two splats of one surface overlap, the nearer centre wins. Not ε alone:
// where the low-pass stretches it (steep splats, smaller than a pixel), what lies behind a rim would win against the rim.
//
// As published (Zhang and Pajarola 2006, eqs 6 and 10, reversed): 1 − (floor(t n) + u) / n, t linear in the frame's depth
// range; where a surface passes from slab to slab, the farther part of a splat loses to any other.
float decisive(float z, float epsilon, float u2) {
    float u = min(sqrt(u2), 1.0);
    if (VORONOI == VORONOI_CONES) {
        return internal_depth(z + min(epsilon, fragment_radius()) * u);
    }
    if (VORONOI == VORONOI_SLABS) {
        float slab = clamp(floor((z - params.slab_near) / params.slab_thickness), 0.0, params.slab_count - 1.0);
        return 1.0 - (slab + u) / params.slab_count;
    }
    return internal_depth(z);
}
