//! Frames of every blend on three sizes, beside the bare rate of the device for the same points and pixel size.
//!
//! What is timed: the device's own time of the splat passes, from its timestamps; `composite`, uploads and the count are
//! left out, and two frames warm up before. The bare rate draws the same points as squares of the mean footprint's size,
//! additively into the same float format: no disk, no depth, no back faces dropped. Every picture is checked before it is
//! timed. Lavapipe's times are the processor's, never a GPU's.
//!
//! `cargo bench --bench frame`; `-- --test` runs each once, small. The table at the end compares medians of one run,
//! technique and bare rate taken in turn.

use std::sync::Arc;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput};
use glam::{DMat4, DVec3, dvec3};
use surfel::ash::vk;
use surfel::load::{Bounds, synthetic};
use surfel::measure::Summary;
use surfel::select::{DepthConvention, View};
use surfel::standalone::{Offscreen, Options, Shot, Standalone, bare};
use surfel::structure::Flat;
use surfel::structure::groups::{Groups, Relax};
use surfel::style::{Shading, Style};
use surfel::technique::Technique;
use surfel::{CloudId, Instance};

struct Setup {
    off: Offscreen,
    cloud: CloudId,
    flat: Arc<Flat>,
    view: View,
    extent: vk::Extent2D,
    /// Mean side of a splat's square on the screen [px].
    size: f32,
}

impl Setup {
    /// A closed sphere that fills 85 % of the picture's height.
    fn new(points: usize, side: u32) -> Setup {
        let extent = vk::Extent2D { width: side, height: side };
        let standalone = Standalone::new(&Options::default()).expect("a device");
        let mut off = Offscreen::new(standalone, extent, false).expect("a target");
        let cloud = synthetic::scene("sphere", points, 1).expect("a scene of this name");
        let bounds = Bounds::of(&cloud).expect("points");
        let mut flat = Flat::new(&cloud);
        // The paper's smallest factor: as few layers as it has.
        flat.groups = Some(Groups::color(&flat, &Relax { factor: 0.4, ..Relax::default() }).expect("groups"));
        let flat = Arc::new(flat);
        let id = off.renderer.add(Arc::clone(&flat)).expect("a cloud");
        let radius = 0.5 * (bounds.max.x - bounds.min.x);
        let center = 0.5 * (bounds.max + bounds.min);
        let distance = radius / (0.85 * 0.4f64).sin();
        let projection = View::perspective(0.8, 1.0, 1e-3 * radius);
        let eye = center + distance * dvec3(0.6, -0.7, 0.4).normalize();
        let view = View::look_at(eye, center, DVec3::Z, projection, DepthConvention::Reversed);
        // Facing splats at the sphere's mean visible distance: a square of 2 r.
        let r = flat.geometry[0][3] as f64;
        let size = (2.0 * r * view.focal(side as f64) / (distance - 0.6 * radius)).max(2.0).round() as f32;
        Setup { off, cloud: id, flat, view, extent, size }
    }

    /// Device time of the splat passes of one frame [ms].
    fn frame(&mut self, technique: Technique, style: &Style) -> f64 {
        let instances = [Instance { cloud: self.cloud, transform: DMat4::IDENTITY }];
        let shot = Shot { view: &self.view, instances: &instances, technique, style, count: false };
        let (stats, times) = self.off.draw(&shot).expect("a frame");
        let splats: f64 =
            stats.passes.iter().filter(|p| p.name != "composite" && p.name != "upload").map(|p| p.gpu_ms).sum();
        // A device without timestamps is timed by the processor.
        if splats > 0.0 { splats } else { times.frame }
    }

    fn bare(&mut self, frames: usize) -> Vec<f64> {
        let clip = (self.view.projection * self.view.view * DMat4::from_translation(self.flat.origin)).as_mat4();
        bare::measure(self.off.standalone(), &self.flat.geometry, clip, self.size, self.extent, frames)
            .expect("bare rate")
    }

    /// The picture is a disc of 85 % of the height: π/4 · 0.85² of the square, give or take the rim.
    fn check(&mut self) {
        let picture = self.off.read().expect("a picture");
        let share = picture.coverage();
        assert!((0.5..0.62).contains(&share), "covered {share}: not the sphere that was to be timed");
    }
}

const CASES: [(&str, &str, Shading); 9] = [
    ("two-pass", "flat.two-pass.point", Shading::None),
    ("two-pass lit", "flat.two-pass.point", Shading::HEADLIGHT),
    ("two-pass quad", "flat.two-pass.quad", Shading::None),
    ("fuzzy", "flat.fuzzy.point", Shading::None),
    ("fuzzy lit", "flat.fuzzy.point", Shading::HEADLIGHT),
    ("groups", "flat.groups.point", Shading::None),
    ("groups lit", "flat.groups.point", Shading::HEADLIGHT),
    ("opaque", "flat.opaque.point", Shading::None),
    ("opaque lit", "flat.opaque.point", Shading::HEADLIGHT),
];

