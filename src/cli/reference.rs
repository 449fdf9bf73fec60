//! `surfel reference`: the picture that is right, in f64 on the processor. It needs no Vulkan.

use std::fmt::Write as _;

use anyhow::{Result, bail};

use glam::DMat4;

use surfel::load::PointCloud;
use surfel::reference::{
    Instance, MARGIN_F32, MeshInstance, MeshScene, Picture, SAMPLES, Scene as Splats, Surface, ray_cast, render,
    supersampled,
};
use surfel::select::{View, cut};
use surfel::structure::Cloud;
use surfel::style::Style;
use surfel::technique::Technique;

use super::args::{ReferenceArgs, TruthKind};
use super::parse::Input;
use super::progress::Progress;
use super::report::grouped;
use super::scene::{self, Scene, Source};
use super::scene_file::Placed;
use super::{Outcome, Usage, look, memory, output, structure};

/// Samples along a pixel's side where no surface is known.
pub const SUPERSAMPLES: u32 = 8;

/// Bytes a pixel: the finished tiles and the picture in f64, and as it is written.
const A_PIXEL: u64 = 48 + 41 + 20 + 20;

/// Draws. What can be refused is refused before anything long begins.
pub fn run(args: &ReferenceArgs) -> Result<Outcome> {
    output::is_float(&args.picture.output)?;
    let pose = scene::pose(&args.picture.view)?;
    let technique = look::technique(&args.picture.technique, &args.picture.look)?;
    let samples = samples(args.truth, args.samples)?;
    output::check(&args.picture.output)?;
    let source = Source::new(&args.picture.inputs, args.picture.structure.storage, &[&args.picture.output])?;
    structure::check(&args.picture.structure, &technique, source.inputs.len())?;
    let [width, height] = args.picture.view.size;
    let pixels = width as u64 * height as u64;
    memory::ensure(&format!("a picture of {width}x{height}"), pixels.saturating_mul(A_PIXEL))?;

    let progress = Progress::new(args.picture.quiet);
    let read = source.read(&progress)?;
    if args.truth == TruthKind::Mesh {
        faces(&source.inputs, &read)?;
    }
    let mut scene = Scene::complete(read, source, &args.picture.view.lens, &args.picture.look, &progress)?;
    let view = scene.view(pose, args.picture.view.lens.fov, args.picture.view.size);
    let style = look::style(&args.picture.technique, &args.picture.look, scene.shade);
    let (points_input, mut assumed) = (scene.points_input, std::mem::take(&mut scene.assumed));

    let placed = std::mem::take(&mut scene.instances);

    let mut rows = vec![("picture", format!("{width} x {height}, f64, {}", said(args.truth, samples)))];
    let step = progress.step("draw", 1);
    let picture = if args.truth == TruthKind::Mesh {
        let surfaces: Vec<Surface> = scene.clouds.iter().filter_map(Surface::new).collect();
        let triangles: usize = surfaces.iter().map(Surface::triangles).sum();
        rows.push(("triangles", grouped(triangles as u64)));
        mesh(&surfaces, &placed, &view, args.picture.view.size, &style, samples)
    } else {
        let (clouds, said) = structure::build(scene.pack(), &args.picture.structure, &technique, &view, &progress)?;
        assumed.extend(said);
        let placed = on(&clouds, &placed);
        let picture = splats(&placed, &view, args.picture.view.size, technique, &style, |scene| match args.truth {
            TruthKind::Supersampled => supersampled(scene, samples),
            _ => render(scene, MARGIN_F32),
        });
        let counts = picture.counts;
        rows.push(("points", format!("{} in the input, {} drawn", grouped(points_input), grouped(counts.drawn))));
        let culled =
            [("frustum", counts.culled_frustum), ("cone", counts.culled_cone), ("invalid", counts.culled_invalid)];
        rows.extend(culled.into_iter().filter(|(_, n)| *n > 0).map(|(why, n)| (why, format!("{} culled", grouped(n)))));
        picture
    };
    drop(step);
    if args.truth == TruthKind::None {
        let ties = picture.ties.iter().filter(|t| **t).count();
        rows.push(("ties", format!("{} pixels that f32 may decide otherwise", grouped(ties as u64))));
    }
    output::picture(&args.picture.output, &output::from_reference(&picture, &view), args.picture.background)?;
    rows.extend(assumed.into_iter().enumerate().map(|(i, line)| (if i == 0 { "assumed" } else { "" }, line)));
    rows.extend(memory::peak_rss().map(|bytes| ("peak memory", memory::human(bytes))));
    let mut text = format!("{}\n", args.picture.output.display());
    for (name, value) in rows.iter().filter(|_| !args.picture.quiet) {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {name:<18} {value}");
    }
    super::print(&text)?;
    Ok(Outcome::Done)
}

