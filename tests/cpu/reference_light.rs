//! Light, facing, and what is counted.

use glam::vec3;
use surfel::reference::Counts;
use surfel::style::{BackFaces, EyeDome, Footprint, Shading, Style, Tolerance};

use crate::reference_common::*;

fn lit(n: [f32; 3], shading: Shading) -> [f64; 4] {
    // 188 is not ½ exactly: ((188/255 + 0.055)/1.055)^2.4 = 0.502886.
    at(&Small::flat_view().splat([0.5, -0.5, 0.0], n, 2.0, [188; 3]).style(|s| s.shading = shading).render(), 4, 4)
}

const GREY: f64 = 0.502886458032569;

#[track_caller]
fn near(a: f64, b: f64, bound: f64) {
    assert!((a - b).abs() <= bound, "{a} is not {b} within {bound}");
}

#[test]
fn headlight() {
    let shading = Shading::Headlight { ambient: 0.25 };
    near(lit(Z, Shading::None)[0], GREY, 1e-11);
    near(lit(Z, shading)[0], GREY, 1e-11);
    // n·v = 0.8 to the octahedral code's 6.5·10⁻⁵: 0.25 + 0.75 · 0.8.
    near(lit([0.0, 0.6, 0.8], shading)[0], 0.85 * GREY, 5e-5);
    // From behind it is lit all the same; without a normal it faces the viewer.
    near(lit([0.0, -0.6, -0.8], shading)[0], 0.85 * GREY, 5e-5);
    near(lit([0.0; 3], shading)[0], GREY, 1e-11);
}

#[test]
fn phong() {
    let phong = |light, shininess| Shading::Phong { light, ambient: 0.2, specular: 0.5, shininess };
    // n = v = z, l = (0.6, 0, 0.8) from a vector of any length: r = (−0.6, 0, 0.8), (r·v)² = 0.64. f32 parameters: 10⁻⁷.
    near(lit(Z, phong(vec3(3.0, 0.0, 4.0), 2.0))[0], GREY * (0.2 + 0.8 * 0.8) + 0.5 * 0.64, 1e-6);
    // Not clamped above: r·v = 1.
    near(lit(Z, phong(vec3(0.0, 0.0, 1.0), 8.0))[0], GREY + 0.5, 1e-6);
    // The light is behind: ambient alone, no highlight, although −l mirrored meets the viewer.
    near(lit(Z, phong(vec3(0.0, 0.0, -1.0), 2.0))[0], GREY * 0.2, 1e-6);
}

#[test]
fn light_is_the_mean_where_normals_disagree() {
    // Two normals at ±53° about the viewer's direction average to it, 0.6 long: each alone has cos 53° = 0.6.
    let pair = Small::flat_view()
        .splat([0.5, -0.5, 0.0], [0.8, 0.0, 0.6], 2.0, WHITE)
        .splat([0.5, -0.5, 0.0], [-0.8, 0.0, 0.6], 2.0, WHITE)
        .style(|s| s.shading = Shading::Headlight { ambient: 0.0 });
    near(at(&pair.render(), 4, 4)[0], 0.6, 1e-4);
}

#[test]
fn a_highlight_is_scaled_by_coverage() {
    // Rim of a facing disk: α = 1/8, colour (1 + 0.5) · α.
    let shading = Shading::Phong { light: vec3(0.0, 0.0, 1.0), ambient: 0.0, specular: 0.5, shininess: 4.0 };
    let p = Small::flat_view().splat([0.5, -0.5, 0.0], Z, 2.0, WHITE).style(|s| s.shading = shading).render();
    assert_eq!(at(&p, 6, 4), [0.1875, 0.1875, 0.1875, 0.125]);
}

#[test]
fn eye_dome_darkens_what_lies_behind() {
    // Depth 4 left of x = 0, depth 8 right of it: a step of one in log₂. R = 1 puts the eight neighbours on the eight pixels.
    let mut plates = Small::flat_view().opaque();
    for i in 0..64 {
        let (x, y) = ((i % 8) as f32 - 3.5, (i / 8) as f32 - 3.5);
        plates = plates.splat([x, y, if x < 0.0 { 1.0 } else { -3.0 }], Z, 1.0, WHITE);
    }
    let p = plates.style(|s| s.eye_dome = Some(EyeDome { strength: 0.01, radius: 1.0 })).render();
    assert_eq!((depth_at(&p, 3, 3), depth_at(&p, 4, 3)), (4.0, 8.0));
    // exp(−100 · 0.01 · 3/8) in the first column behind the step, 2/8 at its end; nothing elsewhere. f32 strength: 10⁻⁸.
    near(at(&p, 4, 3)[0], (-0.375f64).exp(), 1e-7);
    near(at(&p, 4, 0)[0], (-0.25f64).exp(), 1e-7);
    assert_eq!((at(&p, 3, 3)[0], at(&p, 5, 3)[0], at(&p, 0, 0)[0]), (1.0, 1.0, 1.0));
    assert_eq!(at(&p, 4, 3)[3], 1.0, "coverage stays");
}

