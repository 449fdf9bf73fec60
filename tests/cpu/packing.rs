//! Packed points: what every packing keeps, by how much it may be off, and what goes by the decoded values.

use std::sync::Arc;

use glam::{DMat4, DVec3, Vec3};
use surfel::load::synthetic;
use surfel::reference::{self, MARGIN_F32};
use surfel::select::{DepthConvention, DrawList, Sight, View, cut};
use surfel::structure::groups::Relax;
use surfel::structure::octree::{self, Preset};
use surfel::structure::packing::{Packed, RUN, Radii};
use surfel::structure::{Arrangement, Cloud, Flat, Groups, Octree, Packing, Sequential, octahedral, sequential};
use surfel::style::{Interval, Style};
use surfel::technique::Technique;

use crate::groups::soup;

const PACKED: [Packing; 2] = [Packing::Exact, Packing::Quantised];

/// Half a step of 8 bits on the octahedron, see `octahedral`.
const TURN: f64 = 0.0168;

/// A cloud with these attributes.
fn with(flat: &Flat, normals: bool, colors: bool) -> Flat {
    Flat {
        normals: flat.normals.clone().filter(|_| normals),
        colors: flat.colors.clone().filter(|_| colors),
        ..flat.clone()
    }
}

/// Half a step of the run's box along an axis, and the rounding of a sum.
fn position_bound(packed: &Flat, i: usize, axis: usize) -> f64 {
    match &packed.packed {
        Some(Packed::Quantised(points)) => {
            let rounding = packed.position(i as u32)[axis].abs() as f64 * 2f64.powi(-24);
            0.5 * points.frames()[i / RUN].step(axis) as f64 * (1.0 + 1e-12) + rounding
        }
        _ => 0.0,
    }
}

/// Every value of every point within its bound.
fn check(name: &str, flat: &Flat, packing: Packing) -> Flat {
    let packed = flat.clone().packed(packing);
    let factor = packed.packed.as_ref().expect("packed").radii().factor();
    assert_eq!((packed.len(), packed.packing()), (flat.len(), packing), "{name}");
    assert_eq!((packed.has_normals(), packed.has_colors()), (flat.has_normals(), flat.has_colors()), "{name}");
    let exact_colors = packing == Packing::Exact || !flat.has_normals();
    for i in 0..flat.len() {
        let ([x, y, z, r], [a, b, c, s]) = (flat.point(i as u32), packed.point(i as u32));
        for (axis, (was, is)) in [(x, a), (y, b), (z, c)].into_iter().enumerate() {
            // Where nothing is drawn is of no interest.
            let off = if s > 0.0 { (was as f64 - is as f64).abs() } else { 0.0 };
            assert!(off <= position_bound(&packed, i, axis), "{name}, {i}: {was} {is}");
        }
        let apart = (flat.position(i as u32) - packed.position(i as u32)).length();
        let rounding = packed.position(i as u32).length() * f32::EPSILON;
        assert!(s == 0.0 || apart <= packed.position_error(i as u32) + rounding, "{name}, {i}: {apart}");
        assert!(s >= r && s as f64 <= r as f64 * factor, "{name}, {i}: radius {r} is {s}, factor {factor}");
        let [n, m] = [flat, &packed].map(|f| octahedral::decode(f.normal(i as u32)));
        assert_eq!(n.is_some(), m.is_some(), "{name}, {i}");
        assert!(n.zip(m).is_none_or(|(n, m)| n.angle_between(m) < TURN), "{name}, {i}: {n:?} {m:?}");
        let [was, is] = [flat, &packed].map(|f| f.color(i as u32).unwrap_or_default());
        // 64 values 255 / 63 apart, as whole numbers.
        let most = if exact_colors { 0 } else { 2 };
        assert!(was.iter().zip(is).all(|(a, b)| a.abs_diff(b) <= most), "{name}, {i}: {was:?} {is:?}");
    }
    packed
}

#[test]
fn every_value_is_within_its_bound() {
    let flat = soup(1000, 0.3, 2.0, 5);
    for (normals, colors) in [(true, true), (true, false), (false, true), (false, false)] {
        let flat = with(&flat, normals, colors);
        let runs = flat.len().div_ceil(RUN);
        for (packing, bytes) in [
            (Packing::Exact, 16 * 1000 + if normals { 2000 } else { 0 }),
            (Packing::Quantised, 8 * 1000 + if normals && colors { 1000 } else { 0 } + 16 * runs),
        ] {
            let name = format!("{packing}, normals {normals}, colours {colors}");
            let packed = check(&name, &flat, packing);
            assert_eq!(packed.bytes(), bytes as u64, "{name}");
            // Nothing is left of what was there before.
            assert!(packed.geometry.is_empty() && packed.normals.is_none() && packed.colors.is_none());
            // Unpacking has the decoded values.
            let full = packed.unpacked().into_owned();
            let same = |i: u32| {
                (full.point(i), full.normal(i), full.color(i)) == (packed.point(i), packed.normal(i), packed.color(i))
            };
            assert!((0..1000).all(same), "{name}");
            assert_eq!(full.blocks, packed.blocks);
            assert_eq!(packed.clone().packed(Packing::Full), full, "{name}");
        }
    }
    assert_eq!(flat.clone().packed(Packing::Full), flat);
}

