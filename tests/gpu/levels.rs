//! Level of detail on the device: what is drawn is what the oracle says, in that order, by every way to be drawn.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, dvec3};
use surfel::load::{PointCloud, synthetic};
use surfel::readback::Picture;
use surfel::select::{DepthConvention, DrawList, Sight, View, cut};
use surfel::standalone::{Offscreen, Options, Shot};
use surfel::structure::groups::{Groups, Relax};
use surfel::structure::nodes::ErrorRule;
use surfel::structure::{Cloud, Flat, Octree, Sequential, octree, sequential};
use surfel::style::{BackFaces, Interval, Style};
use surfel::technique::{Blend, Primitive, Selection, Technique};
use surfel::{FrameStats, Instance};

use crate::against_reference::{Case, SIZE, check};
use crate::vulkan;

/// A torus in colours of its own, in patches that are finer than others.
pub fn colored_torus(points: usize) -> PointCloud {
    let mut cloud = synthetic::scene("torus", points, 1).expect("a torus");
    let normals = cloud.normals.as_ref().expect("normals");
    cloud.colors = Some(normals.iter().map(|n| n.to_array().map(|v| (127.5 + 127.0 * v) as u8)).collect());
    cloud.closed = false;
    cloud
}

fn torus() -> Flat {
    Flat::new(&colored_torus(6000))
}

pub fn tree(flat: &Flat, options: sequential::Options) -> Cloud {
    let mut tree = Sequential::build(flat, &options);
    tree.flat.groups = Some(groups(&tree.flat));
    Arc::new(tree).into()
}

fn blocks(flat: &Flat, preset: octree::Preset) -> Cloud {
    let options = octree::Options { block: 200, ..octree::Options::new(preset) };
    let mut octree = Octree::build(flat, &options);
    octree.flat.groups = Some(groups(&octree.flat));
    Arc::new(octree).into()
}

fn groups(flat: &Flat) -> Groups {
    Groups::color(flat, &Relax { factor: 0.5, limit: 24, ..Relax::default() }).expect("groups")
}

fn trees(flat: &Flat) -> Vec<(&'static str, Cloud)> {
    let options = sequential::Options::default();
    vec![
        ("sequential", tree(flat, sequential::Options { blocks: 300, ..options })),
        ("one list", tree(flat, options)),
        ("split", tree(flat, sequential::Options { rule: ErrorRule::Split, ..options })),
        ("diameter", tree(flat, sequential::Options { rule: ErrorRule::Diameter, ..options })),
        ("one-spt", tree(flat, sequential::Options { rule: ErrorRule::Cell, ..options })),
        ("clusters", tree(flat, sequential::Options { clusters: true, ..options })),
    ]
}

fn all(flat: &Flat) -> Vec<(&'static str, Cloud)> {
    let mut all = trees(flat);
    all.extend(octree::Preset::ALL.iter().map(|(name, preset)| (*name, blocks(flat, *preset))));
    all
}

pub fn perspective() -> View {
    let lens = View::perspective(0.9, SIZE[0] as f64 / SIZE[1] as f64, 0.01);
    View::look_at(dvec3(1.6, 1.1, 1.9), DVec3::ZERO, DVec3::Y, lens, DepthConvention::Reversed)
}

pub fn near() -> View {
    let lens = View::perspective(0.9, SIZE[0] as f64 / SIZE[1] as f64, 0.01);
    View::look_at(dvec3(0.9, 0.5, 0.6), dvec3(0.6, 0.0, 0.0), DVec3::Y, lens, DepthConvention::Reversed)
}

pub fn orthographic() -> View {
    let lens = View::orthographic(2.6, SIZE[0] as f64 / SIZE[1] as f64, 0.1, 20.0);
    View::look_at(dvec3(1.6, 1.1, 1.9), DVec3::ZERO, DVec3::Y, lens, DepthConvention::Reversed)
}

#[test]
fn every_structure_is_the_reference_s_with_every_blend() {
    let flat = torus();
    vulkan::draw(SIZE, true, |off| {
        for (name, cloud) in all(&flat) {
            let id = off.renderer.add(cloud.clone()).expect("a cloud");
            let instances = [(cloud.clone(), Instance { cloud: id, transform: DMat4::IDENTITY })];
            for (v, view) in [("whole", perspective()), ("near", near()), ("orthographic", orthographic())] {
                for (blend, primitive, selection, interval) in [
                    (Blend::TwoPass, Primitive::Point, Selection::Compute, Interval::Exact),
                    (Blend::TwoPass, Primitive::Quad, Selection::Compute, Interval::Exact),
                    (Blend::TwoPass, Primitive::Quad, Selection::Vertex, Interval::Exact),
                    (Blend::Fuzzy, Primitive::Point, Selection::Compute, Interval::Exact),
                    (Blend::Fuzzy, Primitive::Point, Selection::Vertex, Interval::Exact),
                    (Blend::Groups, Primitive::Point, Selection::Compute, Interval::Exact),
                    (Blend::Opaque, Primitive::Point, Selection::Vertex, Interval::Exact),
                ] {
                    let style = Style { threshold: 4.0, interval, ..Style::default() };
                    let technique = Technique { primitive, selection, blend, ..Technique::TWO_PASS };
                    let name = format!("{name}, {v}, {blend} {primitive} {selection}");
                    check(off, &Case::levels(name, &instances, &view, technique, &style));
                }
            }
            off.renderer.remove(id);
        }
    });
}

