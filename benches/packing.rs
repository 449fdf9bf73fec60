//! Packed points: bytes a point of every structure, what positions lose, and what pictures and frames make of it.
//!
//! For each input, with estimated normals and without: bytes a point of the input in every structure and packing, and of the
//! quantised ones how far a stored point is off in units of its own radius. Then MOSPT from where everything fits: PSNR of packed
//! against full, and frame times in rounds of all three.
//!
//! `cargo bench --bench packing -- SCAN...`; without files a terrain of two million points; `-- --test` runs once, small.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DMat4, DVec3, dvec3};
use surfel::ash::vk;
use surfel::load::{self, Bounds, PointCloud, attributes, synthetic};
use surfel::measure::{Image, Summary, compare};
use surfel::select::{DepthConvention, View};
use surfel::standalone::{Offscreen, Options, Shot, Standalone};
use surfel::structure::arrange::Arrangement;
use surfel::structure::nodes::ErrorRule;
use surfel::structure::{Cloud, Flat, Octree, Packing, Sequential, octree, sequential};
use surfel::style::{Shading, Style};
use surfel::technique::{Blend, Structure, Technique};
use surfel::{CloudId, Instance};

const PACKINGS: [Packing; 3] = [Packing::Full, Packing::Exact, Packing::Quantised];

fn structures(flat: &Arc<Flat>) -> Vec<(String, Box<dyn Fn() -> Cloud + '_>)> {
    let octree = |preset| move || Arc::new(Octree::build(flat, &octree::Options::new(preset))).into();
    let tree = |rule, blocks| {
        let options = sequential::Options { rule, blocks, ..Default::default() };
        move || Arc::new(Sequential::build(flat, &options)).into()
    };
    vec![
        ("flat, as read".into(), Box::new(|| Arc::clone(flat).into())),
        ("flat, morton".into(), Box::new(|| flat.arranged(Arrangement::Morton, |_| 0.0).into())),
        (Structure::VboR.to_string(), Box::new(octree(octree::Preset::VboR))),
        (Structure::Espt.to_string(), Box::new(octree(octree::Preset::Espt))),
        (Structure::Mospt.to_string(), Box::new(octree(octree::Preset::Mospt))),
        (Structure::RGrid.to_string(), Box::new(octree(octree::Preset::RGrid))),
        (Structure::Sequential.to_string(), Box::new(tree(ErrorRule::Geometric, 10_000))),
        (Structure::OneSpt.to_string(), Box::new(tree(ErrorRule::Cell, 0))),
        (Structure::SptR.to_string(), Box::new(tree(ErrorRule::Cell, 10_000))),
    ]
}

/// Bytes a point, and how far quantised positions are off.
fn sizes(flat: &Arc<Flat>) {
    println!(
        "  structure       B a point: full, exact, quantised; radii x at most; off, in radii: half, 99 %, 99.9 %, most; beyond 1/8"
    );
    for (name, build) in structures(flat) {
        let full = build();
        let points = full.points() as f64;
        let packed = full.clone().packed(Packing::Quantised);
        let bytes =
            [full.bytes(), full.clone().packed(Packing::Exact).bytes(), packed.bytes()].map(|b| b as f64 / points);
        let (was, is) = (full.flat(), packed.flat());
        let mut off: Vec<f32> = (0..was.len() as u32)
            .filter(|&i| is.point(i)[3] > 0.0)
            .map(|i| (is.position(i) - was.position(i)).length() / was.point(i)[3])
            .collect();
        off.sort_unstable_by(f32::total_cmp);
        let at = |share: f64| off[(share * (off.len() - 1) as f64) as usize];
        let beyond = off.len() - off.partition_point(|o| *o <= 0.125);
        let radii = is.packed.as_ref().expect("packed").radii().factor();
        println!(
            "  {name:<14} {:>6.2} {:>6.2} {:>6.2}   {radii:.4}   {:.4} {:.4} {:.4} {:.3}   {beyond} of {}",
            bytes[0],
            bytes[1],
            bytes[2],
            at(0.5),
            at(0.99),
            at(0.999),
            at(1.0),
            off.len(),
        );
    }
}

struct Bench {
    off: Offscreen,
    side: u32,
    rounds: usize,
}

impl Bench {
    fn frame(&mut self, cloud: CloudId, view: &View, technique: Technique, style: &Style) -> f64 {
        let instances = [Instance { cloud, transform: DMat4::IDENTITY }];
        let shot = Shot { view, instances: &instances, technique, style, count: false };
        self.off.draw(&shot).expect("a frame").1.frame
    }

