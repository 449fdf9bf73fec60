//! The reference against values derived by hand. Pixel (4, 4) of the flat view has its centre at x = 0.5, y = −0.5.

use glam::{DVec2, DVec3, dvec2, dvec3};
use surfel::select::View;
use surfel::style::{Ellipse, Footprint, Tolerance};

use crate::reference_common::*;

#[track_caller]
fn near(a: f64, b: f64, bound: f64) {
    assert!((a - b).abs() <= bound, "{a} is not {b} within {bound}");
}

#[test]
fn a_facing_disk_has_the_weights_of_the_definition() {
    let p = Small::flat_view().splat([0.5, -0.5, 0.0], Z, 2.0, WHITE).render();
    // u² = d²/4; α = min(1, 2 · 2^(−d²)): all of the arithmetic is dyadic.
    for (x, y, alpha) in
        [(4, 4, 1.0), (5, 4, 1.0), (6, 4, 0.125), (2, 4, 0.125), (4, 6, 0.125), (5, 5, 0.5), (7, 4, 0.0), (6, 5, 0.0)]
    {
        assert_eq!(at(&p, x, y), [alpha; 4], "{x} {y}");
        assert_eq!(depth_at(&p, x, y), if alpha > 0.0 { 5.0 } else { f64::INFINITY });
    }
}

#[test]
fn overlapping_splats_average_by_weight() {
    // At (4, 4): red with w = 1, blue one pixel away with w = ½.
    let p = Small::flat_view().splat([0.5, -0.5, 0.0], Z, 2.0, RED).splat([1.5, -0.5, -0.5], Z, 2.0, BLUE).render();
    let [r, g, b, a] = at(&p, 4, 4);
    near(r, 2.0 / 3.0, 1e-15);
    near(b, 1.0 / 3.0, 1e-15);
    assert_eq!((g, a, depth_at(&p, 4, 4)), (0.0, 1.0, 5.0));
    // Coverage that does not saturate: rims of both at (4, 6), w = 1/16 and 2^(−5) < rim, so red's alone.
    assert_eq!(at(&p, 4, 6), [0.125, 0.0, 0.0, 0.125]);
}

