//! The blend in groups by hand, and against two-pass. Pixel (4, 4) of the flat view has its centre at x = 0.5, y = −0.5.

use glam::{DMat4, Vec3};
use surfel::reference::{Instance, Picture, Scene, render};
use surfel::select::{DrawList, Slabs};
use surfel::structure::flat::Block;
use surfel::style::{Tolerance, Voronoi};
use surfel::technique::Blend;

use crate::reference_common::*;

const VORONOI: [Voronoi; 3] = [Voronoi::Cones, Voronoi::Slabs, Voronoi::Off];

/// Up to 256 splats about depth 5, some of them before and behind others.
fn soup(seed: u64, n: usize) -> Small {
    let mut random = Random(seed);
    let mut scene = Small { width: 40, height: 40, ..Small::flat_view() };
    for _ in 0..n {
        let mut r = |a, b| random.range(a, b) as f32;
        let (p, n) = ([r(-4.0, 4.0), r(-4.0, 4.0), r(-2.0, 2.0)], [r(-1.0, 1.0), r(-1.0, 1.0), r(0.3, 1.0)]);
        scene = scene.splat(p, n, r(0.2, 2.0), [r(0.0, 255.0) as u8, r(0.0, 255.0) as u8, 99]);
    }
    scene.host = Some((0..1600).map(|i| if i % 3 == 0 { random.range(0.3, 0.6) as f32 } else { 0.0 }).collect());
    scene
}

/// Each splat its own group: the winners are all there is, in the order of the groups.
#[test]
fn without_overlap_it_is_two_pass() {
    for (seed, n) in [(1, 60), (2, 60), (3, 256)] {
        let scene = soup(seed, n);
        for margin in [0.0, 1e-4] {
            let picture = |s: &Small| s.with(|s| render(s, margin));
            let two_pass = picture(&scene);
            let of: Vec<u8> = (0..n).map(|i| i as u8).collect();
            for voronoi in VORONOI {
                for overlapping in [false, true] {
                    let groups = scene.clone().groups(of.clone(), overlapping).style(|s| s.voronoi = voronoi);
                    assert!(picture(&groups) == two_pass, "seed {seed}, {voronoi}");
                }
            }
            // In another order of groups the sums round otherwise.
            let backwards = picture(&scene.clone().groups(of.iter().rev().copied().collect(), true));
            assert_eq!((&backwards.depth, &backwards.ties), (&two_pass.depth, &two_pass.ties));
            for (a, b) in backwards.rgba.iter().flatten().zip(two_pass.rgba.iter().flatten()) {
                assert!((a - b).abs() < 1e-13);
            }
        }
    }
}

/// A row of pixels (y = −0.5) at x = −3.5 … 3.5.
fn row(picture: &Picture) -> [[f64; 4]; 8] {
    std::array::from_fn(|x| at(picture, x as u32, 4))
}

fn block(scene: Small) -> Small {
    let block = Block { first: 0, count: scene.flat.len() as u32, min: Vec3::NEG_ONE, max: Vec3::ONE, radius: 1.0 };
    Small { flat: surfel::structure::Flat { blocks: vec![block], ..scene.flat }, ..scene }
}

/// Two coplanar splats of one group at x = −1.5 and x = 2.5, radii 3 and 4 or both 4: which colour each pixel of the row has.
#[test]
fn borders_of_one_plane_are_where_they_are_said_to_be() {
    let colors = |radius: f32, voronoi, absolute: bool, overlapping| {
        let scene = Small::flat_view().splat([-1.5, -0.5, 0.0], Z, radius, RED).splat([2.5, -0.5, 0.0], Z, 4.0, BLUE);
        let scene = block(scene).groups(vec![0, 0], overlapping).style(|s| {
            s.voronoi = voronoi;
            if absolute {
                s.tolerance = Tolerance { absolute: 1.0, relative: 0.0 };
            }
        });
        row(&scene.render()).map(|[r, g, b, a]| {
            assert!(g == 0.0 && a > 0.0 && (r == 0.0) != (b == 0.0), "one of the two, unmixed");
            if r > 0.0 { 'r' } else { 'b' }
        })
    };
    let is = |got: [char; 8], expected: &str| assert_eq!(got.iter().collect::<String>(), expected);
    // The nearest depth: all the same, so the first wherever it reaches, x = 1.5 for radius 3.
    is(colors(3.0, Voronoi::Off, false, true), "rrrrrrbb");
    is(colors(3.0, Voronoi::Cones, false, false), "rrrrrrbb");
    is(colors(3.0, Voronoi::Slabs, false, false), "rrrrrrbb");
    // z + min(ε, r) u with ε = r is the distance from the centre: the border is half way, x = 0.5, where the first wins.
    is(colors(3.0, Voronoi::Cones, false, true), "rrrrrbbb");
    // u alone, in one slab or with one ε for all: (x + 1.5) / 3 = (2.5 − x) / 4 at x = 0.21.
    is(colors(3.0, Voronoi::Slabs, false, true), "rrrrbbbb");
    is(colors(3.0, Voronoi::Cones, true, true), "rrrrbbbb");
    is(colors(4.0, Voronoi::Cones, true, true), "rrrrrbbb");
}

