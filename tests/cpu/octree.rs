//! Blocks of unprocessed scans: nothing lost, nothing twice, and a drawn point near every point that can be seen.

use std::collections::HashSet;

use glam::{DMat4, DVec3, DVec4, Vec3, dvec3};
use surfel::select::{DepthConvention, DrawList, Sight, View};
use surfel::structure::groups::{Groups, Relax};
use surfel::structure::octree::{Options, Preset};
use surfel::structure::{Flat, Octree, octahedral};
use surfel::style::Style;

const PRESETS: [Preset; 5] = [Preset::VboR, Preset::Espt, Preset::Mospt, Preset::RGrid, Preset::Poisson];

/// How large what stands for points that far apart may be at most: for Poisson-disk samples of points of radius `own`
/// √(2 s² + min(own, s)² / 2), and the next of eight levels an octave.
fn largest(preset: Preset, spacing: f64, own: f64) -> f64 {
    if preset == Preset::Poisson {
        0.125f64.exp2() * (2.0 * spacing.powi(2) + 0.5 * own.min(spacing).powi(2)).sqrt()
    } else {
        spacing
    }
}

/// Numbers that are the same everywhere, 0 to 1.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / (1u64 << 31) as f64
    }

    fn vector(&mut self) -> DVec3 {
        dvec3(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

fn flat(points: impl IntoIterator<Item = DVec3>, radius: f32) -> Flat {
    let geometry: Vec<[f32; 4]> = points.into_iter().map(|p| [p.x as f32, p.y as f32, p.z as f32, radius]).collect();
    let colors = Some((0..geometry.len() as u32).map(|i| i | 0xff00_0000).collect());
    let mut cloud = Flat { geometry, colors, ..Flat::default() };
    cloud.blocks = cloud.arranged(surfel::structure::Arrangement::AsRead, |_| 0.0).blocks;
    cloud
}

/// A bumpy sphere, denser at one side, and some points in the air.
pub fn scan(n: usize, seed: u64) -> Flat {
    let mut random = Random(seed);
    let surface = |random: &mut Random| {
        let p = (random.vector() + dvec3(0.4, 0.0, 0.0)).normalize();
        p * (1.0 + 0.1 * (7.0 * p.x).sin() * (5.0 * p.y).cos())
    };
    let points: Vec<DVec3> =
        (0..n).map(|i| if i % 50 == 0 { 1.5 * random.vector() } else { surface(&mut random) }).collect();
    flat(points, 0.01)
}

fn sight(eye: DVec3, target: DVec3, threshold: f32) -> Sight {
    let view = View::look_at(eye, target, DVec3::Z, View::perspective(0.9, 1.0, 1e-3), DepthConvention::Reversed);
    Sight::new(&view, [640, 640], &DMat4::IDENTITY, DVec3::ZERO, &Style { threshold, ..Style::default() })
}

fn options(preset: Preset) -> Options {
    Options { block: 500, ..Options::new(preset) }
}

fn drawn(octree: &Octree, sight: &Sight) -> DrawList {
    let mut list = DrawList::default();
    octree.select(sight, 0, &mut list);
    list
}

fn numbers(list: &DrawList) -> Vec<u32> {
    list.spans.iter().flat_map(|s| s.first..s.first + s.count).collect()
}

/// What is drawn, each of the input's points by its colour: sorted.
fn originals(octree: &Octree, numbers: &[u32]) -> Vec<u32> {
    let colors = octree.flat.colors.as_ref().unwrap();
    let mut found: Vec<u32> = numbers.iter().map(|&i| colors[i as usize] & 0x00ff_ffff).collect();
    found.sort_unstable();
    found
}

#[test]
fn at_full_detail_every_point_is_drawn_once() {
    let cloud = scan(20_000, 1);
    for preset in [Preset::VboR, Preset::Espt, Preset::Mospt, Preset::Poisson] {
        let octree = Octree::build(&cloud, &options(preset));
        let list = drawn(&octree, &sight(dvec3(6.0, 0.5, 0.2), DVec3::ZERO, 1e-6));
        let all: Vec<u32> = (0..20_000).collect();
        assert!(originals(&octree, &numbers(&list)) == all, "{preset}");
        assert_eq!(list.spans.len(), 1, "{preset}: whole blocks are one run");
    }
}

#[test]
fn every_visible_point_has_a_drawn_one_within_its_spacing() {
    let cloud = scan(20_000, 2);
    let mut random = Random(3);
    for preset in PRESETS {
        let octree = Octree::build(&cloud, &options(preset));
        let mut reduced = 0;
        for view in 0..60 {
            let eye = random.vector() * [0.3, 2.0, 8.0, 60.0][view % 4];
            let target = eye + random.vector();
            let threshold = [0.5, 2.0, 10.0][view % 3];
            let sight = sight(eye, target, threshold);
            let list = drawn(&octree, &sight);
            let mut all = numbers(&list);
            assert!(all.iter().all(|&i| (i as usize) < octree.flat.len()), "{preset}");
            if matches!(preset, Preset::Espt | Preset::Mospt | Preset::Poisson) {
                assert!(all.len() <= cloud.len(), "{preset}");
            }
            reduced += (all.len() < cloud.len() / 2) as u32;
            let places: Vec<Vec3> = all.iter().map(|&i| octree.flat.position(i)).collect();
            all.sort_unstable();
            assert!(all.windows(2).all(|w| w[0] < w[1]), "{preset}: nothing twice");
            for i in (0..cloud.len() as u32).step_by(37) {
                let p = cloud.position(i);
                let inside = sight.planes.iter().all(|q| q.truncate().dot(p.as_dvec3()) + q.w > 0.0);
                if inside {
                    // A cell of side s ≤ τ r holds both; a grid moves a point within its cell. What a Poisson-disk sample leaves out
                    // lies within s of a point of it, for which one of a coarser cell may stand.
                    let spacing = sight.tau * (p.as_dvec3() - eye).length();
                    let within = match preset {
                        Preset::Poisson => spacing + (1.0 + sight.tau) * spacing,
                        _ => 3f64.sqrt() * spacing + octree.moved as f64,
                    };
                    let nearest = places.iter().map(|q| q.distance(p)).fold(f32::INFINITY, f32::min);
                    assert!(nearest as f64 <= within * 1.001 + 1e-6, "{preset}, view {view}: {nearest} > {within}");
                }
            }
        }
        assert!(reduced > 20, "{preset}: only {reduced} views show less than half the points");
    }
}

#[test]
fn what_stands_for_others_is_as_large_as_their_spacing() {
    let cloud = scan(20_000, 4);
    for preset in PRESETS {
        let octree = Octree::build(&cloud, &options(preset));
        let sight = sight(dvec3(40.0, 0.0, 0.0), DVec3::ZERO, 4.0);
        let spacing = sight.tau * 42.0;
        let list = drawn(&octree, &sight);
        let least: Vec<f32> = list.spans.iter().map(|s| s.least).filter(|l| *l > 0.0).collect();
        // VBOsR has only whole blocks and what stands for one.
        assert!(preset == Preset::VboR || !least.is_empty(), "{preset}");
        let most = largest(preset, spacing, 0.01) * (1.0 + 1e-6);
        assert!(least.iter().all(|l| (*l as f64) <= most && *l as f64 > spacing / 20.0), "{preset}: {least:?}");
    }
}

#[test]
fn what_stands_for_others_covers_what_they_covered() {
    // In a sparse region a cell may hold two points that lie near each other, and be far smaller than what they cover.
    let places = (0..2000).map(|i| dvec3((i / 2 % 40) as f64, (i / 80) as f64, 0.01 * (i % 2) as f64));
    let cloud = flat(places, 1.0);
    for preset in PRESETS {
        let octree = Octree::build(&cloud, &options(preset));
        let mut averaged = 0;
        for threshold in [0.5, 1.0, 4.0, 30.0] {
            let list = drawn(&octree, &sight(dvec3(20.0, 12.0, 60.0), dvec3(20.0, 12.1, 0.0), threshold));
            for span in &list.spans {
                for i in span.first..span.first + span.count {
                    let radius = octree.flat.geometry[i as usize][3].max(span.least);
                    assert!(radius >= 1.0, "{preset}, {threshold} px: {radius} after {}", span.least);
                }
            }
            averaged += (list.submitted() == 1000 && list.spans.iter().all(|s| s.least < 0.5)) as u32;
        }
        assert!(preset != Preset::Espt || averaged > 0, "pairs are one point");
    }
}

#[test]
fn nothing_outside_the_picture_is_submitted() {
    let cloud = scan(20_000, 5);
    for preset in PRESETS {
        let octree = Octree::build(&cloud, &options(preset));
        assert_eq!(drawn(&octree, &sight(dvec3(6.0, 0.0, 0.0), dvec3(12.0, 0.0, 0.0), 1.0)).submitted(), 0);
        let part = drawn(&octree, &sight(dvec3(2.0, 0.0, 0.0), dvec3(2.0, 1.0, 0.0), 1e-6)).submitted();
        assert!(part < cloud.len() as u64 / 4, "{preset}: {part}");
    }
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let cloud = scan(30_000, 6);
    for preset in PRESETS {
        assert!(Octree::build(&cloud, &options(preset)) == Octree::build(&cloud, &options(preset)), "{preset}");
    }
}

#[test]
fn hard_inputs_lose_nothing() {
    let mut random = Random(7);
    let line = (0..5000).map(|i| dvec3(i as f64, 0.0, 0.0));
    let plane: Vec<DVec3> = (0..5000).map(|_| random.vector() * dvec3(1.0, 1.0, 0.0)).collect();
    let small: Vec<DVec3> = (0..5000).map(|_| random.vector() * 1e-6).collect();
    let large: Vec<DVec3> = (0..5000).map(|_| random.vector() * 1e7).collect();
    let mut broken = flat((0..5000).map(|_| random.vector()), 1.0);
    broken.geometry[17][0] = f32::NAN;
    broken.geometry[18][1] = f32::INFINITY;
    broken.geometry[19][3] = f32::NAN;
    broken.geometry[20][2] = 1e20;
    let clouds = [
        ("none", flat([], 1.0)),
        ("one", flat([DVec3::ONE], 1.0)),
        ("one place", flat(std::iter::repeat_n(DVec3::ONE, 100_000), 1.0)),
        ("a line", flat(line, 1.0)),
        ("a plane", flat(plane, 1.0)),
        ("small", flat(small, 1e-8)),
        ("large", flat(large, 1e5)),
        ("broken", broken),
    ];
    for (name, cloud) in &clouds {
        let [low, high] = cloud.bounds();
        let middle = 0.5 * (low + high);
        for preset in PRESETS {
            let octree = Octree::build(cloud, &options(preset));
            let away = dvec3(3.0, 0.1, 0.2) * (high - low).length().max(1.0);
            let all = drawn(&octree, &sight(middle + away, middle, 1e-9));
            // What lies at one place is one point at any threshold; a grid merges what it cannot tell apart.
            if preset != Preset::RGrid && (low != high || cloud.len() == 1) {
                let found = originals(&octree, &numbers(&all));
                assert!(found == (0..cloud.len() as u32).collect::<Vec<_>>(), "{name}, {preset}");
            }
            assert!(cloud.is_empty() || all.submitted() > 0, "{name}, {preset}");
            assert!(octree.cells.iter().all(|c| c.level <= 21), "{name}, {preset}");
            drawn(&octree, &sight(middle, middle + DVec3::X, 1.0));
            drawn(&octree, &sight(middle + 1e3 * away, middle, 8.0));
        }
    }
}

#[test]
fn culling_drops_nothing_that_is_seen() {
    let mut cloud = scan(8000, 8);
    // Wide splats reach far into the picture from outside.
    cloud.geometry.iter_mut().step_by(50).for_each(|g| g[3] *= 20.0);
    let mut random = Random(9);
    for preset in PRESETS {
        let octree = Octree::build(&cloud, &Options { block: 100, ..options(preset) });
        let mut culled = 0;
        for view in 0..30 {
            let eye = random.vector() * [0.5, 1.5, 4.0][view % 3];
            let lens = View::perspective(0.9, 1.0, 1e-3);
            let view = View::look_at(eye, eye + random.vector(), DVec3::Z, lens, DepthConvention::Reversed);
            let style = Style { threshold: 3.0, ..Style::default() };
            let sight = Sight::new(&view, [640, 640], &DMat4::IDENTITY, DVec3::ZERO, &style);
            let blind = Sight { planes: [DVec4::W; 5], ..sight.clone() };
            let seen = numbers(&drawn(&octree, &sight));
            let kept: HashSet<u32> = seen.iter().copied().collect();
            let clip = view.projection * view.view;
            let mut missing = 0;
            for span in drawn(&octree, &blind).spans {
                for i in (span.first..span.first + span.count).filter(|i| !kept.contains(i)) {
                    missing += 1;
                    let radius = octree.flat.geometry[i as usize][3].max(span.least) as f64;
                    for _ in 0..20 {
                        let rim = random.vector().normalize_or_zero() * 0.9999 * radius;
                        let p = (octree.flat.position(i).as_dvec3() + rim).extend(1.0);
                        let q = clip * p;
                        let inside = q.x.abs() < q.w && q.y.abs() < q.w && -(view.view * p).z > view.near();
                        assert!(!inside, "{preset}: point {i} reaches into the picture");
                    }
                }
            }
            let all = drawn(&octree, &blind).submitted() as usize;
            assert_eq!(seen.len() + missing, all, "{preset}: nothing is drawn for being seen only");
            culled += missing;
        }
        assert!(culled > cloud.len(), "{preset}: {culled}");
    }
}

#[test]
fn points_nearest_to_centres_come_first() {
    // Levels by inserting one point after the other, with swaps (2006, section 4.4).
    let cloud = scan(600, 10);
    let octree = Octree::build(&cloud, &Options { block: 60, ..Options::new(Preset::Mospt) });
    let [low, high] = cloud.bounds();
    let side = (high - low).max_element();
    let mut held = std::collections::HashMap::<(u32, [u64; 3]), u32>::new();
    for i in 0..cloud.len() as u32 {
        let (mut own, mut level) = (i, 0u32);
        loop {
            let n = (1u64 << level) as f64;
            let place = (cloud.position(own).as_dvec3() - low) / side * n;
            let cell = place.to_array().map(|v| v.min(n - 1.0) as u64);
            let centre = low + DVec3::from_array(cell.map(|v| (v as f64 + 0.5) * side / n));
            let Some(other) = held.insert((level, cell), own) else { break };
            let away = |k: u32| cloud.position(k).as_dvec3().distance(centre);
            if away(own) < away(other) {
                own = other;
            } else {
                held.insert((level, cell), other);
            }
            level += 1;
        }
    }
    let mut expected: Vec<(u32, u8)> = held.into_iter().map(|((level, _), i)| (i, level as u8)).collect();
    let colors = octree.flat.colors.as_ref().unwrap();
    let mut found: Vec<(u32, u8)> =
        colors.iter().zip(&octree.levels()).map(|(color, level)| (color & 0x00ff_ffff, *level)).collect();
    expected.sort_unstable();
    found.sort_unstable();
    assert!(found == expected);
}

#[test]
fn every_level_is_a_poisson_disk_sample() {
    // Across blocks: all of them are sampled together.
    let mut cloud = scan(3000, 11);
    cloud.geometry.extend_from_within(..200);
    cloud.colors.as_mut().unwrap().extend_from_within(..200);
    let octree = Octree::build(&cloud, &Options { block: 100, ..Options::new(Preset::Poisson) });
    let [low, high] = cloud.bounds();
    let side = (high - low).max_element();
    let levels = octree.levels();
    let place = |i: usize| octree.flat.position(i as u32);
    assert_eq!(octree.flat.len(), 3200);
    let mut sizes = Vec::new();
    for level in (0..100).step_by(4) {
        // Distances are squared in single floats.
        let spacing = side / (level as f64 / 8.0).exp2();
        let (drawn, left): (Vec<usize>, Vec<usize>) = (0..3200).partition(|&i| levels[i] <= level);
        if spacing <= 0.005 {
            assert_eq!(drawn.len(), 3200, "what is as large as twice the distance stays");
            continue;
        }
        for (n, &i) in drawn.iter().enumerate() {
            let near = drawn[..n].iter().map(|&k| place(k).distance(place(i))).fold(f32::INFINITY, f32::min);
            assert!(near as f64 >= spacing * (1.0 - 1e-6), "level {level}: {near} < {spacing}");
        }
        for i in left {
            let near = drawn.iter().map(|&k| place(k).distance(place(i))).fold(f32::INFINITY, f32::min);
            assert!(near as f64 <= spacing * (1.0 + 1e-6), "level {level}: {near} > {spacing}");
        }
        sizes.push(drawn.len());
    }
    assert!(sizes[0] < 5 && sizes.is_sorted() && sizes.last().is_some_and(|n| (2800..3000).contains(n)), "{sizes:?}");
    let everything = drawn(&octree, &sight(dvec3(6.0, 0.5, 0.2), DVec3::ZERO, 1e-9));
    assert_eq!(everything.submitted(), 3200);
}

#[test]
fn groups_hold_at_every_level() {
    // Points of all levels up to one are drawn together, as large as that level has it; without perspective all blocks are at one.
    let cloud = scan(6000, 12);
    let relax = Relax { factor: 0.6, ..Relax::NONE };
    for preset in [Preset::Mospt, Preset::Poisson] {
        let octree = Octree::build(&cloud, &options(preset));
        let groups = octree.color(&relax).expect("groups");
        assert!(groups.conflicts == 0 && groups.of.len() == octree.flat.len(), "{preset}: {}", groups.conflicts);
        let mut reduced = 0;
        for threshold in [0.5f32, 2.0, 5.0, 8.0, 12.0, 16.0, 24.0, 40.0] {
            let lens = View::orthographic(2.0, 1.0, 0.1, 9.0);
            let view = View::look_at(4.0 * DVec3::X, DVec3::ZERO, DVec3::Z, lens, DepthConvention::Reversed);
            let style = Style { threshold, ..Style::default() };
            let sight = Sight::new(&view, [640, 640], &DMat4::IDENTITY, DVec3::ZERO, &style);
            let list = drawn(&octree, &Sight { planes: [DVec4::W; 5], ..sight });
            let radius = |i: u32, least: f32| octree.flat.geometry[i as usize][3].max(least);
            let cut: Vec<(u32, f32)> = list
                .spans
                .iter()
                .flat_map(|span| (span.first..span.first + span.count).map(|i| (i, radius(i, span.least))))
                .collect();
            assert_eq!(groups.overlaps(&octree.flat, &cut, 0.6).expect("a cut"), 0, "{preset}, {threshold} px");
            let one = Groups { of: vec![0; octree.flat.len()], ..Groups::default() };
            reduced += (cut.len() < 5000
                && one.overlaps(&octree.flat, &cut, 0.6).expect("a cut") > cut.len() as u64 / 2)
                as u32;
        }
        assert!(reduced > 2, "{preset}: {reduced} cuts say something");
    }
}

#[test]
fn averages_are_of_light_and_place() {
    let mut cloud = flat([DVec3::ZERO, dvec3(1.0, 0.5, 0.0)], 0.25);
    cloud.normals = Some([Vec3::X, Vec3::Y].map(octahedral::encode).to_vec());
    cloud.colors = Some(vec![0xff80_8080, 0xffff_ffff]);
    for preset in [Preset::VboR, Preset::Espt] {
        let octree = Octree::build(&cloud, &options(preset));
        let list = drawn(&octree, &sight(dvec3(0.5, 0.0, 1e4), dvec3(0.5, 0.1, 0.0), 1.0));
        let [span] = list.spans[..] else { panic!("one point") };
        assert_eq!((span.count, span.least), (1, 1.0));
        let i = span.first as usize;
        assert_eq!(octree.flat.geometry[i], [0.5, 0.25, 0.0, 1.0]);
        // (0.2159 + 1) / 2 in linear light, 0.8024 encoded.
        assert_eq!(octree.flat.colors.as_ref().unwrap()[i], 0xffcd_cdcd);
        let normal = octahedral::decode(octree.flat.normals.as_ref().unwrap()[i]).expect("a normal");
        assert!(normal.distance(dvec3(1.0, 1.0, 0.0).normalize()) < 1e-4);
    }
}
