//! The fuzzy blend by hand, and what the order of splats does to it. Pixel (4, 4) of the flat view has its centre at
//! x = 0.5, y = −0.5; splats at z are at depth 5 − z.

use glam::DVec4;
use surfel::reference::{MARGIN_F32, render};
use surfel::style::{Front, Tolerance};
use surfel::technique::Blend;

use crate::reference_common::*;
use crate::reference_oracle::oracle;

/// Splats that face the viewer over pixel (4, 4), weight 1, with these depths before z = 0 and colours.
fn stack(splats: &[(f32, [u8; 3])]) -> Small {
    let scene = splats.iter().fold(Small::flat_view(), |s, &(z, color)| s.splat([0.5, -0.5, z], Z, 2.0, color));
    scene.blend(Blend::Fuzzy).style(|s| s.tolerance = Tolerance { absolute: 1.0, relative: 0.0 })
}

fn first(scene: Small) -> Small {
    scene.style(|s| s.front = Front::First)
}

const GREEN: [u8; 3] = [0, 255, 0];

#[test]
fn the_rule_by_hand() {
    let pixel = |scene: Small| (at(&scene.render(), 4, 4), depth_at(&scene.render(), 4, 4));
    let (red, purple) = ([1.0, 0.0, 0.0, 1.0], [0.5, 0.0, 0.5, 1.0]);
    for change in [|s| s, first] {
        let pixel = |splats: &[(f32, [u8; 3])]| pixel(change(stack(splats)));
        assert_eq!(pixel(&[(0.0, RED)]), (red, 5.0));
        // Both borders of the band count as in it.
        assert_eq!(pixel(&[(0.0, RED), (-1.0, BLUE)]).0, purple);
        assert_eq!(pixel(&[(0.0, RED), (-1.001, BLUE)]), (red, 5.0));
        assert_eq!(pixel(&[(-1.0, BLUE), (0.0, RED)]).0, purple);
        assert_eq!(pixel(&[(-1.001, BLUE), (0.0, RED)]), (red, 5.0));
    }
    // Where the front is.
    let near_last = stack(&[(0.0, RED), (0.5, BLUE)]);
    assert_eq!(pixel(near_last.clone()), (purple, 4.5));
    assert_eq!(pixel(first(near_last)), (purple, 5.0));
    // Behind the nearer by more than ε, before the first by less.
    let drift = stack(&[(0.0, BLUE), (0.9, RED), (-0.9, BLUE)]);
    assert_eq!(pixel(drift.clone()).0, purple);
    assert_eq!(pixel(first(drift)).0[2], 2.0 / 3.0);
}

/// Each splat 0.9 ε in front of the one before. As published zd stays until a splat lies more than ε before it: that is
/// every second one. Where zd follows, each is within ε of it, and none ever replaces: the sum reaches back as far as the
/// stairs do.
#[test]
fn a_staircase_drifts() {
    let colors = [RED, GREEN, BLUE];
    for (steps, published) in [(4, 2), (5, 1), (6, 2)] {
        let stairs = stack(&(0..steps).map(|i| (0.9 * i as f32 - 3.0, colors[i % 3])).collect::<Vec<_>>());
        for (scene, summed) in [(first(stairs.clone()), published), (stairs.clone(), steps)] {
            let got = at(&scene.render(), 4, 4);
            let mut expected = [0.0, 0.0, 0.0, 1.0];
            (steps - summed..steps).for_each(|i| expected[i % 3] += 1.0 / summed as f64);
            assert!((DVec4::from(got) - DVec4::from(expected)).abs().max_element() < 1e-15, "{got:?} {expected:?}");
        }
        // From front to back there is nothing to drift: the first two.
        let mut splats: Vec<(f32, [u8; 3])> = (0..steps).map(|i| (-0.9 * i as f32, colors[i % 3])).collect();
        splats.truncate(steps);
        for scene in [stack(&splats), first(stack(&splats))] {
            assert_eq!(at(&scene.render(), 4, 4), [0.5, 0.5, 0.0, 1.0]);
        }
    }
}

/// ε is the incoming splat's where it replaces, the front's where it is tested.
#[test]
fn each_splat_has_its_own_tolerance() {
    let pair = |a: (f32, f32), b: (f32, f32)| {
        let scene = Small::flat_view().splat([0.5, -0.5, a.0], Z, a.1, RED).splat([0.5, -0.5, b.0], Z, b.1, BLUE);
        at(&scene.blend(Blend::Fuzzy).render(), 4, 4)
    };
    let (red, blue, both) = ([1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0], [0.5, 0.0, 0.5, 1.0]);
    // Radii are tolerances. A wide front lets a narrow splat in behind it, a narrow one no wide splat.
    assert_eq!((pair((0.0, 2.0), (-1.0, 0.5)), pair((0.0, 0.5), (-1.0, 2.0))), (both, red));
    // In the other order the same: a wide splat joins a narrow one behind it, a narrow one replaces it.
    assert_eq!((pair((-1.0, 0.5), (0.0, 2.0)), pair((-1.0, 2.0), (0.0, 0.5))), (both, blue));
}

