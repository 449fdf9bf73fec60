//! `surfel build`: layered point clouds from scans of any size.

use std::fmt::Write as _;
use std::sync::{Mutex, PoisonError};

use anyhow::{Result, bail};
use glam::DVec3;

use surfel::load::{self, Pieces};
use surfel::structure::groups::Relax;
use surfel::structure::layered::{self, Index, Options};

use super::args::BuildArgs;
use super::memory;
use super::parse::Input;
use super::progress::{Progress, Step};
use super::report::grouped;
use super::{Outcome, input, output, scene, scene_file};

/// Builds. What can be refused is refused before anything is read.
pub fn run(args: &BuildArgs) -> Result<Outcome> {
    output::check(&args.output)?;
    scene::readable(&args.inputs, &[&args.output])?;
    let progress = Progress::new(args.quiet);
    let pieces: Vec<Pieces> = args.inputs.iter().map(|i| pieces(i, &progress)).collect::<Result<_>>()?;
    let shown: Mutex<Option<(String, Step)>> = Mutex::new(None);
    let told = |name: &str, done, total| {
        let mut shown = shown.lock().unwrap_or_else(PoisonError::into_inner);
        if shown.as_ref().is_none_or(|(step, _)| step != name) {
            // The old bar goes before the new one comes.
            *shown = None;
            *shown = Some((name.to_owned(), progress.step(name, total)));
        }
        if let Some((_, step)) = &*shown {
            step.set(done, total);
        }
    };
    let name = match args.inputs.as_slice() {
        [Input::File(path)] => path.display().to_string(),
        _ => args.output.display().to_string(),
    };
    let options = Options {
        samples: args.patch,
        candidates: args.candidates,
        sampling: args.sampling,
        seed: args.seed,
        precision: args.precision as f32,
        exact: args.exact,
        normals: args.normals,
        groups: args.groups.then(|| Relax { factor: args.group_factor, limit: args.group_limit, ..Relax::default() }),
        memory: args.memory,
        name: &name,
        progress: Some(&told),
    };
    let built = layered::build(pieces, &args.output, &options)?;
    drop(shown);
    let mut text = format!("{}\n", args.output.display());
    if !args.quiet {
        text += &table(&built.index);
        for line in input::lines(&built.report) {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "  note         {line}");
        }
        if let Some(peak) = memory::peak_rss() {
            let _ = writeln!(text, "  peak memory  {}", memory::human(peak));
        }
    }
    super::print(&text)?;
    Ok(Outcome::Done)
}

fn pieces(input: &Input, progress: &Progress) -> Result<Pieces> {
    if scene_file::is_scene(input) {
        bail!("a scene file is for render, reference and info: a model is built of its inputs");
    }
    match input {
        Input::File(path) => {
            let step = progress.step(format!("read {}", path.display()), 1);
            let report = |done, total| step.set(done, total);
            Ok(Pieces::open(path, &load::Options { progress: Some(&report) })?)
        }
        Input::Remote(address) => bail!("{address}: a model is built of files"),
        Input::Scene { name, points, seed } => {
            if name != "deep" {
                memory::ensure(&format!("scene:{name}:{points}"), *points as u64 * 31)?;
            }
            let _step = progress.step(format!("make scene {name}"), 1);
            Ok(Pieces::scene(name, *points as u64, *seed)?)
        }
    }
}

/// What there is to say of a model without reading its patches.
pub fn table(index: &Index) -> String {
    let mut text = String::new();
    let mut row = |name: &str, value: String| {
        let _ = writeln!(text, "  {name:<12} {value}");
    };
    let facts = Facts::of(index);
    let there = [("normals", index.normals), ("colors", index.colors), ("exact", index.exact)];
    let groups = index.groups.map(|count| format!("{count} groups"));
    let there: Vec<&str> = there.iter().filter(|(_, b)| *b).map(|(n, _)| *n).chain(groups.as_deref()).collect();
    row("format", "layered point cloud".into());
    row("samples", grouped(index.samples()));
    row("nodes", format!("{} in {} levels", grouped(index.nodes.len() as u64), facts.levels));
    row("attributes", if there.is_empty() { "positions and radii only".into() } else { there.join(", ") });
    row("size", format!("{:.2} bits a sample, and {:.2} for the index", facts.patches, facts.index));
    row("spacing", format!("{:.6} to {:.6}", facts.spacing[0], facts.spacing[1]));
    let vector = |v: DVec3| format!("{:.6} {:.6} {:.6}", v.x, v.y, v.z);
    row("sphere", format!("{}, radius {:.6}", vector(facts.centre), facts.radius));
    text
}

/// Figures of an index.
pub struct Facts {
    pub levels: usize,
    /// Bits a sample of the patches, and of what comes before them.
    pub patches: f64,
    pub index: f64,
    /// Smallest and largest spacing of a node [world units].
    pub spacing: [f32; 2],
    /// Of the root's ball, in the world.
    pub centre: DVec3,
    pub radius: f32,
}

impl Facts {
    pub fn of(index: &Index) -> Facts {
        let samples = index.samples().max(1) as f64;
        let bytes: u64 = index.nodes.iter().map(|n| n.bytes as u64).sum();
        let before = index.nodes.first().map_or(0, |n| n.at);
        let spacing = index.nodes.iter().map(|n| n.spacing);
        let (centre, radius) = index.nodes.first().map_or((DVec3::ZERO, 0.0), |n| (n.centre.as_dvec3(), n.ball));
        Facts {
            levels: index.nodes.last().map_or(0, |n| n.level as usize + 1),
            patches: 8.0 * bytes as f64 / samples,
            index: 8.0 * before as f64 / samples,
            spacing: [spacing.clone().fold(f32::INFINITY, f32::min), spacing.fold(0.0, f32::max)],
            centre: index.origin + centre,
            radius,
        }
    }
}