#[test]
fn every_dropped_splat_is_counted() {
    let mut small = Small::flat_view()
        .splat([0.5, -0.5, 0.0], Z, 2.0, WHITE)
        .splat([0.5, -0.5, 0.0], [0.0, 0.0, -1.0], 2.0, WHITE)
        .splat([0.5, -0.5, 0.0], [0.0; 3], 2.0, WHITE)
        // Just outside to the right, and just inside; before and across the near plane at z_world = 4.
        .splat([6.01, 0.0, 0.0], Z, 2.0, WHITE)
        .splat([5.99, 0.0, 0.0], Z, 2.0, WHITE)
        .splat([0.0, 0.0, 4.5], Z, 2.0, WHITE)
        .splat([0.0, 0.0, 4.5], [0.0, 1.0, 0.0], 2.0, WHITE);
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        small = small.splat([0.0; 3], Z, bad, WHITE);
    }
    small = small.splat([f32::NAN, 0.0, 0.0], Z, 1.0, WHITE);
    let counts = |back_faces, closed| {
        let mut small = small.clone().style(|s| s.back_faces = back_faces);
        small.flat.closed = closed;
        let c = small.render().counts;
        assert_eq!(c.submitted, c.drawn + c.culled_frustum + c.culled_cone + c.culled_invalid);
        c
    };
    let kept = Counts { submitted: 12, drawn: 5, culled_frustum: 2, culled_cone: 0, culled_invalid: 5 };
    let culled = Counts { drawn: 4, culled_cone: 1, ..kept };
    assert_eq!(counts(BackFaces::Draw, true), kept);
    assert_eq!(counts(BackFaces::Auto, false), kept);
    assert_eq!(counts(BackFaces::Auto, true), culled);
    assert_eq!(counts(BackFaces::Cull, false), culled);
}

/// Whether pixel (4, 4) is a tie for this margin.
fn tied(small: &Small, margin: f64) -> bool {
    small.with(|scene| surfel::reference::render(scene, margin)).ties[4 * 8 + 4]
}

#[test]
fn ties_by_hand() {
    let one = |z: f32| Small::flat_view().splat([0.5, -0.5, z], Z, 2.2, RED);
    let two = |z: f32| one(0.0).splat([0.5, -0.5, z], Z, 2.2, BLUE);
    let absolute = |absolute| move |s: &mut Style| s.tolerance = Tolerance { absolute, relative: 0.0 };
    let host = |value: f32| Small { host: Some(vec![value; 64]), ..one(0.0) };
    let pixels = |side: f32| move |s: &mut Style| s.footprint = Footprint::Pixels(side);
    for (name, scene, expected) in [
        ("alone", one(0.0), false),
        ("tolerance met", two(-0.5).style(absolute(0.5)), true),
        ("within the tolerance", two(-0.5).style(absolute(0.51)), false),
        ("beyond the tolerance", two(-0.5).style(absolute(0.49)), false),
        ("equally near", two(0.0).opaque(), true),
        ("nearest", two(0.001).opaque(), false),
        ("at the host's depth", host(0.5), true),
        ("behind the host's depth", host(0.51), false),
        ("before the host's depth", host(0.49).opaque(), false),
        ("on the near plane", one(4.0), true),
        (
            "a square's border",
            Small::flat_view().splat([1.0, -0.5, 0.0], Z, 1.0, RED).opaque().style(pixels(1.0)),
            true,
        ),
        ("a square's middle", one(0.0).opaque().style(pixels(1.0)), false),
    ] {
        assert_eq!(tied(&scene, 1e-6), expected, "{name}");
        assert!(!tied(&scene, 0.0), "{name}, without margin");
    }
    // Turned away by 10⁻⁴: dropped, but an error of 10⁻³ may show it.
    let edge = Small::flat_view().splat([0.5, -0.5, 0.0], [1.0, 0.0, -1e-4], 2.0, RED);
    let edge = edge.style(|s| (s.back_faces, s.low_pass) = (BackFaces::Cull, 1.0));
    assert_eq!((edge.render().counts.culled_cone, at(&edge.render(), 4, 4)[3]), (1, 0.0));
    assert!(tied(&edge, 1e-3) && !tied(&edge, 1e-6));
}