#[test]
fn every_color_survives_as_well_as_six_bits_can() {
    let mut flat = soup(256, 0.3, 2.0, 6);
    flat.colors =
        Some((0..256u32).map(|v| u32::from_le_bytes([v as u8, 255 - v as u8, (v as u8) ^ 0x55, 255])).collect());
    let packed = check("all bytes", &flat, Packing::Quantised);
    assert_eq!([packed.color(0), packed.color(255)].map(|c| c.unwrap()[..2].to_vec()), [vec![0, 255], vec![255, 0]]);
    let exact = flat.clone().packed(Packing::Exact);
    assert!((0..256).all(|i| exact.color(i) == flat.color(i)));
}

#[test]
fn radii_are_rounded_up_by_no_more_than_the_factor() {
    for (low, high) in [(1e-3f32, 1e-3f32), (0.1, 0.11), (1e-2, 2.56), (1e-20, 1e20), (f32::MIN_POSITIVE, f32::MAX)] {
        let radii = Radii::of([low, 0.0, f32::NAN, high, f32::INFINITY, -1.0].into_iter());
        assert_eq!(radii.decode(radii.encode(high)), high, "the largest is exact");
        let mut closest = f64::INFINITY;
        for k in 0..=10_000u32 {
            let bits = low.to_bits() + ((high.to_bits() - low.to_bits()) as u64 * k as u64 / 10_000) as u32;
            let r = f32::from_bits(bits);
            let (code, s) = (radii.encode(r), radii.decode(radii.encode(r)));
            assert!(code > 0 && s >= r && s as f64 <= r as f64 * radii.factor(), "{r} is {s} in {radii:?}");
            closest = closest.min(radii.factor() - s as f64 / r as f64);
        }
        // The bound is not much more than what happens: of 10,001 radii in 254 steps one is in the last fortieth of a step.
        assert!(low == high || closest <= (radii.factor() - 1.0) / 2.0, "{closest} {radii:?}");
        for odd in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(radii.decode(radii.encode(odd)), 0.0, "{odd}");
        }
    }
    // Eight octaves.
    assert!(Radii::of([1.0, 256.0].into_iter()).factor() < 1.032);
    assert_eq!(Radii::of([f32::NAN].into_iter()).encode(0.0), 0);
}

#[test]
fn what_cannot_be_drawn_is_not_drawn_and_disturbs_nothing() {
    let flat = soup(600, 0.3, 2.0, 7);
    let odd = [
        (3, 0, f32::NAN),
        (4, 1, f32::INFINITY),
        (5, 2, -2e30),
        (6, 3, 0.0),
        (7, 3, f32::NAN),
        (8, 3, f32::INFINITY),
        (9, 3, -1.0),
    ];
    let mut spoiled = flat.clone();
    odd.iter().for_each(|&(i, k, v)| spoiled.geometry[i][k] = v);
    for packing in PACKED {
        let [clean, packed] = [&flat, &spoiled].map(|f| f.clone().packed(packing));
        for (i, k, v) in odd {
            let point = packed.point(i as u32);
            if packing == Packing::Exact && k < 3 {
                assert_eq!(point[k].to_bits(), v.to_bits(), "a place stays what it was");
            } else {
                assert_eq!(point[3], 0.0, "{packing}, {i}: not drawn");
                assert!(point.iter().all(|v| v.is_finite()), "{packing}, {i}");
            }
        }
        // Beyond the run with the odd points nothing changes, and within it nothing gets worse than its bound.
        for i in 0..600u32 {
            let drawn = odd.iter().all(|(odd, _, _)| *odd as u32 != i);
            let near = (packed.position(i) - flat.position(i)).abs();
            assert!(
                !drawn || (0..3).all(|a| near[a] as f64 <= position_bound(&clean, i as usize, a) + 1e-9),
                "{packing}, {i}"
            );
        }
        assert!(packed.blocks[0].max.max_element() < 10.0 && packed.blocks[0].radius < 1.0, "{:?}", packed.blocks);
    }
}

