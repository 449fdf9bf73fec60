//! Level of detail: what structures save, against drawing every point (OneVBO) in the same rounds.
//!
//! Three parts, each with its table:
//! 1. The viewpoints of paper 002 (distance, border, centre; direction 30° of azimuth) on every structure, beside the published
//!    frames a second in units of OneVBO's (its table 1); at `distance` also points a covered pixel, and the frame against
//!    drawing as many bare points: squares of the mean footprint's side (octrees, where selection tells the radii), and of a pixel.
//! 2. Seeded views inside and around, the default structure against OneVBO.
//! 3. A surface whose million points are already sub-pixel, with sixteen million.
//!
//! Frame times of `opaque` without light, from the start of recording to the device's completion; `--fuzzy` takes that blend.
//! `cargo bench --bench levels` makes a terrain of two million points; `-- SCAN...` takes files,
//! `--structures=A,B` some only, `--views=N` so many seeded views; `-- --test` runs once, small.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use glam::{DMat4, DVec3, dvec3};
use surfel::ash::vk;
use surfel::load::{self, Bounds, PointCloud, attributes, synthetic};
use surfel::measure::{Summary, published};
use surfel::select::{DepthConvention, DrawList, Sight, View};
use surfel::standalone::{Offscreen, Options, Shot, Standalone, bare};
use surfel::structure::nodes::ErrorRule;
use surfel::structure::{Cloud, Flat, Octree, Sequential, octree, sequential};
use surfel::style::{Shading, Style};
use surfel::technique::{Blend, Structure, Technique};
use surfel::{CloudId, FrameStats, Instance};

/// The structure of the second part: of those that keep every point as it is, the fastest.
const DEFAULT: Structure = Structure::Poisson;

struct Bench {
    off: Offscreen,
    technique: Technique,
    side: u32,
    rounds: usize,
}

fn build(flat: &Arc<Flat>, structure: Structure) -> Cloud {
    let octree = |preset| Arc::new(Octree::build(flat, &octree::Options::new(preset))).into();
    let tree = |rule, blocks| {
        let options = sequential::Options { rule, blocks, ..Default::default() };
        Arc::new(Sequential::build(flat, &options)).into()
    };
    match structure {
        Structure::VboR => octree(octree::Preset::VboR),
        Structure::Espt => octree(octree::Preset::Espt),
        Structure::Mospt => octree(octree::Preset::Mospt),
        Structure::RGrid => octree(octree::Preset::RGrid),
        Structure::Poisson => octree(octree::Preset::Poisson),
        Structure::Sequential => tree(ErrorRule::Geometric, 10_000),
        Structure::OneSpt => tree(ErrorRule::Cell, 0),
        Structure::SptR => tree(ErrorRule::Cell, 10_000),
        _ => Arc::clone(flat).into(),
    }
}

fn style() -> Style {
    Style { shading: Shading::None, ..Style::default() }
}

fn projection(bounds: &Bounds) -> glam::DMat4 {
    View::perspective(45f64.to_radians(), 1.0, 1e-4 * bounds.radius)
}

fn facing(eye: DVec3, back: DVec3, bounds: &Bounds) -> View {
    View::facing(eye, back.normalize(), DVec3::Z, projection(bounds), DepthConvention::Reversed)
}

/// The named views, as `surfel render --view` has them.
fn named(bounds: &Bounds) -> [(&'static str, View); 3] {
    let (azimuth, elevation) = (30f64.to_radians(), 20f64.to_radians());
    let level = dvec3(azimuth.sin(), -azimuth.cos(), 0.0);
    let back = level * elevation.cos() + DVec3::Z * elevation.sin();
    let (middle, half) = (0.5 * (bounds.robust_min + bounds.robust_max), 0.5 * (bounds.robust_max - bounds.robust_min));
    let far = half.length() / (0.5 * 22.5f64.to_radians().tan()).atan().sin();
    let leave = (half / level.abs().max(DVec3::splat(1e-9))).min_element();
    [
        ("distance", facing(middle + far * back, back, bounds)),
        ("border", facing(middle + leave * level, level, bounds)),
        ("centre", facing(middle, level, bounds)),
    ]
}

/// Inside and around: a third each within the box, near it, and far.
fn seeded(bounds: &Bounds, number: u64) -> View {
    let mut state = number.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1u64 << 31) as f64
    };
    let mut vector = || dvec3(unit(), unit(), unit()) * 2.0 - 1.0;
    let (middle, half) = (0.5 * (bounds.robust_min + bounds.robust_max), 0.5 * (bounds.robust_max - bounds.robust_min));
    let eye = match number % 3 {
        0 => middle + half * vector(),
        1 => middle + half.length() * 1.2 * vector().normalize(),
        _ => middle + half.length() * 4.0 * vector().normalize(),
    };
    let target = middle + 0.5 * half * vector();
    facing(eye, eye - target, bounds)
}

