//! `surfel fly`: a fly-through of a layered point cloud, and what its frames did and took.

pub mod args;
mod extent;
mod laps;
mod path;
mod report;
mod tally;

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use glam::DVec3;

use surfel::standalone::{DeviceInfo, Offscreen};
use surfel::stream::{self, Access, FetchOptions, FileAccess};
use surfel::structure::layered::{Index, Layered, Streaming};
use surfel::style::Style;
use surfel::technique::{Blend, Structure, Technique};

use self::args::{Course, FlyArgs, ShownArgs, StreamingArgs};
use self::extent::Extent;
use self::laps::{Flight, fly};
use self::path::{Camera, Key};
use self::report::Report;
use super::args::{LookArgs, Shade};
use super::camera::{self, Pose};
use super::parse::{Input, Radius};
use super::progress::Progress;
use super::{Outcome, Usage, layered, look, memory, offscreen, output, scene};

/// Flies. What can be refused is refused before anything long begins: usage, outputs, key frames, device, size, then the model.
pub fn run(args: &FlyArgs) -> Result<Outcome> {
    let start = args.eye.zip(args.target).map(|(eye, target)| Key { eye, target });
    if let Some(Key { eye, target }) = start {
        camera::check(Pose::LookAt { eye, target }, args.lens.up)?;
    }
    if let Some(path) = &args.stats {
        output::check(path)?;
    }
    if let Some(folder) = &args.save {
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        output::check(&folder.join("lap1-00000.png"))?;
    }
    let outputs: Vec<&Path> = args.stats.iter().map(|p| p.as_path()).collect();
    let keys = match &args.path {
        Course::File(_) if start.is_some() => {
            return Err(
                Usage("--eye and --target are for the named paths: a file says where its path goes".into()).into()
            );
        }
        Course::File(path) => {
            scene::readable(&[Input::File(path.clone())], &outputs)?;
            Some(path::Path::read(path)?)
        }
        _ => None,
    };
    if matches!(args.model, Input::Scene { .. }) {
        return Err(Usage("a fly-through is of a model that `surfel build` made".into()).into());
    }
    scene::readable(std::slice::from_ref(&args.model), &outputs)?;

    let draw = |device, offscreen: &mut Offscreen| flown(args, keys, start, device, offscreen);
    let (mut report, messages) = offscreen::with(&args.on, args.size, false, draw)?;
    report.validation_messages = messages;
    if let Some(path) = &args.stats {
        let text = format!("{:#}\n", report.json());
        output::write(path, |out| Ok(out.write_all(text.as_bytes())?))?;
    }
    let table = if args.quiet { String::new() } else { report.table() };
    super::print(&format!("{}\n{table}", report.index.name))?;
    if let Some(fault) = report.fault().filter(|_| !report.shows_anything()) {
        bail!("{}: there never was a picture: {fault}", report.index.name);
    }
    Ok(if messages == 0 { Outcome::Done } else { Outcome::Spoken })
}

/// Opens the model and flies.
fn flown(
    args: &FlyArgs,
    keys: Option<path::Path>,
    start: Option<Key>,
    device: DeviceInfo,
    offscreen: &mut Offscreen,
) -> Result<Report> {
    let progress = Progress::new(args.quiet);
    let opened = Instant::now();
    let model = model(&args.model, &args.streaming)?;
    let index = Arc::clone(&model.index);
    let up = args.lens.up.or(index.up.map(|up| up.as_dvec3().normalize_or(DVec3::Y))).unwrap_or(DVec3::Y);
    let Some(extent) = Extent::of(&index, up) else { bail!("{}: there is no point in the model", index.name) };
    let (path, name) = match (keys, &args.path) {
        (Some(path), Course::File(file)) => (path, file.display().to_string()),
        (_, Course::Approach) => (path::Path::approach(&extent, start), "approach".into()),
        (_, Course::Street) => (path::Path::street(&extent, start), "street".into()),
        _ => (path::Path::orbit(&extent, start), "orbit".into()),
    };
    let (technique, style) = shown(&args.shown, &index);
    if technique.blend == Blend::Groups && index.groups.is_none() {
        bail!("{}: was built without groups: `surfel build --groups` stores them", index.name);
    }
    let fov = args.lens.fov.unwrap_or(45.0).to_radians();
    let camera = Camera::new(&extent, fov, args.size[0] as f64 / args.size[1] as f64);
    if device.kind == "cpu" {
        // The processor's memory is the device's: 16 B a sample, 4 more for normals and for colours.
        let bytes = index.samples().saturating_mul(16 + 4 * (index.normals as u64 + index.colors as u64));
        memory::ensure("the patches of the model", bytes.min(args.streaming.cache))?;
    }
    let cloud = offscreen.renderer.add(model)?;
    let flight = Flight {
        path: &path,
        camera,
        frames: args.frames,
        laps: args.laps,
        technique,
        style: &style,
        aim: args.streaming.ms,
        save: args.save.clone().map(|folder| (folder, args.every)),
        background: args.shown.background,
    };
    let laps = fly(&flight, offscreen, cloud, opened, &progress)?;
    let off_axis = camera.view(path.key(0, args.frames)).off_axis();
    Ok(Report {
        device,
        size: args.size,
        technique,
        threshold: [style.threshold as f64, off_axis],
        index,
        path: name,
        laps,
        validation_messages: 0,
    })
}

/// Of a file or an address.
fn model(input: &Input, args: &StreamingArgs) -> Result<Layered> {
    let access: Arc<dyn Access> = match input {
        Input::File(path) if !layered::is_model(input) => {
            bail!("{}: is no layered point cloud: `surfel build` makes one of it", path.display())
        }
        Input::File(path) => Arc::new(FileAccess::open(path)?),
        Input::Remote(address) => stream::open(address)?,
        Input::Scene { .. } => unreachable!("refused as usage"),
    };
    let streaming = Streaming {
        cache: args.cache,
        samples: args.points,
        occlusion: !args.no_occlusion,
        ramp: args.ramp,
        rule: args.rule,
        fetch: FetchOptions { threads: args.threads as usize, ..FetchOptions::default() },
        ..Streaming::default()
    };
    Ok(Layered::new(Arc::new(Index::read(&*access)?), access, streaming))
}

/// What draws, and how it looks.
fn shown(args: &ShownArgs, index: &Index) -> (Technique, Style) {
    let ShownArgs { shade, edl, tolerance, cull, .. } = *args;
    let shade = shade.unwrap_or(if index.normals { Shade::Headlight } else { Shade::Edl });
    let surface =
        LookArgs { shade: Some(shade), color: None, radius: Radius::Auto, scanner: None, tolerance, cull, edl };
    let style = Style { threshold: args.threshold as f32, ..look::surface(&surface, shade) };
    let blend = args.blend.unwrap_or(Technique::default().blend);
    (Technique { structure: Structure::Layered, primitive: args.primitive, blend, ..Technique::default() }, style)
}