#[test]
fn tolerance_decides_to_the_last_bit() {
    let pair = Small::flat_view().splat([0.5, -0.5, -0.5], Z, 2.0, BLUE).splat([0.5, -0.5, 0.0], Z, 2.0, RED);
    let color =
        |absolute, relative| at(&pair.clone().style(|s| s.tolerance = Tolerance { absolute, relative }).render(), 4, 4);
    assert_eq!(color(0.5, 0.0), [0.5, 0.0, 0.5, 1.0], "z ≤ z + ε holds at equality");
    assert_eq!(color(0.5f32.next_down(), 0.0), [1.0, 0.0, 0.0, 1.0]);
    // Relative to the radius, 2; the larger of the two counts.
    assert_eq!(color(0.0, 0.25), [0.5, 0.0, 0.5, 1.0]);
    assert_eq!(color(0.1, 0.25f32.next_down()), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(color(0.6, 0.1), [0.5, 0.0, 0.5, 1.0]);
}

#[test]
fn the_limit_is_the_least_over_all_splats() {
    // A large splat in front with ε = 4, a small one behind it with ε = 1: what lies 1.5 behind the small one is out.
    let p = Small::flat_view()
        .splat([0.5, -0.5, 1.0], Z, 4.0, RED)
        .splat([0.5, -0.5, 0.5], Z, 1.0, RED)
        .splat([0.5, -0.5, -1.0], Z, 4.0, BLUE)
        .render();
    assert_eq!(at(&p, 4, 4), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(at(&p, 6, 4)[2], at(&p, 6, 4)[0], "beside the small one both count, with equal weights");
}

#[test]
fn host_depth_hides_what_is_behind() {
    let mut pair = Small::flat_view().splat([0.5, -0.5, -0.5], Z, 2.0, BLUE).splat([0.5, -0.5, 0.0], Z, 2.0, RED);
    // Reversed orthographic depth is (9 − z) / 8; splats at z = 5 and 5.5.
    let mut with_host = |value: f32| {
        for technique in ["flat.two-pass.point", "flat.opaque.point"] {
            pair.technique = crate::reference_common::technique(technique);
            let mut host = vec![0.0; 64];
            host[4 * 8 + 4] = value;
            pair.host = Some(host);
            let p = pair.render();
            assert!(at(&p, 3, 4)[3] > 0.0, "the clear value hides nothing");
            if technique == "flat.opaque.point" {
                return at(&p, 4, 4);
            }
            let expected = match value {
                v if v > 0.5 => [0.0; 4],
                v if v > 0.4375 => [1.0, 0.0, 0.0, 1.0],
                _ => [0.5, 0.0, 0.5, 1.0],
            };
            assert_eq!(at(&p, 4, 4), expected, "{value}");
        }
        unreachable!()
    };
    assert_eq!(with_host(0.0), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(with_host(0.4375), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(with_host(0.4376), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(with_host(0.5), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(with_host(0.5001), [0.0; 4]);
}

#[test]
fn an_edge_on_disk_is_kept_by_the_low_pass() {
    let edge = Small::flat_view().splat([0.5, -0.5, 0.0], [1.0, 0.0, 0.0], 2.0, WHITE);
    assert_eq!(edge.render().rgba.iter().filter(|p| p[3] > 0.0).count(), 0, "no area without it");
    let p = edge.style(|s| s.low_pass = 1.0).render();
    assert_eq!(at(&p, 4, 4)[3], 1.0);
    for (x, y) in [(3, 4), (5, 4), (4, 3), (4, 5)] {
        assert_eq!(at(&p, x, y)[3], 0.125, "rim of ρ");
        assert_eq!(depth_at(&p, x, y), 5.0, "a parallel ray takes the centre's depth");
    }
    assert_eq!(p.rgba.iter().filter(|p| p[3] > 0.0).count(), 5);
    // Nearly edge-on: half a pixel beside the centre the plane is 50 units away; depth is clamped to z_p ± r.
    let tilted = Small::flat_view().splat([0.0, -0.5, 0.0], [1.0, 0.0, 0.01], 2.0, WHITE).style(|s| s.low_pass = 1.0);
    let p = tilted.render();
    assert_eq!((depth_at(&p, 3, 4), depth_at(&p, 4, 4)), (3.0, 7.0));
}

#[test]
fn a_disk_that_starts_behind_the_viewer_is_cut_at_the_near_plane() {
    // A floor y = −0.5 about z = −0.5; near 1. Row y sees the floor at linear depth 0.5 / ((y + ½ − 4) / 4).
    let p =
        Small::wide_view().splat([0.0, -0.5, -0.5], [0.0, 1.0, 0.0], 1.0, WHITE).style(|s| s.low_pass = 1.0).render();
    assert_eq!(p.counts.drawn, 1);
    let t = 4.0f64 / 3.0;
    let u2 = (0.125 * t) * (0.125 * t) + (t - 0.5) * (t - 0.5);
    for x in [3, 4] {
        near(at(&p, x, 5)[3], 2.0 * (-4.0 * u2).exp2(), 1e-12);
        near(depth_at(&p, x, 5), t, 1e-12);
        assert_eq!(at(&p, x, 4)[3], 0.0, "floor beyond the rim");
        assert_eq!(at(&p, x, 6)[3], 0.0, "z = 0.8 is before the near plane");
    }
    // The centre is before the near plane: no low-pass anywhere.
    assert_eq!(p.rgba.iter().filter(|p| p[3] > 0.0).count(), 4);
}

#[test]
fn far_away_perspective_is_orthographic() {
    let mut random = Random(7);
    let mut ortho = Small::flat_view().style(|s| s.low_pass = 1.0);
    for _ in 0..30 {
        let mut r = |a, b| random.range(a, b) as f32;
        let p = [r(-4.0, 4.0), r(-4.0, 4.0), r(-1.0, 1.0)];
        ortho = ortho.splat(p, [r(-1.0, 1.0), r(-1.0, 1.0), r(0.3, 1.0)], r(0.5, 2.0), [r(0.0, 255.0) as u8, 99, 7]);
    }
    let distance = 1e7f64;
    let projection = View::perspective(2.0 * (4.0 / distance).atan(), 1.0, 1.0);
    let view = View::look_at(dvec3(0.0, 0.0, distance), DVec3::ZERO, DVec3::Y, projection, Default::default());
    let (a, b) = (ortho.with(|s| surfel::reference::render(s, 1e-6)), Small { view, ..ortho }.render());
    assert!(a.ties.iter().filter(|t| **t).count() < 4);
    for i in 0..64 {
        // Rays lean by up to 4·10⁻⁷, so u is off by 4·10⁻⁷ · tan (75°) · 3 r / r; weights by 2.8 times that, sums by 30 times.
        for c in 0..4 {
            assert!(a.ties[i] || (a.rgba[i][c] - b.rgba[i][c]).abs() < 2e-4, "{i} {:?} {:?}", a.rgba[i], b.rgba[i]);
        }
        assert!(a.ties[i] || a.depth[i].is_infinite() || (a.depth[i] - 5.0 - b.depth[i] + distance).abs() < 1e-4);
    }
}

/// Covered pixels and weights against points strewn densely over the disk and projected one by one.
#[test]
fn the_exact_footprint_is_the_image_of_the_disk() {
    // Close and tilted; across the near plane, centre in front; across it, centre behind the eye.
    for (p, n, r) in [
        ([0.3, -0.2, -2.0], [0.5, 0.3, 0.4], 0.9),
        ([0.1, -0.4, -1.3], [0.1, 1.0, 0.3], 1.0),
        ([0.0, -0.5, 0.4], [0.2, 1.0, 0.1], 2.5),
    ] {
        let small = Small { width: 24, height: 24, ..Small::wide_view() }.splat(p, n, r, WHITE);
        let picture = small.render();
        let centre = DVec3::from(p.map(|v| v as f64));
        let normal = surfel::structure::octahedral::decode(small.flat.normals.as_ref().unwrap()[0]).unwrap();
        let (t1, t2) = normal.any_orthonormal_pair();
        let matrix = small.view.projection * small.view.view;
        // Of each pixel's nearest sample: distance from the centre [px] and u.
        let mut seen = vec![(0.05, f64::INFINITY); 24 * 24];
        let (rings, spokes) = (1200, 3000);
        for ring in 0..rings {
            for spoke in 0..spokes {
                let u = (ring as f64 + 0.5) / rings as f64;
                let (sin, cos) = (std::f64::consts::TAU * spoke as f64 / spokes as f64).sin_cos();
                let x = centre + u * r as f64 * (cos * t1 + sin * t2);
                let clip = matrix * x.extend(1.0);
                if -x.z < 1.0 {
                    continue;
                }
                let at: DVec2 = (dvec2(clip.x, clip.y) / clip.w * 0.5 + 0.5) * 24.0;
                let pixel = at.floor();
                // Samples lie about 24 px / 1200 = 0.02 px apart along a spoke and 75 px / 3000 along a rim.
                if pixel.min_element() >= 0.0 && pixel.max_element() < 24.0 {
                    let i = (pixel.y * 24.0 + pixel.x) as usize;
                    let off = (at - pixel - 0.5).length();
                    if off < seen[i].0 {
                        seen[i] = (off, u);
                    }
                }
            }
        }
        let mut compared = 0;
        for (i, &(_, u)) in seen.iter().enumerate() {
            let alpha = picture.rgba[i][3];
            // So the nearest one is within 0.02 px, which is 0.02 in u for a half axis of 1 px.
            let slack = 0.02;
            if u < 1.0 - slack {
                let weight = |u: f64| (2.0 * (-4.0 * u * u).exp2()).min(1.0);
                assert!(
                    alpha >= weight(u + slack) - 1e-9 && alpha <= weight((u - slack).max(0.0)) + 0.06,
                    "{i}: {u} {alpha}"
                );
                compared += 1;
            } else if u.is_infinite() && alpha > 0.0 {
                // Only a rim, or the cut at the near plane, may be missed by the samples.
                let rim = alpha < 2.0 * (-4.0 * (1.0 - slack) * (1.0 - slack)).exp2();
                assert!(rim || (picture.depth[i] - 1.0).abs() < 0.05, "{i}: {alpha} without a sample");
            }
        }
        assert!(compared > 30, "{compared}");
    }
}

#[test]
fn the_approximate_ellipse_is_linear_about_the_centre() {
    let splat = |ellipse| {
        // Projected to (8, 8) of 16 px: pixels (8 + i, 8 + j) and (7 − i, 7 − j) mirror each other.
        let small = Small { width: 16, height: 16, ..Small::wide_view() };
        small.splat([0.0, 0.0, -2.0], [0.0, 0.8, 0.6], 0.9, WHITE).style(|s| s.ellipse = ellipse).render()
    };
    let asymmetry = |p: &surfel::reference::Picture| {
        (0..64).map(|i| (at(p, 8 + i % 8, 8 + i / 8)[3] - at(p, 7 - i % 8, 7 - i / 8)[3]).abs()).fold(0.0, f64::max)
    };
    let (exact, approximate) = (splat(Ellipse::Exact), splat(Ellipse::Approximate));
    assert!(asymmetry(&exact) > 0.1 && asymmetry(&approximate) < 1e-12);
    // One pixel is 2/8 = 0.25 at depth 2. Half a pixel right and down: Δ = (0.125, −0.125), the plane 0.8 y + 0.6 ζ = 0 gives
    // ζ = 0.125 · 4/3 towards the viewer; u² = (0.125² + 0.125² + (1/6)²) / 0.81, depth 2 − 1/6.
    let u2 = (2.0 * 0.125 * 0.125 + 1.0 / 36.0) / 0.81;
    assert_eq!(at(&approximate, 8, 8)[3], 1.0);
    near(depth_at(&approximate, 8, 8), 2.0 - 1.0 / 6.0, 2e-4);
    // Two pixels further right: Δx = 0.625.
    near(at(&approximate, 10, 8)[3], 2.0 * (-4.0 * (u2 + (0.625f64.powi(2) - 0.125f64.powi(2)) / 0.81)).exp2(), 1e-3);
}

#[test]
fn weights_on_a_square_grid_of_spacing_r_sum_to_about_one() {
    // One white splat among black ones shows w / Σw, and its w is known.
    let spacing = 2.0;
    let mut grid = Small { width: 64, height: 64, ..Small::flat_view() };
    for i in -4i32..=4 {
        for j in -4i32..=4 {
            let color = if (i, j) == (0, 0) { WHITE } else { [0; 3] };
            grid = grid.splat([spacing * i as f32, spacing * j as f32, 0.0], Z, spacing, color);
        }
    }
    // 64 px over 8 units: 16 px a cell.
    let p = grid.render();
    let (mut low, mut high) = (f64::INFINITY, 0.0f64);
    for y in 24..40 {
        for x in 24..40 {
            let d = dvec2(x as f64 + 0.5 - 32.0, y as f64 + 0.5 - 32.0) / 16.0;
            let sum = (-4.0 * d.length_squared()).exp2() / at(&p, x, y)[0];
            low = low.min(sum);
            high = high.max(sum);
        }
    }
    assert!(low > 0.95 && high < 1.25, "{low} {high}");
    assert!(low < 1.05 && high > 1.15, "{low} {high}: the range is not used");
}

#[test]
fn opaque_discs_and_squares() {
    // r / √2 = 1.556: the diagonal neighbour (√2) is in, two pixels straight are out; a weight never shows.
    let disc = Small::flat_view().splat([0.5, -0.5, 0.0], Z, 2.2, RED).opaque();
    let p = disc.render();
    assert_eq!(p.rgba.iter().filter(|p| **p == [1.0, 0.0, 0.0, 1.0]).count(), 9);
    assert_eq!(at(&p, 6, 4), [0.0; 4]);
    // Nearest wins, of equals the first.
    let disc = disc.splat([0.5, -0.5, 0.0], Z, 2.2, BLUE);
    assert_eq!(at(&disc.render(), 4, 4), [1.0, 0.0, 0.0, 1.0]);
    let disc = disc.splat([0.5, -0.5, 0.001], Z, 2.2, BLUE);
    assert_eq!(at(&disc.render(), 4, 4), [0.0, 0.0, 1.0, 1.0]);
    // Squares of 3 px, of one, and of half a pixel beside every centre; the radius does not matter.
    let count = |x: f32, side: f32| {
        let small = Small::flat_view().splat([x, -0.5, 0.0], Z, 100.0, RED).opaque();
        small.style(|s| s.footprint = Footprint::Pixels(side)).render().rgba.iter().filter(|p| p[3] == 1.0).count()
    };
    assert_eq!((count(0.5, 3.0), count(0.5, 1.0), count(0.0, 1.0), count(0.0, 0.5)), (9, 1, 1, 0));
}
