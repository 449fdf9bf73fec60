//! `Picture::sensitivity` against the difference of two pictures.

use surfel::standalone::stress;

#[test]
fn a_shift_moves_no_pixel_by_more_than_it_says() {
    let shift = 1e-4;
    let mut tight = 0.0f64;
    for name in
        ["soup back to front of the file, two-pass", "sheet back to front of the file, two-pass", "4 px, two-pass"]
    {
        let case = stress::cases().into_iter().find(|c| c.name == name).expect("a case of this name");
        let mut moved = case.clone();
        // Clip space is 2 wide: everything goes right by the shift [px].
        let p = &mut moved.take.view.projection;
        p.z_axis.x += 2.0 * shift / case.size[0] as f64 * p.z_axis.w;
        let (a, b) = (stress::reference(&case).expect("a picture"), stress::reference(&moved).expect("a picture"));
        for i in (0..a.rgba.len()).filter(|i| !a.ties[*i] && !b.ties[*i]) {
            let change = (0..4).map(|k| (a.rgba[i][k] - b.rgba[i][k]).abs()).fold(0.0, f64::max);
            // First order; the second is the shift's square times the weights' curvature, at most 100 a squared pixel.
            let bound = a.sensitivity[i].max(b.sensitivity[i]) * shift + 100.0 * shift * shift;
            assert!(change <= bound, "{name}, pixel {i}: {change:e} is more than {bound:e}");
            tight = tight.max(change / bound);
        }
    }
    // It is no empty promise: somewhere most of it is used.
    assert!(tight > 0.5, "{tight}");
}