#[test]
fn degenerate_clouds() {
    let line = |f: &dyn Fn(usize) -> [f32; 4], n: usize| {
        let flat = Flat { geometry: (0..n).map(f).collect(), ..Flat::default() };
        flat.arranged(Arrangement::AsRead, |_| 0.0)
    };
    let clouds = [
        ("none", line(&|_| [0.0; 4], 0)),
        ("one", line(&|_| [3.0, -2.0, 1e7, 0.5], 1)),
        ("all in one place", line(&|_| [0.1, 0.2, 0.3, 0.01], 700)),
        ("on an axis", line(&|i| [i as f32, 5.0, -7.0, 1.0], 700)),
        ("on a diagonal", line(&|i| [i as f32; 4].map(|v| v * 0.1 + 0.05), 513)),
        ("a millionth wide", line(&|i| [1e-6 * (i as f32 * 0.37).sin(), 1e-6 * (i as f32).cos(), 0.0, 1e-8], 300)),
        ("ten million wide", line(&|i| [1e7 * (i as f32 * 0.37).sin(), 1e7 * (i as f32).cos(), 3e6, 5e3], 300)),
        ("nothing that is drawn", line(&|i| [i as f32, 0.0, 0.0, 0.0], 257)),
        ("as far apart as can be", line(&|i| [if i % 2 == 0 { 9e29 } else { -9e29 }, 0.0, i as f32, 1.0], 256)),
    ];
    for (name, flat) in &clouds {
        for packing in PACKED {
            let packed = check(name, flat, packing);
            let spread = ["all in one place", "one", "none"].contains(name);
            assert!(!spread || (0..flat.len() as u32).all(|i| packed.point(i) == flat.point(i)), "{name}, {packing}");
        }
    }
    // Subnormal places are as good as 0, which devices may take them for.
    let tiny = line(&|i| [f32::from_bits(1 + i as u32), 0.0, 0.0, 1.0], 3).packed(Packing::Quantised);
    assert!((0..3).all(|i| tiny.position(i) == Vec3::ZERO));
}

#[test]
fn on_a_surface_errors_are_far_below_the_spacing() {
    let cloud = synthetic::scene("terrain", 60_000, 1).expect("a scene of this name");
    let flat = Flat::new(&cloud);
    for preset in [Preset::VboR, Preset::Mospt, Preset::Espt, Preset::Poisson] {
        let full = Octree::build(&flat, &octree::Options { block: 2000, ..octree::Options::new(preset) });
        let packed = full.clone().packed(Packing::Quantised).flat;
        let mut shares: Vec<f32> = (0..packed.len() as u32)
            .map(|i| (packed.position(i) - full.flat.position(i)).length() / full.flat.point(i)[3])
            .collect();
        shares.sort_by(f32::total_cmp);
        let at = |share: f64| shares[(share * (shares.len() - 1) as f64) as usize];
        // Sixteen points a side of a run's square patch, in 1023 steps or at worst four fifths of them.
        println!("{preset}: half {}, 99 of 100 {}, all {}", at(0.5), at(0.99), at(1.0));
        assert!(at(0.5) < 1.0 / 32.0 && at(0.5) > 1e-4 && at(0.99) < 0.125, "{preset}: {} {}", at(0.5), at(0.99));
    }
}

fn view(eye: DVec3) -> View {
    View::look_at(eye, DVec3::ZERO, DVec3::Y, View::perspective(0.9, 1.0, 0.01), DepthConvention::Reversed)
}

fn trees(flat: &Flat) -> Vec<Cloud> {
    let options = sequential::Options::default();
    let clusters = sequential::Options { clusters: true, ..options };
    let trees = [sequential::Options { blocks: 300, ..options }, clusters, options];
    let octrees = Preset::ALL.iter().map(|(_, preset)| octree::Options { block: 200, ..octree::Options::new(*preset) });
    let octrees = octrees.map(|options| Arc::new(Octree::build(flat, &options)).into());
    trees.iter().map(|options| Arc::new(Sequential::build(flat, options)).into()).chain(octrees).collect()
}

/// A torus in colours.
fn torus() -> Flat {
    let mut cloud = synthetic::scene("torus", 6000, 1).expect("a torus");
    let normals = cloud.normals.as_ref().expect("normals");
    cloud.colors = Some(normals.iter().map(|n| n.to_array().map(|v| (127.5 + 127.0 * v) as u8)).collect());
    cloud.closed = true;
    Flat::new(&cloud)
}

