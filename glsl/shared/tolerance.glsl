// How far behind the front a splat's surface goes on: ε [world units].
// What the low-pass spreads a splat over counts as its radius: a pixel's width on its plane, tan θ times as deep as
// wide. Without it the one fragment in front hides the rest of its own surface wherever splats are smaller than pixels.
// Beyond 8 (83°) a pixel's depth says nothing any more.
float tolerance(float radius, float pixel, float nv) {
    float steep = min(sqrt(max(1.0 - nv * nv, 0.0)) / -nv, 8.0);
    return max(params.tolerance_absolute, params.tolerance_relative * max(radius, params.low_pass * pixel * max(steep, 1.0)));
}