    fn image(&mut self) -> Image {
        let picture = self.off.read().expect("a picture");
        let rgba: Vec<[f64; 4]> = picture.rgba.iter().map(|p| p.map(f64::from)).collect();
        Image::from_linear(self.side, self.side, &rgba, [0; 3])
    }

    /// MOSPT in every packing, from where everything fits.
    fn frames(&mut self, flat: &Arc<Flat>, bounds: &Bounds) {
        let octree: Cloud = Arc::new(Octree::build(flat, &octree::Options::new(octree::Preset::Mospt))).into();
        let ids = PACKINGS.map(|packing| self.off.renderer.add(octree.clone().packed(packing)).expect("a cloud"));
        drop(octree);
        let (azimuth, elevation) = (30f64.to_radians(), 20f64.to_radians());
        let level = dvec3(azimuth.sin(), -azimuth.cos(), 0.0);
        let back = level * elevation.cos() + DVec3::Z * elevation.sin();
        let eye = bounds.center + bounds.radius / 22.5f64.to_radians().sin() * back;
        let lens = View::perspective(45f64.to_radians(), 1.0, 1e-4 * bounds.radius);
        let view = View::facing(eye, back, DVec3::Z, lens, DepthConvention::Reversed);
        let shading = if flat.has_normals() { Shading::HEADLIGHT } else { Shading::None };
        let style = Style { shading, ..Style::default() };
        for blend in [Blend::Opaque, Blend::Fuzzy] {
            let technique = Technique { blend, ..Technique::default() };
            let images = ids.map(|id| {
                self.frame(id, &view, technique, &style);
                self.image()
            });
            let differ = |image: &Image| compare(&images[0], image, 0.0).expect("pictures of one size");
            let psnr = |image: &Image| differ(image).psnr_covered.unwrap_or(f64::INFINITY);
            let mut times = [const { Vec::new() }; 3];
            for _ in 0..self.rounds {
                for (id, times) in ids.iter().zip(&mut times) {
                    times.push(self.frame(*id, &view, technique, &style));
                }
            }
            let medians = times.each_ref().map(|t| Summary::of(t).expect("rounds").median);
            let ratio = |k: usize| {
                let ratios: Vec<f64> = times[k].iter().zip(&times[0]).map(|(own, full)| own / full).collect();
                Summary::of(&ratios).expect("rounds")
            };
            let [exact, quantised] = [1, 2].map(ratio);
            println!(
                "  mospt, {blend}: PSNR where there is anything: exact {:.1} dB, quantised {:.1} dB; full {:.1} ms, exact {:.3} ({:.3} to {:.3}), quantised {:.3} ({:.3} to {:.3}) times that",
                psnr(&images[1]),
                psnr(&images[2]),
                medians[0],
                exact.median,
                exact.lower,
                exact.upper,
                quantised.median,
                quantised.lower,
                quantised.upper,
            );
        }
        ids.into_iter().for_each(|id| self.off.renderer.remove(id));
    }

    fn scan(&mut self, name: &str, cloud: &PointCloud) {
        let bounds = Bounds::of(cloud).expect("points");
        let mut flat = Flat::new(cloud);
        for normals in [true, false] {
            if !normals {
                flat.normals = None;
            }
            let shared = Arc::new(flat);
            println!("\n{name}, {} points, {} normals", shared.len(), if normals { "with" } else { "without" });
            sizes(&shared);
            self.frames(&shared, &bounds);
            flat = Arc::unwrap_or_clone(shared);
        }
    }
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let small = args.iter().any(|a| a == "--test");
    let files: Vec<PathBuf> = args.iter().filter(|a| !a.starts_with("--")).map(PathBuf::from).collect();
    let side = if small { 96 } else { 640 };
    let standalone = Standalone::new(&Options::default()).expect("a device");
    println!("{} ({})", standalone.info.name, standalone.info.driver);
    let off = Offscreen::new(standalone, vk::Extent2D { width: side, height: side }, false).expect("a target");
    let mut bench = Bench { off, side, rounds: if small { 1 } else { 9 } };
    let complete = |mut cloud: PointCloud| {
        attributes::complete(&mut cloud, &attributes::Options::default());
        cloud
    };
    if files.is_empty() {
        let cloud = synthetic::scene("terrain", if small { 20_000 } else { 2_000_000 }, 1).expect("a scene");
        bench.scan("terrain", &complete(cloud));
    }
    for file in files {
        let cloud = complete(load::open(&file, &load::Options::default()).expect("a scan"));
        bench.scan(&file.file_name().expect("a name").to_string_lossy(), &cloud);
    }
    bench.off.destroy().close();
}