fn draw(
    off: &mut Offscreen,
    instances: &[Instance],
    view: &View,
    selection: Selection,
    style: &Style,
) -> (Picture, FrameStats) {
    let technique = Technique { selection, ..Technique::default() };
    let (stats, _) = off.draw(&Shot { view, instances, technique, style, count: true }).expect("a frame");
    (off.read().expect("a picture"), stats)
}

/// Numbers of what the oracle draws: every entry of every span tested, one after the other.
fn oracle(cloud: &Cloud, transform: DMat4, view: &View, style: &Style) -> Vec<u32> {
    let list: DrawList = cut::drawn(&[(cloud, transform)], view, SIZE, style);
    list.spans.iter().flat_map(|s| s.first..s.first + s.count).collect()
}

/// A number from 0 to 1.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) as f64 / (1u64 << 31) as f64
}

#[test]
fn compaction_lists_what_the_oracle_says_in_its_order() {
    let flat = torus();
    let place =
        DMat4::from_scale_rotation_translation(DVec3::splat(3.0), DQuat::from_rotation_x(0.4), dvec3(1.0, 2.0, 3.0));
    vulkan::draw(SIZE, true, |off| {
        off.keep_lists = true;
        let mut state = 1;
        for (name, cloud) in trees(&flat) {
            let id = off.renderer.add(cloud.clone()).expect("a cloud");
            let mut reduced = 0;
            for number in 0..12 {
                let mut vector = || dvec3(random(&mut state), random(&mut state), random(&mut state)) * 2.0 - 1.0;
                let eye = vector() * [0.8, 2.0, 9.0, 40.0][number % 4] * 3.0 + dvec3(1.0, 2.0, 3.0);
                let lens = View::perspective(0.9, SIZE[0] as f64 / SIZE[1] as f64, 0.01);
                let target = dvec3(1.0, 2.0, 3.0) + 0.3 * vector();
                let view = View::look_at(eye, target, DVec3::Y, lens, DepthConvention::Reversed);
                let threshold = [0.7, 3.0, 12.0][number % 3];
                let style = Style { threshold, back_faces: BackFaces::Draw, ..Style::default() };
                let instances = [Instance { cloud: id, transform: place }];
                let (listed, stats) = draw(off, &instances, &view, Selection::Compute, &style);
                let numbers: Vec<u32> = stats.lists.concat();
                let expected = oracle(&cloud, place, &view, &style);
                assert!(numbers == expected, "{name}, view {number}: {} and {}", numbers.len(), expected.len());
                reduced += (expected.len() < flat.len() / 2) as u32;
                let interval = stats.culled.expect("counted").interval;
                assert_eq!(interval, stats.points_submitted - numbers.len() as u64, "{name}, view {number}");
                // `fuzzy` depends on the order: the vertex stage draws the same in the same order.
                let (tested, again) = draw(off, &instances, &view, Selection::Vertex, &style);
                assert!(listed.rgba == tested.rgba, "{name}, view {number}: pictures differ");
                assert_eq!((again.points_drawn, again.lists.len()), (stats.points_drawn, 0), "{name}, view {number}");
            }
            assert!(reduced > 3, "{name}: {reduced}");
            off.renderer.remove(id);
        }
    });
}

#[test]
fn runs_that_one_command_draws_are_those_drawn_one_by_one() {
    let flat = torus();
    let mut found = Vec::new();
    for without in [Vec::new(), vec!["multiDraw".to_string()]] {
        let asked = without.is_empty();
        let mut drawn = Vec::new();
        vulkan::draw_with(&Options { without, ..vulkan::options() }, SIZE, true, |off| {
            assert!(asked || !off.standalone().enabled.multi_draw);
            for (name, cloud) in all(&flat) {
                let id = off.renderer.add(cloud).expect("a cloud");
                let instances = &[Instance { cloud: id, transform: DMat4::IDENTITY }];
                for (blend, primitive) in [
                    (Blend::Opaque, Primitive::Point),
                    (Blend::TwoPass, Primitive::Quad),
                    (Blend::Fuzzy, Primitive::Point),
                    (Blend::Groups, Primitive::Point),
                ] {
                    let technique = Technique { blend, primitive, ..Technique::default() };
                    let style = &Style { threshold: 4.0, ..Style::default() };
                    let shot = Shot { view: &near(), instances, technique, style, count: true };
                    let (stats, _) = off.draw(&shot).expect("a frame");
                    let picture = vulkan::digest(&off.read().expect("a picture"));
                    drawn.push((format!("{name}, {blend}"), picture, stats.points_drawn, stats.draw_calls));
                }
                off.renderer.remove(id);
            }
            found.push((off.standalone().enabled.multi_draw, drawn.clone()));
        });
    }
    let [(multi, together), (_, apart)] = &found[..] else { panic!("two devices") };
    for (a, b) in together.iter().zip(apart) {
        assert_eq!((&a.0, a.1, a.2), (&b.0, b.1, b.2), "the same picture");
        assert!(a.3 <= b.3, "{}: {} draw calls, {} one by one", a.0, a.3, b.3);
    }
    let calls = |all: &[(String, u64, Option<u64>, u32)]| all.iter().map(|d| d.3).sum::<u32>();
    assert_eq!(calls(together) < calls(apart), *multi, "{} draw calls, {}", calls(together), calls(apart));
}

