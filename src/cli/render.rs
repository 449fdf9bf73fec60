//! `surfel render`: from inputs to a picture, its table and its statistics.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use surfel::standalone::{DeviceInfo, Offscreen, Shot};
use surfel::structure::Flat;
use surfel::technique::{Structure, Technique};
use surfel::{CloudId, Instance};

use super::args::RenderArgs;
use super::camera::Pose;
use super::layered::Model;
use super::progress::Progress;
use super::report::Report;
use super::scene::{self, A_SAMPLE, Scene, Source};
use super::scene_file::Placed;
use super::{Outcome, Usage, frames, input, look, memory, offscreen, output, structure};

/// Renders. What can be refused is refused before anything long begins: usage, outputs, device, size, then the files.
pub fn run(args: &RenderArgs) -> Result<Outcome> {
    let float = output::is_float(&args.picture.output)?;
    let pose = scene::pose(&args.picture.view)?;
    let technique = look::technique(&args.picture.technique, &args.picture.look)?;
    output::check(&args.picture.output)?;
    if let Some(path) = &args.stats {
        output::check(path)?;
        if output::place(path) == output::place(&args.picture.output) {
            bail!("{}: picture and statistics cannot be one file", path.display());
        }
    }
    let outputs: Vec<&Path> = std::iter::once(&args.picture.output).chain(&args.stats).map(PathBuf::as_path).collect();
    let source = Source::new(&args.picture.inputs, args.picture.structure.storage, &outputs)?;
    structure::check(&args.picture.structure, &technique, source.inputs.len())?;
    if let Some(points) = args.samples {
        if matches!(technique.structure, Structure::Hybrid | Structure::Layered) {
            let what = technique.structure;
            return Err(Usage(format!("--samples draws points in place of faces: not for --structure {what}")).into());
        }
        memory::ensure(&format!("--samples {points}"), points as u64 * A_SAMPLE)?;
    }

    let draw = |device, offscreen: &mut Offscreen| picture(args, source, pose, technique, device, offscreen);
    let (mut report, messages) = offscreen::with(&args.on, args.picture.view.size, float, draw)?;
    report.validation_messages = messages;
    if let Some(path) = &args.stats {
        let text = format!("{:#}\n", report.json());
        output::write(path, |out| Ok(out.write_all(text.as_bytes())?))?;
    }
    let table = if args.picture.quiet { String::new() } else { report.table() };
    super::print(&format!("{}\n{table}", args.picture.output.display()))?;
    Ok(if messages == 0 { Outcome::Done } else { Outcome::Spoken })
}

fn picture(
    args: &RenderArgs,
    source: Source,
    pose: Pose,
    technique: Technique,
    device: DeviceInfo,
    offscreen: &mut Offscreen,
) -> Result<Report> {
    // A quarter of a gibibyte a frame: what is staged does not double the memory of large clouds.
    offscreen.renderer.upload_budget = 256 << 20;
    let progress = Progress::new(args.picture.quiet);
    let model = (technique.structure == Structure::Layered).then(|| Model::open(&source.inputs)).transpose()?;
    let read = model.as_ref().map_or_else(|| source.read(&progress), |model| Ok(vec![model.overview()?]))?;
    let mut scene = Scene::complete(read, source, &args.picture.view.lens, &args.picture.look, &progress)?;
    let view = scene.view(pose, args.picture.view.lens.fov, args.picture.view.size);
    let style = look::style(&args.picture.technique, &args.picture.look, scene.shade);
    let (points_input, mut assumed) = (scene.points_input, std::mem::take(&mut scene.assumed));
    let placed = std::mem::take(&mut scene.instances);
    if let Some(points) = args.samples {
        let sampled = scene.sampled(points, &args.picture.look, &progress)?;
        assumed.extend(input::sentences(std::slice::from_ref(&sampled)).into_iter().filter(|s| s.contains("sampled")));
        scene.clouds = vec![sampled];
    }
    let (clouds, said) = match &model {
        None => structure::build(scene.pack(), &args.picture.structure, &technique, &view, &progress)?,
        Some(model) => {
            let (cloud, mut said) = model.in_view(&view, args.picture.view.size, &style, args.points, &progress)?;
            let cloud = scene.show(cloud, &args.picture.look, &progress)?;
            let flat = Technique { structure: Structure::Flat, ..technique };
            let packed = vec![(Flat::new(&cloud), None)];
            let (clouds, more) = structure::build(packed, &args.picture.structure, &flat, &view, &progress)?;
            said.extend(more);
            (clouds, said)
        }
    };
    let points_input = model.as_ref().map_or(points_input, Model::samples);
    assumed.extend(said);
    let layers = clouds.iter().filter_map(|c| c.flat().groups.as_ref()).map(|g| g.count).max().unwrap_or(0);
    if device.kind == "cpu" && layers > 0 {
        // Colour, front, normal, depth.
        let [width, height] = args.picture.view.size;
        let bytes = (width as u64 * height as u64).saturating_mul(layers as u64 * (16 + 8 + 16 + 4));
        memory::ensure(&format!("{layers} groups of a picture of {width}x{height}"), bytes)?;
    }
    let add = |cloud| offscreen.renderer.add(cloud);
    let clouds: Vec<CloudId> = clouds.into_iter().map(add).collect::<surfel::Result<_>>()?;
    let instance = |p: &Placed| Instance { cloud: clouds[p.cloud], transform: p.transform };
    let instances: Vec<Instance> = placed.iter().map(instance).collect();
    let shot = Shot { view: &view, instances: &instances, technique, style: &style, count: false };
    let account = frames::draw(offscreen, &shot, args.warmup, args.frames, &progress)?;
    let picture = offscreen.read()?;
    {
        let _step = progress.step("write the picture", 1);
        output::picture(&args.picture.output, &output::float(picture, &view), args.picture.background)?;
    }
    let mut skipped = Vec::new();
    if args.picture.technique.threshold.is_some() && technique.structure == Structure::Flat {
        skipped.push(("threshold", "the flat structure has no level of detail: every point is drawn"));
    }
    if !args.on.validate {
        skipped.push(("validation", "not asked for (--validate)"));
    }
    Ok(Report {
        device,
        size: args.picture.view.size,
        technique,
        points_input,
        account,
        skipped,
        threshold: [style.threshold as f64, view.off_axis()],
        validation_messages: 0,
        assumed,
    })
}
