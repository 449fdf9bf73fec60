//! Occlusion tests of layered point clouds: what they save where much is hidden, and what they cost where nothing is.
//!
//! 1. A town more than fifty surfaces deep, at eye height: frames with and without, patches drawn against those that are really seen
//!    (an oracle: every patch of the cut in a colour of its own, the nearest fragment of each pixel).
//! 2. Terrain from above, where nothing is hidden.
//!
//! `cargo bench --bench occlusion`; a model can be given: `-- MODEL.lpc`; `-- --test` runs once, small.

#[path = "../tests/common/folder.rs"]
mod folder;

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat4, DVec3, dvec3};
use surfel::ash::vk;
use surfel::load::Pieces;
use surfel::measure::Summary;
use surfel::select::layered::Refine;
use surfel::select::{DepthConvention, Sight, View};
use surfel::standalone::{Offscreen, Options, Shot, Standalone};
use surfel::stats::LayeredStats;
use surfel::stream::FileAccess;
use surfel::structure::layered::{Layered, Patience, Streaming, build, in_view};
use surfel::structure::{Flat, Index};
use surfel::style::{Shading, Style};
use surfel::technique::{Blend, Technique};
use surfel::{CloudId, Instance};

const SIZE: [u32; 2] = [640, 640];
/// Frames until what is visible is known: new patches are tested after 0, 2, 4 … frames.
const SETTLE: usize = 16;

struct Model {
    index: Arc<Index>,
    access: Arc<FileAccess>,
}

impl Model {
    fn open(path: &Path) -> Model {
        let access = Arc::new(FileAccess::open(path).expect("a model"));
        Model { index: Arc::new(Index::read(&*access).expect("an index")), access }
    }

    fn of_scene(folder: &folder::Folder, scene: &str, points: u64) -> Model {
        let path = PathBuf::from(folder.path(scene));
        let pieces = Pieces::scene(scene, points, 1).expect("a scene");
        build(vec![pieces], &path, &Default::default()).expect("a model");
        Model::open(&path)
    }

    fn add(&self, off: &mut Offscreen, occlusion: bool) -> CloudId {
        let streaming = Streaming { occlusion, cache: 4 << 30, ..Streaming::STILL };
        let layered = Layered::new(Arc::clone(&self.index), self.access.clone(), streaming);
        off.renderer.add(layered).expect("memory for the cache")
    }

    /// Patches of the view's whole cut of which a pixel shows something.
    fn visible(&self, off: &mut Offscreen, view: &View, style: &Style) -> usize {
        let sight = Sight::new(view, SIZE, &DMat4::IDENTITY, self.index.origin, style);
        let of = in_view(&self.index, self.access.clone(), &sight, &Refine::default(), Patience::default());
        let (mut flat, mut nodes): (Flat, Vec<u32>) = (of.expect("a picture").flat, Vec::new());
        // The drawn nodes follow each other in the order of the cut.
        let mut cut = surfel::select::layered::Cut::default();
        surfel::select::layered::refine(&self.index, &sight, &Refine::default(), |_| 1.0, &mut cut);
        for (number, step) in cut.drawn().enumerate() {
            nodes.extend((0..self.index.nodes[step.node as usize].samples).map(|_| number as u32));
        }
        assert_eq!(nodes.len(), flat.len(), "a number a sample");
        flat.colors = Some(nodes.iter().map(|n| n | 255 << 24).collect());
        flat.normals = None;
        let id = off.renderer.add(flat).expect("memory for the cut");
        let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
        let technique = Technique { blend: Blend::Opaque, ..Technique::TWO_PASS };
        let style = Style { shading: Shading::None, ..*style };
        let shot = Shot { view, instances: &instances, technique, style: &style, count: false };
        off.draw(&shot).expect("a frame");
        off.draw(&shot).expect("a frame");
        let picture = off.read().expect("a picture");
        let shown: Vec<bool> = picture.rgba.iter().map(|p| p[3] > 0.0).collect();
        let bytes = picture.encode([0, 0, 0, 255]);
        let ids = bytes.chunks_exact(4).zip(shown).filter(|(_, shown)| *shown);
        let ids: HashSet<u32> = ids.map(|(c, _)| u32::from_le_bytes([c[0], c[1], c[2], 0])).collect();
        off.renderer.remove(id);
        ids.len()
    }
}

