//! `surfel render`: from inputs to a picture, its table and its statistics.

use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use glam::DMat4;

use surfel::ash::vk;
use surfel::load::attributes::{self, RadiusRule};
use surfel::load::{Bounds, PointCloud};
use surfel::select::View;
use surfel::standalone::{DeviceInfo, Layers, Offscreen, Options, Shot, Standalone};
use surfel::structure::Flat;
use surfel::style::Style;
use surfel::technique::Technique;
use surfel::{CloudId, Instance};

use super::args::{ColorBy, RenderArgs, Shade};
use super::camera::{Lens, Pose, Subject};
use super::look::Has;
use super::parse::Radius;
use super::progress::Progress;
use super::report::Report;
use super::{Outcome, camera, color, frames, input, look, memory, output};

/// Renders. What can be refused is refused before anything long begins: usage, outputs, device, size, then the files.
pub fn run(args: &RenderArgs) -> Result<Outcome> {
    let pose = match (args.orbit, args.eye, args.target) {
        (Some(orbit), ..) => Pose::Orbit(orbit),
        (_, Some(eye), Some(target)) => Pose::LookAt { eye, target },
        _ => Pose::Default,
    };
    output::check_png_name(&args.output)?;
    camera::check(pose, args.up)?;
    let technique = look::technique(args)?;
    output::check(&args.output)?;
    if let Some(path) = &args.stats {
        output::check(path)?;
        if output::place(path) == output::place(&args.output) {
            bail!("{}: picture and statistics cannot be one file", path.display());
        }
    }
    readable(args)?;

    let layers = if args.validate { Layers::CORE_SYNC } else { Layers::default() };
    let standalone = Standalone::new(&Options { device: args.device.clone(), layers, ..Default::default() })?;
    let lacking = standalone.lacking(layers);
    if !lacking.is_empty() {
        bail!("--validate: checks that the layers do not switch on: {}", lacking.join(", "));
    }
    let device = standalone.info.clone();
    let [width, height] = args.size;
    fits(&device, args.size)?;
    let mut offscreen = Offscreen::new(standalone, vk::Extent2D { width, height }, false)?;
    let done = picture(args, pose, technique, device, &mut offscreen);
    // Whatever happened: destroyed in order, so that the layers can tell what was left alive.
    let messages = offscreen.destroy().close();
    for message in &messages {
        // Nothing is left to do where stderr is closed.
        let _ = writeln!(io::stderr(), "validation: {}: {}", message.id, message.text);
    }
    let mut report = done?;
    report.validation_messages = messages.len();
    if let Some(path) = &args.stats {
        let text = format!("{:#}\n", report.json());
        output::write(path, |out| Ok(out.write_all(text.as_bytes())?))?;
    }
    let table = if args.quiet { String::new() } else { report.table() };
    super::print(&format!("{}\n{table}", args.output.display()))?;
    Ok(if messages.is_empty() { Outcome::Done } else { Outcome::Spoken })
}

/// A name that is not there is told before a device is made.
fn readable(args: &RenderArgs) -> Result<()> {
    for input in &args.inputs {
        if let super::parse::Input::File(path) = input {
            std::fs::metadata(path).with_context(|| path.display().to_string())?;
            if same(path, &args.output) || args.stats.as_ref().is_some_and(|s| same(path, s)) {
                bail!("{}: is an input, and would be overwritten", path.display());
            }
        }
    }
    Ok(())
}

fn same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Targets lie in this machine's memory where the device is its processor; what is read back always does.
fn fits(device: &DeviceInfo, [width, height]: [u32; 2]) -> Result<()> {
    // Read back: as copied, as bytes, as floats, encoded. Targets: three of four floats, and a depth.
    let a_pixel = 16 + 16 + 16 + 8 + if device.kind == "cpu" { 3 * 16 + 4 } else { 0 };
    let pixels = width as u64 * height as u64;
    memory::ensure(&format!("a picture of {width}x{height}"), pixels.saturating_mul(a_pixel))
}