/// A slab's border cuts between two splats a hair apart, cones do not.
#[test]
fn slabs_cut_where_cones_do_not() {
    let scene = |gap: f32, voronoi| {
        let scene = Small::flat_view().splat([-0.5, -0.5, gap], Z, 4.0, RED).splat([1.5, -0.5, -gap], Z, 4.0, BLUE);
        let scene = block(scene).groups(vec![0, 0], true);
        scene.style(|s| (s.voronoi, s.tolerance) = (voronoi, Tolerance { absolute: 1.0, relative: 0.0 }))
    };
    // Depths 3 to 7 in four slabs: a border at 5.
    let slabs =
        scene(0.001, Voronoi::Slabs).with(|s| Slabs::new(s.view, s.style, [(s.instances[0].flat, DMat4::IDENTITY)]));
    assert_eq!((slabs.near, slabs.thickness, slabs.count), (3.0, 1.0, 4));
    let reds = |gap, voronoi| row(&scene(gap, voronoi).render()).iter().filter(|p| p[0] > 0.0).count();
    // Pixels at x = −3.5 … 0.5 are as near to red as to blue; red in front reaches x = 3.5.
    assert_eq!((reds(0.001, Voronoi::Cones), reds(0.001, Voronoi::Off), reds(0.001, Voronoi::Slabs)), (5, 8, 8));
    assert_eq!((reds(-0.001, Voronoi::Cones), reds(-0.001, Voronoi::Off), reds(-0.001, Voronoi::Slabs)), (4, 1, 1));
    // More than ε behind never wins within cones.
    assert_eq!(reds(0.51, Voronoi::Cones), 8);
}

/// A layer shows one splat; what it hides counts for nothing, other layers' do, and the host takes no part in a layer.
#[test]
fn only_winners_count() {
    let splat = |scene: Small, z: f32, color| scene.splat([0.5, -0.5, z], Z, 2.0, color);
    let scene = splat(splat(splat(Small::flat_view(), 0.0, RED), 0.5, BLUE), 0.25, WHITE);
    let pixel = |of: [u8; 3], host: f32, y| {
        let scene = scene.clone().groups(of.to_vec(), false);
        at(&Small { host: Some(vec![host; 64]), ..scene }.render(), 4, y)
    };
    assert_eq!(pixel([0, 1, 2], 0.0, 4), [2.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0, 1.0]);
    assert_eq!(pixel([0, 0, 1], 0.0, 4), [0.5, 0.5, 1.0, 1.0]);
    assert_eq!(pixel([0, 0, 0], 0.0, 4), [0.0, 0.0, 1.0, 1.0]);
    // Weights of 1/16 at (4, 6): a loser is not hidden by the front, it is not there.
    assert_eq!(pixel([0, 0, 0], 0.0, 6), [0.0, 0.0, 0.125, 0.125]);
    // The host at depth 4.6 hides the white winner of the second layer, at 4.75; at 4.4 everything.
    assert_eq!(pixel([0, 0, 1], 0.55, 6), [0.0, 0.0, 1.0, 1.0]);
    assert_eq!(pixel([0, 0, 0], 0.575, 6), [0.0; 4]);
    // Red before the host at 4.9 and blue, behind it in space, wins its layer by cones: nothing of the layer is left.
    let cones = Small::flat_view().splat([0.5, -0.5, -0.5], Z, 2.0, BLUE).splat([0.5, 1.5, 0.5], Z, 2.0, RED);
    let cones = cones.groups(vec![0, 0], true).style(|s| s.tolerance = Tolerance { absolute: 4.0, relative: 0.0 });
    assert_eq!(at(&cones.render(), 4, 4)[0], 0.0);
    assert_eq!(at(&Small { host: Some(vec![0.5; 64]), ..cones }.render(), 4, 4), [0.0; 4]);
}