/// Frames with and without, alternating: times [ms], and what the last one with the tests did.
fn compare(off: &mut Offscreen, model: &Model, view: &View, style: &Style, technique: Technique, rounds: usize) {
    let ids = [model.add(off, false), model.add(off, true)];
    let mut times = [Vec::new(), Vec::new()];
    let mut last = [LayeredStats::default(), LayeredStats::default()];
    for (id, last) in ids.into_iter().zip(&mut last) {
        let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
        let shot = Shot { view, instances: &instances, technique, style, count: false };
        while off.draw(&shot).expect("a frame").0.layered[0].cut.missing > 0 {}
        for _ in 0..if rounds > 1 { SETTLE } else { 1 } {
            *last = off.draw(&shot).expect("a frame").0.layered.remove(0);
        }
    }
    for _ in 0..rounds {
        for (id, (times, last)) in ids.into_iter().zip(times.iter_mut().zip(&mut last)) {
            let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
            let shot = Shot { view, instances: &instances, technique, style, count: false };
            let (mut stats, time) = off.draw(&shot).expect("a frame");
            times.push(time.frame);
            *last = stats.layered.remove(0);
        }
    }
    ids.into_iter().for_each(|id| off.renderer.remove(id));
    let ratios: Vec<f64> = times[0].iter().zip(&times[1]).map(|(without, with)| without / with).collect();
    let (ratio, [without, with]) =
        (Summary::of(&ratios).expect("rounds"), times.map(|t| Summary::of(&t).expect("rounds")));
    let drawn = last[1].cut.drawn + last[1].cut.occluded - last[1].hidden;
    println!(
        "  {:<10} {:>8.1} ms without, {:>8.1} with: {:.2} times as fast ({:.2} to {:.2}); {} of {} patches drawn, {} tested",
        technique.blend.name(),
        without.median,
        with.median,
        ratio.median,
        ratio.lower,
        ratio.upper,
        drawn,
        last[0].cut.drawn,
        last[1].tested,
    );
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let small = arguments.iter().any(|a| a == "--test");
    let given = arguments.iter().find(|a| a.ends_with(".lpc"));
    let folder = folder::Folder::new("bench-occlusion");
    let standalone = Standalone::new(&Options::default()).expect("a Vulkan device");
    println!("{}, {} x {}", standalone.info.name, SIZE[0], SIZE[1]);
    let mut off = Offscreen::new(standalone, vk::Extent2D { width: SIZE[0], height: SIZE[1] }, true).expect("a target");
    let (deep, flat, rounds) = if small { (60_000, 60_000, 1) } else { (2_000_000, 1_000_000, 5) };
    let lens = View::perspective(1.0, 1.0, 0.05);
    let look = |eye: DVec3, target: DVec3| View::look_at(eye, target, DVec3::Z, lens, DepthConvention::Reversed);
    let style = Style::default();
    let all = [Blend::TwoPass, Blend::Fuzzy];
    let blends =
        all[..if small { 1 } else { 2 }].iter().map(|blend| Technique { blend: *blend, ..Technique::TWO_PASS });

    let town = given.map_or_else(|| Model::of_scene(&folder, "deep", deep), |path| Model::open(Path::new(path)));
    let root = town.index.nodes[0];
    let (middle, ball) = (town.index.origin + root.centre.as_dvec3(), root.ball as f64);
    let ground = middle.truncate().extend(2.0);
    for (name, eye, target) in [
        ("along a street", ground - ball * 0.6 * DVec3::Y, ground + ball * DVec3::Y),
        ("across", ground - ball * dvec3(0.4, 0.4, 0.0), ground + ball * dvec3(1.0, 0.9, 0.0)),
    ] {
        let view = look(eye, target);
        println!(
            "deep, {} samples, {name}: {} patches are seen",
            town.index.samples(),
            town.visible(&mut off, &view, &style)
        );
        blends.clone().for_each(|technique| compare(&mut off, &town, &view, &style, technique, rounds));
    }
    let terrain = Model::of_scene(&folder, "terrain", flat);
    let root = terrain.index.nodes[0];
    let (middle, ball) = (terrain.index.origin + root.centre.as_dvec3(), root.ball as f64);
    let view = look(middle + ball * dvec3(0.1, 0.1, 1.6), middle);
    println!("terrain, {} samples, from above", terrain.index.samples());
    blends.clone().for_each(|technique| compare(&mut off, &terrain, &view, &style, technique, 3 * rounds));
    let messages = off.destroy().close();
    assert!(messages.is_empty(), "{messages:?}");
}