fn picture(
    args: &RenderArgs,
    pose: Pose,
    technique: Technique,
    device: DeviceInfo,
    offscreen: &mut Offscreen,
) -> Result<Report> {
    // A quarter of a gibibyte a frame: what is staged does not double the memory of large clouds.
    offscreen.renderer.upload_budget = 256 << 20;
    let progress = Progress::new(args.quiet);
    let scene = Scene::load(args, pose, &progress)?;
    let Scene { flats, view, style, points_input, assumed } = scene;
    let mut instances = Vec::new();
    for flat in flats {
        let cloud: CloudId = offscreen.renderer.add(Arc::new(flat))?;
        instances.push(Instance { cloud, transform: DMat4::IDENTITY });
    }
    let shot = Shot { view: &view, instances: &instances, technique, style: &style, count: false };
    let account = frames::draw(offscreen, &shot, args.warmup, args.frames, &progress)?;
    let picture = offscreen.read()?;
    {
        let _step = progress.step("write the picture", 1);
        output::png(&args.output, picture.width, picture.height, &picture.encode(args.background))?;
    }
    let mut skipped = Vec::new();
    if args.threshold.is_some() {
        skipped.push(("threshold", "the flat structure has no level of detail: every point is drawn"));
    }
    if !args.validate {
        skipped.push(("validation", "not asked for (--validate)"));
    }
    Ok(Report { device, size: args.size, technique, points_input, account, skipped, validation_messages: 0, assumed })
}

/// Everything that does not need the device.
struct Scene {
    flats: Vec<Flat>,
    view: View,
    style: Style,
    points_input: u64,
    assumed: Vec<String>,
}

impl Scene {
    fn load(args: &RenderArgs, pose: Pose, progress: &Progress) -> Result<Scene> {
        let read: Vec<PointCloud> = args.inputs.iter().map(|i| input::read(i, progress)).collect::<Result<_>>()?;
        let mut clouds = input::join(read)?;
        let points_input = clouds.iter().map(|c| c.report.points_in_file).sum();
        let has = Has::of(&clouds);
        let (shade, shade_said) = look::shade(args, has);
        let (by, color_said) = look::color(args, has);
        let (up, up_given, up_said) = look::up(args, &clouds);
        let Some(bounds) = input::bounds(&clouds) else { bail!("there is no point in the input") };
        for cloud in &mut clouds {
            complete(cloud, args, shade, by, &bounds, progress);
        }
        let mut assumed = input::sentences(&clouds);
        assumed.extend([up_said, color_said, shade_said].into_iter().flatten());
        assumed.extend(color::paint(&mut clouds, by, up, &bounds)?);

        let balls = input::balls(&clouds, &bounds);
        let viewpoint = clouds.iter().find_map(|c| c.viewpoint);
        let subject = Subject { bounds, balls: &balls, viewpoint };
        let aspect = args.size[0] as f64 / args.size[1] as f64;
        let lens = Lens { up, up_given, fov: args.fov.map(f64::to_radians), aspect };
        let (view, view_said) = camera::view(pose, &subject, &lens);
        assumed.extend(view_said);
        // One at a time: a cloud's arrays are given back as soon as they are packed.
        let flats = clouds.into_iter().map(|cloud| Flat::new(&cloud)).collect();
        Ok(Scene { flats, view, style: look::style(args, shade), points_input, assumed })
    }
}

/// Normals and radii, unless nothing in the picture depends on them.
fn complete(
    cloud: &mut PointCloud,
    args: &RenderArgs,
    shade: Shade,
    by: ColorBy,
    bounds: &Bounds,
    progress: &Progress,
) {
    let rule = match args.radius {
        Radius::Auto => RadiusRule::Auto,
        Radius::Scale(scale) => RadiusRule::Scale(scale),
        Radius::Value(value) => RadiusRule::Value(value),
        Radius::Pixels(_) => {
            // The size on the screen is given; the radius only says which points are splats at all.
            let any = (1e-3 * bounds.radius) as f32;
            cloud.radii = Some(vec![if any > 0.0 && any.is_finite() { any } else { 1.0 }; cloud.len()]);
            if matches!(shade, Shade::None | Shade::Edl) && by != ColorBy::Normal {
                cloud.normals = None;
                return;
            }
            RadiusRule::Auto
        }
    };
    let step = progress.step("normals and radii", 1000);
    let told = |share| step.share(share);
    attributes::complete(cloud, &attributes::Options { radius: rule, progress: Some(&told), ..Default::default() });
}