/// Samples along a pixel's side.
fn samples(truth: TruthKind, asked: Option<u32>) -> Result<u32, Usage> {
    match (truth, asked) {
        (TruthKind::None, Some(_)) => Err(Usage("--samples is for --truth mesh and --truth supersampled".into())),
        (TruthKind::None, None) => Ok(1),
        (TruthKind::Mesh, asked) => Ok(asked.unwrap_or(SAMPLES)),
        (TruthKind::Supersampled, Some(n)) if !32u32.is_multiple_of(n) => {
            Err(Usage("--samples: 1, 2, 4, 8, 16 or 32 with --truth supersampled".into()))
        }
        (TruthKind::Supersampled, asked) => Ok(asked.unwrap_or(SUPERSAMPLES)),
    }
}

fn said(truth: TruthKind, samples: u32) -> String {
    match truth {
        TruthKind::None => "splats".into(),
        TruthKind::Mesh => format!("rays, {samples} x {samples} a pixel"),
        TruthKind::Supersampled => format!("splats, {samples} x {samples} samples a pixel"),
    }
}

/// Every input must have faces: what has none would be missing from the picture.
fn faces(inputs: &[Input], clouds: &[PointCloud]) -> Result<()> {
    for (input, cloud) in inputs.iter().zip(clouds) {
        if cloud.mesh.as_ref().is_none_or(|mesh| mesh.triangles.is_empty()) {
            let name = match input {
                Input::File(path) => path.display().to_string(),
                Input::Remote(address) => address.clone(),
                Input::Scene { name, .. } => format!("scene:{name}"),
            };
            bail!("{name}: --truth mesh needs faces, and it has none (--truth supersampled does not)");
        }
    }
    Ok(())
}

/// The surfaces where they are put, by rays.
pub fn mesh(
    surfaces: &[Surface],
    placed: &[Placed],
    view: &View,
    [width, height]: [u32; 2],
    style: &Style,
    samples: u32,
) -> Picture {
    let instance = |p: &Placed| MeshInstance { surface: &surfaces[p.cloud], transform: p.transform };
    let instances: Vec<_> = placed.iter().map(instance).collect();
    ray_cast(&MeshScene { instances: &instances, view, width, height, style }, samples)
}

/// The points where they are put.
pub fn on<'a>(clouds: &'a [Cloud], placed: &[Placed]) -> Vec<(&'a Cloud, DMat4)> {
    placed.iter().map(|p| (&clouds[p.cloud], p.transform)).collect()
}

/// What `draw` makes of all points of the instances.
pub fn splats(
    instances: &[(&Cloud, DMat4)],
    view: &View,
    [width, height]: [u32; 2],
    technique: Technique,
    style: &Style,
    draw: impl FnOnce(&Splats) -> Picture,
) -> Picture {
    let list = cut::drawn(instances, view, [width, height], style);
    let instances: Vec<_> = instances.iter().map(|(cloud, transform)| Instance::of(cloud, *transform)).collect();
    let (instances, list) = (instances.as_slice(), &list);
    draw(&Splats { instances, list, view, width, height, technique, style, host_depth: None })
}