/// Root of the mean squared side of the footprints that an octree submits, in whole pixels.
fn footprint(built: &Cloud, view: &View, side: u32, blend: Blend) -> Option<f32> {
    let Cloud::Octree(octree) = built else { return None };
    let mut list = DrawList::default();
    let style = style();
    octree.select(&Sight::new(view, [side; 2], &DMat4::IDENTITY, octree.flat.origin, &style), 0, &mut list);
    // `opaque` draws discs of r / √2.
    let focal = view.focal(side as f64) * if blend == Blend::Opaque { 0.5f64.sqrt() } else { 1.0 };
    let sides = list.spans.iter().flat_map(|span| (span.first..span.first + span.count).map(|i| (i, span.least)));
    let squares = sides.map(|(i, least)| {
        let [x, y, z, r] = octree.flat.point(i);
        let p = octree.flat.origin + dvec3(x as f64, y as f64, z as f64);
        let depth = -view.right_handed().view.transform_point3(p).z;
        (2.0 * (r.max(least) as f64 * focal / depth).max(style.low_pass as f64)).powi(2)
    });
    Some((squares.sum::<f64>() / list.submitted().max(1) as f64).sqrt().round() as f32)
}

impl Bench {
    fn frame(&mut self, cloud: CloudId, view: &View, count: bool) -> (FrameStats, f64, f64) {
        let instances = [Instance { cloud, transform: DMat4::IDENTITY }];
        let shot = Shot { view, instances: &instances, technique: self.technique, style: &style(), count };
        let (stats, times) = self.off.draw(&shot).expect("a frame");
        (stats, times.frame, times.prepare)
    }

    /// One view: counts, then medians of rounds in which both are drawn.
    fn compare(&mut self, flat: CloudId, other: CloudId, view: &View, rounds: usize) -> Compared {
        self.frame(flat, view, false);
        let (stats, ..) = self.frame(other, view, true);
        let covered = self.off.read().expect("a picture").coverage() * (self.side * self.side) as f64;
        let (mut ms, mut all_ms, mut ratios, mut prepare) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for _ in 0..rounds {
            let all = self.frame(flat, view, false).1;
            let (_, own, prepared) = self.frame(other, view, false);
            ms.push(own);
            all_ms.push(all);
            prepare.push(prepared);
            ratios.push(all / own);
        }
        let of = |v: &[f64]| Summary::of(v).expect("rounds");
        Compared { stats, covered, ms: of(&ms), all_ms: of(&all_ms), ratio: of(&ratios), prepare: of(&prepare) }
    }

    fn scan(&mut self, name: &str, cloud: &PointCloud, structures: &[Structure], views: u64) {
        let bounds = Bounds::of(cloud).expect("points");
        let flat = Arc::new(Flat::new(cloud));
        let points = flat.len();
        let id = self.off.renderer.add(Arc::clone(&flat)).expect("a cloud");
        println!("\n{name}, {points} points, {0} x {0} px, {1}", self.side, self.technique.blend);
        println!(
            "  structure    view      submitted      drawn    ms (quartiles)            x OneVBO (quartiles)    published  prepare"
        );
        for &structure in structures {
            let start = Instant::now();
            let built = build(&flat, structure);
            let rate = points as f64 / start.elapsed().as_secs_f64() * 1e-6;
            let bytes = built.bytes() as f64 / points as f64;
            let other = self.off.renderer.add(built.clone()).expect("a cloud");
            for (v, (view_name, view)) in named(&bounds).iter().enumerate() {
                let c = self.compare(id, other, view, self.rounds);
                let published = published::speedup(structure, v);
                println!(
                    "  {:<12} {view_name:<8} {:>10} {:>10}  {:>8.1} ({:.1} to {:.1}), {:.1}  {:>6.2} ({:.2} to {:.2})  {:>8}  {:.2} ms",
                    structure.name(),
                    c.stats.points_submitted,
                    c.stats.points_drawn.unwrap_or(0),
                    c.ms.median,
                    c.ms.lower,
                    c.ms.upper,
                    c.all_ms.median,
                    c.ratio.median,
                    c.ratio.lower,
                    c.ratio.upper,
                    published.map_or("-".into(), |p| format!("{p:.1}")),
                    c.prepare.median,
                );
                if v == 0 {
                    self.bare(&flat, &built, view, &c);
                }
            }
            println!("  {:<12} built at {rate:.2} M points/s, {bytes:.1} B a point", structure.name());
            self.off.renderer.remove(other);
        }
        if views > 0 {
            let other = self.off.renderer.add(build(&flat, DEFAULT)).expect("a cloud");
            let mut ratios: Vec<f64> = (0..views)
                .map(|number| 1.0 / self.compare(id, other, &seeded(&bounds, number), 3).ratio.median)
                .collect();
            ratios.sort_by(f64::total_cmp);
            let slower = ratios.iter().filter(|r| **r > 1.03).count();
            let middle = ratios[ratios.len() / 2];
            let worst = ratios[ratios.len() - 1];
            println!(
                "  {DEFAULT} over OneVBO, {views} seeded views: median {middle:.3}, worst {worst:.3}, {slower} more than 3 % slower"
            );
            self.off.renderer.remove(other);
        }
        self.off.renderer.remove(id);
    }