#[test]
fn the_host_and_what_is_replaced_make_rims_solid() {
    // At (4, 6) the splat's rim: weight 1/16.
    let rim = |host: f32, splats: &[(f32, [u8; 3])]| {
        let mut scene = stack(splats);
        scene.host = Some(vec![host; 64]);
        at(&scene.render(), 4, 6)
    };
    // Reversed orthographic depth is (9 − z) / 8: the host at 5.5, at 5, at 4.9.
    assert_eq!(rim(0.0, &[(0.0, WHITE)]), [0.125; 4]);
    assert_eq!(rim(0.4375, &[(0.0, WHITE)]), [0.125; 4]);
    assert_eq!(rim(0.5, &[(0.0, WHITE)]), [0.125; 4]);
    assert_eq!(rim(0.5125, &[(0.0, WHITE)]), [0.0; 4], "nothing but what the host hides");
    // A second behind the host, behind the front, or replaced.
    assert_eq!(rim(0.4375, &[(0.0, WHITE), (-0.6, RED)]), [1.0; 4]);
    assert_eq!(rim(0.0, &[(0.0, WHITE), (-1.1, RED)]), [1.0; 4]);
    assert_eq!(rim(0.0, &[(-1.1, RED), (0.0, WHITE)]), [1.0; 4]);
    // The host's depth takes part in no replacement: limit and band stay as they are.
    assert_eq!(rim(0.4375, &[(0.0, WHITE), (-0.5, WHITE)]), [0.25; 4]);
}

/// A soup of splats about depth 5, and a wall of the host's in every third pixel.
fn soup(seed: u64, n: usize, spread: f64) -> Small {
    let mut random = Random(seed);
    let mut scene = Small { width: 40, height: 40, ..Small::flat_view() }.blend(Blend::Fuzzy);
    for _ in 0..n {
        let mut r = |a, b| random.range(a, b) as f32;
        let (p, n) = ([r(-4.0, 4.0), r(-4.0, 4.0), r(-spread, spread)], [r(-1.0, 1.0), r(-1.0, 1.0), r(0.3, 1.0)]);
        scene = scene.splat(p, n, r(0.2, 2.0), [r(0.0, 255.0) as u8, r(0.0, 255.0) as u8, 99]);
    }
    scene.host = Some((0..1600).map(|i| if i % 3 == 0 { random.range(0.3, 0.6) as f32 } else { 0.0 }).collect());
    scene
}

/// The same splats in another order.
fn shuffled(scene: &Small, seed: u64) -> Small {
    let (mut random, mut scene) = (Random(seed), scene.clone());
    for i in (1..scene.flat.len()).rev() {
        let j = random.range(0.0, i as f64 + 1.0) as usize;
        scene.flat.geometry.swap(i, j);
        scene.flat.normals.as_mut().unwrap().swap(i, j);
        scene.flat.colors.as_mut().unwrap().swap(i, j);
    }
    scene
}

#[test]
fn every_order_is_replayed() {
    for seed in 1..=4 {
        for change in [|s| s, first] {
            let mut pictures: Vec<Vec<[f64; 4]>> = vec![];
            for order in 0..4 {
                let scene = change(shuffled(&soup(seed, 60, 2.0), order));
                let picture = scene.render();
                for (i, (color, depth)) in scene.with(oracle).into_iter().enumerate() {
                    let error = (DVec4::from(picture.rgba[i]) - color).abs().max_element();
                    let same_depth = depth == picture.depth[i] || (depth - picture.depth[i]).abs() < 1e-9;
                    assert!(error < 1e-9 && same_depth, "{seed}, {order}, {i}: {:?} {color}", picture.rgba[i]);
                }
                pictures.push(picture.rgba);
            }
            let differ = (0..1600).filter(|&i| pictures.iter().any(|p| p[i] != pictures[0][i])).count();
            assert!(differ > 160, "the order changes only {differ} pixels");
        }
    }
}