#[test]
fn ties_by_hand() {
    let pair = |z: f32, of: &[u8], overlapping| {
        let scene = Small::flat_view().splat([0.5, -0.5, 0.0], Z, 2.2, RED).splat([0.5, -0.5, z], Z, 2.2, BLUE);
        let scene = block(scene).groups(of.to_vec(), overlapping);
        scene.style(|s| s.tolerance = Tolerance { absolute: 0.5, relative: 0.0 })
    };
    let three = |z: f32| {
        let scene = pair(0.0, &[0, 0], false).splat([0.5, -0.5, z], Z, 2.2, WHITE);
        scene.groups(vec![0, 0, 1], false)
    };
    let slabs = |scene: Small| scene.style(|s| s.voronoi = Voronoi::Slabs);
    for (name, scene, expected) in [
        ("equal keys", pair(0.0, &[0, 0], false), true),
        ("equal depths, two layers", pair(0.0, &[0, 1], false), false),
        ("nearest", pair(0.001, &[0, 0], false), false),
        ("equal cones", pair(0.0, &[0, 0], true), true),
        ("beside a slab's border", slabs(pair(0.001, &[0, 0], true)), true),
        ("slabs apart", slabs(pair(1.01, &[0, 0], true)), false),
        ("tolerance met", pair(-0.5, &[0, 1], false), true),
        ("within it", pair(-0.49, &[0, 1], false), false),
        ("beyond it", pair(-0.51, &[0, 1], false), false),
        ("tolerance met in one layer", pair(-0.5, &[0, 0], false), false),
        ("equal keys, hidden", three(0.6), false),
        ("equal keys, not quite hidden", three(0.5), true),
    ] {
        let tie = |margin| scene.with(|s| render(s, margin)).ties[4 * 8 + 4];
        assert_eq!(tie(1e-6), expected, "{name}");
        assert!(!tie(0.0), "{name}, without margin");
    }
    // Half way between two centres in a slab both are equal, beside it not.
    let apart = Small::flat_view().splat([-0.5, -0.5, 0.5], Z, 4.0, RED).splat([1.5, -0.5, 0.5], Z, 4.0, BLUE);
    for voronoi in [Voronoi::Cones, Voronoi::Slabs] {
        let scene = block(apart.clone()).groups(vec![0, 0], true).style(|s| s.voronoi = voronoi);
        let ties = scene.with(|s| render(s, 1e-6)).ties;
        assert_eq!((3..6).map(|x| ties[4 * 8 + x]).collect::<Vec<_>>(), [false, true, false]);
    }
}

/// Keys that differ by less than what u alone is off by: at pixel (4, 4) red is as near as blue, but for `nudge`.
#[test]
fn u_has_an_error_of_its_own() {
    let margin = 1e-5;
    let tie = |nudge: f64, voronoi, absolute| {
        let blue = [1.5 + nudge as f32, -0.5, 0.5];
        let scene = Small::flat_view().splat([-0.5, -0.5, 0.5], Z, 4.0, RED).splat(blue, Z, 4.0, BLUE);
        let scene = block(scene).groups(vec![0, 0], true);
        let scene = scene.style(|s| (s.voronoi, s.tolerance) = (voronoi, Tolerance { absolute, relative: 1.0 }));
        scene.with(|s| render(s, margin)).ties[4 * 8 + 4]
    };
    // du ≈ margin · (4.5 + 1) / 4 each, so r u, r = 4, is off by 11 margins for both, r by 2, z by 20 or less; the nudge is
    // itself in r u, whatever the tolerance.
    for absolute in [0.0, 100.0] {
        assert!(tie(26.0 * margin, Voronoi::Cones, absolute));
        assert!(!tie(45.0 * margin, Voronoi::Cones, absolute));
    }
    // Four slabs: keys off by half a margin from rounding them, and by 0.35 for each u; the nudge is a sixteenth.
    assert!(tie(14.4 * margin, Voronoi::Slabs, 0.0));
    assert!(!tie(40.0 * margin, Voronoi::Slabs, 0.0));
}

#[test]
#[should_panic(expected = "Groups::color makes them")]
fn a_cloud_without_groups_is_refused() {
    let (with, without) = (soup(1, 3).groups(vec![0, 1, 2], false), soup(1, 3));
    with.with(|scene| {
        let instances = [scene.instances[0], Instance::points(&without.flat, DMat4::IDENTITY)];
        render(&Scene { instances: &instances, list: &DrawList::all([3]), ..*scene }, 0.0)
    });
}

#[test]
#[should_panic(expected = "group 1 of 1")]
fn a_group_beyond_the_count_is_refused() {
    let mut scene = soup(1, 3).groups(vec![0, 1, 0], false);
    scene.flat.groups.as_mut().unwrap().count = 1;
    scene.blend(Blend::Groups).render();
}