    /// As many bare points as the structure submits.
    fn bare(&mut self, flat: &Flat, built: &Cloud, view: &View, c: &Compared) {
        let count = (c.stats.points_submitted as usize).clamp(1, flat.len());
        let step = flat.len() / count;
        let points: Vec<[f32; 4]> = flat.geometry.iter().step_by(step.max(1)).take(count).copied().collect();
        let clip = (view.projection * view.view * DMat4::from_translation(flat.origin)).as_mat4();
        let extent = vk::Extent2D { width: self.side, height: self.side };
        println!("                        {:.2} points a covered pixel", c.stats.points_submitted as f64 / c.covered);
        for size in footprint(built, view, self.side, self.technique.blend).into_iter().chain([1.0]) {
            let frames =
                bare::measure(self.off.standalone(), &points, clip, size, extent, self.rounds).expect("bare rate");
            let Some(bare) = Summary::of(&frames) else { return };
            println!(
                "                        {count} bare points of {size} px: {:.1} ms, the frame {:.2} times that",
                bare.median,
                c.ms.median / bare.median
            );
        }
    }

    /// The same surface with more and more points.
    fn dense(&mut self, sizes: [usize; 2]) {
        println!("\nsphere, {0} x {0} px, {1}", self.side, self.technique.blend);
        for structure in [Structure::Poisson, Structure::Espt, Structure::Mospt, Structure::Sequential] {
            let clouds: Vec<(Bounds, CloudId)> = sizes
                .iter()
                .map(|&points| {
                    let cloud = synthetic::scene("sphere", points, 1).expect("a scene of this name");
                    let bounds = Bounds::of(&cloud).expect("points");
                    let flat = Arc::new(Flat::new(&cloud));
                    drop(cloud);
                    (bounds, self.off.renderer.add(build(&flat, structure)).expect("a cloud"))
                })
                .collect();
            let (_, view) = named(&clouds[0].0)[0];
            let c = self.compare(clouds[0].1, clouds[1].1, &view, self.rounds);
            println!(
                "  {:<12} {} points: {:.1} ms; {} points: {:.1} ms ({} submitted), {:.2} times ({:.2} to {:.2})",
                structure.name(),
                sizes[0],
                c.all_ms.median,
                sizes[1],
                c.ms.median,
                c.stats.points_submitted,
                1.0 / c.ratio.median,
                1.0 / c.ratio.upper,
                1.0 / c.ratio.lower,
            );
            clouds.iter().for_each(|(_, id)| self.off.renderer.remove(*id));
        }
    }
}

struct Compared {
    stats: FrameStats,
    /// \[px\]
    covered: f64,
    ms: Summary,
    all_ms: Summary,
    /// Of what everything takes to what the structure does, round by round.
    ratio: Summary,
    prepare: Summary,
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let small = args.iter().any(|a| a == "--test");
    let fuzzy = args.iter().any(|a| a == "--fuzzy");
    let files: Vec<PathBuf> = args.iter().filter(|a| !a.starts_with("--")).map(PathBuf::from).collect();
    let side = if small { 96 } else { 640 };
    let blend = if fuzzy { Blend::Fuzzy } else { Blend::Opaque };
    let standalone = Standalone::new(&Options::default()).expect("a device");
    println!("{} ({})", standalone.info.name, standalone.info.driver);
    let off = Offscreen::new(standalone, vk::Extent2D { width: side, height: side }, false).expect("a target");
    let technique = Technique { blend, ..Technique::default() };
    let mut bench = Bench { off, technique, side, rounds: if small { 1 } else { 7 } };
    let option = |name: &str| args.iter().find_map(|a| a.strip_prefix(name));
    let wanted = |name: &str| option("--structures=").is_none_or(|n| n.split(',').any(|n| n == name));
    let others = Structure::ALL.iter().filter(|(name, s)| *s != Structure::Flat && wanted(name));
    let structures: Vec<Structure> = others.map(|(_, s)| *s).collect();
    let views = option("--views=").map_or(if small { 3 } else { 64 }, |n| n.parse().expect("--views=N"));
    if files.is_empty() {
        let mut cloud = synthetic::scene("terrain", if small { 20_000 } else { 2_000_000 }, 1).expect("a scene");
        attributes::complete(&mut cloud, &attributes::Options::default());
        bench.scan("terrain", &cloud, &structures, views);
        bench.dense(if small { [20_000, 40_000] } else { [1_000_000, 16_000_000] });
    }
    for file in files {
        let mut cloud = load::open(&file, &load::Options::default()).expect("a scan");
        attributes::complete(&mut cloud, &attributes::Options::default());
        bench.scan(&file.file_name().expect("a name").to_string_lossy(), &cloud, &structures, views);
    }
    bench.off.destroy().close();
}