/// What folding costs by the number of layers: the same points in more and more groups.
fn fold(setup: &mut Setup, rounds: usize) -> String {
    let mut text = String::new();
    let technique = Technique::named("flat.groups.point").expect("a preset");
    let style = style(Shading::HEADLIGHT);
    for layers in [2u32, 4, 8, 16, 32] {
        let mut flat = Flat::clone(&setup.flat);
        let of = (0..flat.len() as u32).map(|i| (i % layers) as u8).collect();
        flat.groups = Some(Groups { of, count: layers, overlapping: true, ..Groups::default() });
        let cloud = setup.off.renderer.add(Arc::new(flat)).expect("a cloud");
        let instances = [Instance { cloud, transform: DMat4::IDENTITY }];
        let shot = Shot { view: &setup.view, instances: &instances, technique, style: &style, count: false };
        let (mut drawn, mut folded) = (Vec::new(), Vec::new());
        for round in 0..rounds + 1 {
            let (stats, _) = setup.off.draw(&shot).expect("a frame");
            assert_eq!(stats.layers, layers);
            let ms = |name: &str| stats.passes.iter().filter(|p| p.name == name).map(|p| p.gpu_ms).sum::<f64>();
            if round > 0 {
                drawn.push(ms("groups"));
                folded.push(ms("fold"));
            }
        }
        setup.off.renderer.remove(cloud);
        if let (Some(drawn), Some(folded)) = (Summary::of(&drawn), Summary::of(&folded)) {
            text += &format!(
                "  {layers:>2} layers lit: groups {:.1} ms, fold {:.1} ms ({:.1} to {:.1}), {:.2} ms a layer\n",
                drawn.median,
                folded.median,
                folded.lower,
                folded.upper,
                folded.median / layers as f64
            );
        }
    }
    text
}

fn style(shading: Shading) -> Style {
    Style { shading, ..Style::default() }
}

fn main() {
    // `--test`, as `cargo bench -- --test` gives it: once, small.
    let small = std::env::args().any(|a| a == "--test");
    let points = if small { 20_000 } else { 1_000_000 };
    let sides: &[u32] = if small { &[160] } else { &[320, 640, 1280] };
    let rounds = if small { 1 } else { 9 };
    let mut criterion =
        Criterion::default().sample_size(10).warm_up_time(Duration::from_millis(1)).configure_from_args();
    let mut table = String::new();
    for &side in sides {
        let mut setup = Setup::new(points, side);
        for (_, preset, shading) in CASES {
            let technique = Technique::named(preset).expect("a preset");
            setup.frame(technique, &style(shading));
            setup.frame(technique, &style(shading));
            setup.check();
        }
        let mut group = criterion.benchmark_group(format!("frame {side}x{side}"));
        group.throughput(Throughput::Elements(points as u64));
        if !small {
            // One frame is one sample: criterion must not ask for thousands of them.
            group.measurement_time(Duration::from_secs(1));
        }
        for (name, preset, shading) in CASES {
            let technique = Technique::named(preset).expect("a preset");
            group.bench_function(BenchmarkId::new(name, points), |b| {
                b.iter_custom(|n| {
                    let ms: f64 = (0..n).map(|_| setup.frame(technique, &style(shading))).sum();
                    Duration::from_secs_f64(ms * 1e-3)
                });
            });
        }
        group.finish();

        // Ratios: each round times the bare rate and every technique, one after the other.
        let mut ratios = vec![Vec::new(); CASES.len()];
        let (mut bares, mut times) = (Vec::new(), vec![Vec::new(); CASES.len()]);
        for _ in 0..rounds {
            let Some(bare) = Summary::of(&setup.bare(1)) else { continue };
            bares.push(bare.median);
            for (i, (_, preset, shading)) in CASES.iter().enumerate() {
                let ms = setup.frame(Technique::named(preset).expect("a preset"), &style(*shading));
                times[i].push(ms);
                ratios[i].push(2.0 * bare.median / ms);
            }
        }
        let device = &setup.off.standalone().info;
        table += &format!("\n{} ({}), {points} points, {side}x{side}\n", device.name, device.driver);
        if let Some(bare) = Summary::of(&bares) {
            let rate = points as f64 / bare.median * 1e-3;
            table += &format!("  bare, squares of {} px: {:.1} ms, {rate:.2} M points/s\n", setup.size, bare.median);
        }
        for (i, (name, ..)) in CASES.iter().enumerate() {
            if let (Some(ms), Some(ratio)) = (Summary::of(&times[i]), Summary::of(&ratios[i])) {
                table += &format!(
                    "  {name:<14} {:8.1} ms, {:.2} M splats/s, of half the bare rate {:.0} % ({:.0} to {:.0})\n",
                    ms.median,
                    points as f64 / ms.median * 1e-3,
                    100.0 * ratio.median,
                    100.0 * ratio.lower,
                    100.0 * ratio.upper,
                );
            }
        }
        // Two-pass against the others, round by round: what one pass saves.
        for blend in ["fuzzy", "groups"] {
            for lit in ["", " lit"] {
                let of = |name: String| CASES.iter().position(|(n, ..)| *n == name).expect("a case");
                let (two, one) = (of(format!("two-pass{lit}")), of(format!("{blend}{lit}")));
                let speedup: Vec<f64> = times[two].iter().zip(&times[one]).map(|(a, b)| a / b).collect();
                if let Some(s) = Summary::of(&speedup) {
                    table += &format!(
                        "  {blend}{lit}: {:.2} times as fast as two-pass{lit} ({:.2} to {:.2})\n",
                        s.median, s.lower, s.upper
                    );
                }
            }
        }
        table += &fold(&mut setup, rounds);
        setup.off.destroy();
    }
    criterion.final_summary();
    println!("{table}");
}