#[test]
fn the_published_test_draws_what_its_oracle_does() {
    let flat = torus();
    vulkan::draw(SIZE, true, |off| {
        for (name, cloud) in trees(&flat) {
            let id = off.renderer.add(cloud.clone()).expect("a cloud");
            let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
            let style = Style { threshold: 3.0, interval: Interval::Published, ..Style::default() };
            let exact = Style { interval: Interval::Exact, ..style };
            for selection in [Selection::Vertex, Selection::Compute] {
                let (_, stats) = draw(off, &instances, &perspective(), selection, &style);
                let selected = stats.points_submitted - stats.culled.expect("counted").interval;
                let expected = oracle(&cloud, DMat4::IDENTITY, &perspective(), &style).len() as u64;
                // Roots and sums are rounded by each in its own way: a distance is off by some 10⁻⁶ of itself, and of two
                // thousand entries few lie so near their border.
                assert!(selected.abs_diff(expected) <= 2, "{name}, {selection}: {selected} and {expected}");
                let fewest = oracle(&cloud, DMat4::IDENTITY, &perspective(), &exact).len() as u64;
                assert!(selected + 2 >= fewest, "{name}: no holes");
            }
            off.renderer.remove(id);
        }
    });
}

#[test]
fn lists_that_face_away_are_not_submitted() {
    let mut cloud = synthetic::scene("sphere", 20_000, 1).expect("a sphere");
    cloud.closed = true;
    let flat = Flat::new(&cloud);
    let options = sequential::Options { clusters: true, ..Default::default() };
    let [one, many] = [sequential::Options { clusters: false, ..options }, options].map(|o| tree(&flat, o));
    vulkan::draw(SIZE, true, |off| {
        let drawn: Vec<(Picture, FrameStats)> = [one, many]
            .into_iter()
            .map(|cloud| {
                let id = off.renderer.add(cloud).expect("a cloud");
                let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
                let style = Style { threshold: 0.5, ..Style::default() };
                // A blend whose sums do not depend on the order.
                let technique = Technique { selection: Selection::Compute, ..Technique::TWO_PASS };
                let shot = Shot { view: &perspective(), instances: &instances, technique, style: &style, count: true };
                let (stats, _) = off.draw(&shot).expect("a frame");
                (off.read().expect("a picture"), stats)
            })
            .collect();
        let [(whole, all), (part, less)] = &drawn[..] else { unreachable!("two") };
        assert!(less.points_submitted < all.points_submitted * 3 / 4, "{less:?}\n{all:?}");
        assert_eq!(less.points_drawn, all.points_drawn);
        // The same splats in another order: 64 weights of at most 1 are summed to 64 · 2⁻²⁴, and divided by a sum of at least
        // 1/16: 6·10⁻⁵.
        let far = whole.rgba.iter().flatten().zip(part.rgba.iter().flatten()).map(|(a, b)| (a - b).abs());
        let far = far.fold(0.0, f32::max);
        assert!(far < 1e-4, "{far}");
    });
}

#[test]
fn what_lies_outside_the_picture_costs_nothing() {
    let flat = torus();
    vulkan::draw(SIZE, true, |off| {
        for (name, cloud) in all(&flat).into_iter().chain([("flat", Cloud::from(torus()))]) {
            let id = off.renderer.add(cloud.clone()).expect("a cloud");
            let aside = DMat4::from_translation(dvec3(0.0, 50.0, 0.0));
            let instances = [DMat4::IDENTITY, aside].map(|transform| Instance { cloud: id, transform });
            let style = Style::default();
            let (_, both) = draw(off, &instances, &perspective(), Selection::Compute, &style);
            let (_, one) = draw(off, &instances[..1], &perspective(), Selection::Compute, &style);
            assert!(one.points_submitted > 0, "{name}");
            assert_eq!(both.points_submitted, one.points_submitted, "{name}");
            let sight = Sight::new(&perspective(), SIZE, &aside, cloud.flat().origin, &style);
            let mut list = DrawList::default();
            cut::cut(&cloud, &sight, &style, false, 0, &mut list);
            assert_eq!(list.submitted(), 0, "{name}");
            off.renderer.remove(id);
        }
    });
}