/// Where all depths of a pixel lie within every tolerance nothing is replaced and only the host hides: two-pass, to the
/// last bit, whatever the order.
#[test]
fn in_one_band_it_is_two_pass() {
    for seed in 1..=4 {
        let scene = soup(seed, 60, 2.0).style(|s| s.tolerance = Tolerance { absolute: 20.0, relative: 0.0 });
        let scene = shuffled(&scene, seed);
        let two_pass = scene.clone().blend(Blend::TwoPass).render();
        assert!(scene.render() == two_pass);
        assert!(first(scene.clone()).render().rgba == two_pass.rgba);
        // Also what rounding may change.
        assert!(scene.with(|s| render(s, 1e-4)) == scene.clone().blend(Blend::TwoPass).with(|s| render(s, 1e-4)));
    }
}

#[test]
fn ties_by_hand() {
    let host = |value: f32, scene: Small| Small { host: Some(vec![value; 64]), ..scene };
    let tolerance = |absolute: f32, splats: &[(f32, [u8; 3])]| {
        stack(splats).style(|s| s.tolerance = Tolerance { absolute, relative: 0.0 })
    };
    let border = [(-0.5, RED), (-1.0, BLUE)];
    for (name, scene, expected) in [
        ("alone", stack(&[(0.0, RED)]), false),
        ("tolerance met, from the front", tolerance(0.5, &border), true),
        ("within it", tolerance(0.51, &border), false),
        ("beyond it", tolerance(0.49, &border), false),
        ("tolerance met, from the back", tolerance(0.5, &[(-1.0, BLUE), (-0.5, RED)]), true),
        ("met, then behind a third", tolerance(0.5, &[border[0], border[1], (0.5, RED)]), false),
        ("met, then beside a third", tolerance(0.5, &[border[0], border[1], (-0.25, RED)]), true),
        ("met, and a third between", tolerance(0.5, &[border[0], (-0.75, RED), border[1]]), true),
        ("met behind what was there", tolerance(0.5, &[(0.5, RED), border[0], border[1]]), false),
        ("at the host's depth", host(0.5, stack(&[(0.0, RED)])), true),
        ("behind the host's depth", host(0.51, stack(&[(0.0, RED)])), false),
        ("before the host's depth", host(0.49, stack(&[(0.0, RED)])), false),
        ("at the host's depth, behind a front", host(0.5, stack(&[(2.0, RED), (0.0, RED)])), false),
        ("at the host's depth, then replaced", host(0.5, stack(&[(0.0, RED), (2.0, RED)])), false),
        ("on the near plane", stack(&[(4.0, RED)]), true),
    ] {
        let tie = |margin| scene.with(|s| render(s, margin)).ties[4 * 8 + 4];
        assert_eq!(tie(1e-6), expected, "{name}");
        assert!(!tie(0.0), "{name}, without margin");
    }
    // Whether the first is there at all decides whether a rim is soft: (4, 6) is a rim of weight 1/16.
    let replaced = |splats| host(0.5, stack(splats)).with(|s| render(s, 1e-6)).ties[6 * 8 + 4];
    assert!(replaced(&[(0.0, RED), (2.0, RED)]), "the host's depth may have hidden it");
    assert!(!stack(&[(2.0, RED)]).with(|s| render(s, MARGIN_F32)).ties[5 * 8 + 5]);
}

/// A tolerance of 4 between depths 3 and 7: the depths are off by 6 and 14 margins, the tolerance by 12.
#[test]
fn the_tolerance_has_an_error_of_its_own() {
    let margin = 1e-5;
    for (beyond, expected) in [(26.0, true), (40.0, false), (-26.0, true), (-40.0, false)] {
        let mut splats = vec![(2.0, RED), (-2.0 - (beyond * margin) as f32, BLUE)];
        for _ in 0..2 {
            let scene = stack(&splats).style(|s| s.tolerance = Tolerance { absolute: 4.0, relative: 0.0 });
            assert_eq!(scene.with(|s| render(s, margin)).ties[4 * 8 + 4], expected, "{beyond} margins, {splats:?}");
            splats.reverse();
        }
    }
}

/// What was replaced has no part in it.
#[test]
fn sensitivity_is_that_of_what_is_summed() {
    let sensitivity = |scene: Small| scene.with(|s| render(s, 1e-6)).sensitivity[6 * 8 + 4];
    let front = (2.0, WHITE);
    let (alone, replaced) = (stack(&[(-3.0, RED), front]), stack(&[(0.0, RED), (-0.5, RED), front]));
    // The rim's slope over its weight: 8 ln 2 a radius, of 2 px.
    assert!((sensitivity(alone.clone()) - 4.0 * 2f64.ln()).abs() < 1e-9);
    assert_eq!(sensitivity(replaced), sensitivity(alone));
}