#[test]
fn bounds_and_cuts_of_structures_hold_what_is_decoded() {
    let flat = torus();
    for cloud in trees(&flat) {
        for packing in PACKED {
            let name = format!("{}, {packing}", cloud.structure());
            let packed = cloud.clone().packed(packing);
            assert_eq!((packed.structure(), packed.points()), (cloud.structure(), cloud.points()), "{name}");
            assert!(packed.bytes() < cloud.bytes(), "{name}");
            let points = packed.flat();
            for block in &points.blocks {
                for [x, y, z, r] in (block.first..block.first + block.count).map(|i| points.point(i)) {
                    let p = Vec3::new(x, y, z);
                    assert!(p.cmpge(block.min).all() && p.cmple(block.max).all() && r <= block.radius, "{name}");
                }
            }
            match &packed {
                Cloud::Sequential(tree) => {
                    for list in &tree.lists {
                        for i in list.first..list.first + list.count {
                            let ([x, y, z, r], n) = (points.point(i), octahedral::decode(points.normal(i)));
                            let p = Vec3::new(x, y, z);
                            assert!(p.cmpge(list.min).all() && p.cmple(list.max).all() && r <= list.reach, "{name}");
                            let cone =
                                list.cone.zip(n).is_none_or(|(c, n)| n.dot(c.axis.as_dvec3()) >= c.cosine as f64);
                            assert!(cone, "{name}: a normal outside its cone");
                        }
                    }
                }
                Cloud::Octree(tree) => {
                    let root = tree.cells[0];
                    let all = (0..points.len() as u32).map(|i| points.position(i));
                    assert!(all.clone().all(|p| p.cmpge(root.min).all() && p.cmple(root.max).all()), "{name}");
                    assert_eq!(
                        tree.levels(),
                        match &cloud {
                            Cloud::Octree(tree) => tree.levels(),
                            _ => vec![],
                        }
                    );
                }
                _ => unreachable!("no other structure here"),
            }
            // What is drawn of all entries is in what is submitted, for both tests.
            let Some(nodes) = packed.nodes() else { continue };
            for interval in [Interval::Exact, Interval::Published] {
                let style = Style { threshold: 12.0, interval, ..Style::default() };
                let view = view(glam::dvec3(2.0, 2.5, 3.0));
                let sight = Sight::new(&view, [600, 600], &DMat4::IDENTITY, points.origin, &style);
                let mut list = DrawList::default();
                cut::cut(&packed, &sight, &style, false, 0, &mut list);
                let submitted = |i: u32| list.spans.iter().any(|s| s.first <= i && i < s.first + s.count);
                let test = sight.test();
                let mut selected = 0;
                for i in 0..points.len() as u32 {
                    let drawn = match interval {
                        Interval::Exact => test.selects(nodes, i as usize),
                        Interval::Published => test.selects_published(nodes, i as usize, points.position(i)),
                    };
                    selected += drawn as usize;
                    assert!(!drawn || submitted(i), "{name}, {interval}: entry {i}");
                }
                assert!(selected > 100 && selected < points.len() / 2, "{name}: {selected}");
            }
        }
    }
}

#[test]
fn the_reference_draws_what_is_decoded() {
    let flat = torus();
    let view = view(glam::dvec3(1.5, 1.0, 2.0));
    let draw = |flat: &Flat| {
        let mut list = DrawList::default();
        list.push(surfel::select::Span { instance: 0, first: 0, count: flat.len() as u32, least: 0.0 });
        let scene = reference::Scene {
            instances: &[reference::Instance::points(flat, DMat4::IDENTITY)],
            list: &list,
            view: &view,
            width: 60,
            height: 40,
            technique: Technique::TWO_PASS,
            style: &Style::default(),
            host_depth: None,
        };
        reference::render(&scene, MARGIN_F32).rgba
    };
    let full = draw(&flat);
    for packing in PACKED {
        let packed = flat.clone().packed(packing);
        let picture = draw(&packed);
        assert!(picture == draw(&packed.unpacked()), "{packing}");
        assert!(picture != full, "{packing}: something was rounded");
    }
}

#[test]
fn what_is_made_of_packed_points_is_made_of_what_is_decoded() {
    let flat = torus();
    let relax = Relax { factor: 0.5, ..Relax::default() };
    for packing in PACKED {
        let packed = flat.clone().packed(packing);
        let full = packed.unpacked().into_owned();
        let options = octree::Options { block: 200, ..octree::Options::new(Preset::Espt) };
        assert_eq!(Octree::build(&packed, &options), Octree::build(&full, &options), "{packing}");
        let [a, b] = [&packed, &full].map(|f| Sequential::build(f, &sequential::Options::default()));
        assert_eq!((a.flat, a.nodes), (b.flat, b.nodes), "{packing}");
        let [groups, same] = [&packed, &full].map(|f| Groups::color(f, &relax).expect("groups"));
        assert_eq!(groups, same, "{packing}");
        let [a, b] = [&packed, &full].map(|f| f.arranged(Arrangement::Morton, |_| 0.0));
        assert_eq!(a, b, "{packing}");
        // Groups stay with their points.
        let grouped = Flat { groups: Some(groups), ..full };
        assert_eq!(grouped.clone().packed(packing).groups, grouped.groups);
    }
}
