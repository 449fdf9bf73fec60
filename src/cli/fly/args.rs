//! What may be asked of `surfel fly`.

use std::path::PathBuf;

use clap::Args;
use glam::DVec3;

use super::super::args::{Cull, LensArgs, Shade, axis, inputs};
use super::super::offscreen::DeviceArgs;
use super::super::parse::{self, Input};
use surfel::select::layered::Rule;
use surfel::structure::layered::Streaming;
use surfel::technique::{Blend, Primitive};

/// Which way the camera goes.
#[derive(Debug, Clone, PartialEq)]
pub enum Course {
    /// Once round the model.
    Orbit,
    /// From afar to the surface and away again.
    Approach,
    /// Low over the ground, along the longer horizontal side.
    Street,
    /// Through the key frames of a file.
    File(PathBuf),
}

/// `orbit`, `approach`, `street`, or a file whose name ends in `.json`.
fn course(text: &str) -> Result<Course, String> {
    match text {
        "orbit" => Ok(Course::Orbit),
        "approach" => Ok(Course::Approach),
        "street" => Ok(Course::Street),
        _ if text.len() > 5 && text[text.len() - 5..].eq_ignore_ascii_case(".json") => Ok(Course::File(text.into())),
        _ => Err("orbit, approach, street, or a file of key frames, whose name ends in .json".into()),
    }
}

/// What is flown through, where, and what is told of it.
#[derive(Debug, Args)]
pub struct FlyArgs {
    /// A layered point cloud that `surfel build` made: a file, or an address of one.
    #[arg(value_name = "MODEL.lpc|URL", value_parser = inputs())]
    pub model: Input,
    /// Way of the camera.
    #[arg(long, value_name = "orbit|approach|street|FILE.json", default_value = "orbit", value_parser = course)]
    pub path: Course,
    /// Frames of one lap.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub frames: u32,
    /// How often the path is flown: on the first lap patches come, on later ones those are there that the cache could keep.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub laps: u32,
    /// Size of the picture in pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse::size)]
    pub size: [u32; 2],
    /// For the named paths: where they begin, in the input's coordinates [default: by the model's size].
    #[arg(long, value_name = "x,y,z", allow_hyphen_values = true, requires = "target", value_parser = parse::vector)]
    pub eye: Option<DVec3>,
    /// For the named paths: the middle of the orbit, the place that is approached, or the street's end.
    #[arg(long, value_name = "x,y,z", allow_hyphen_values = true, requires = "eye", value_parser = parse::vector)]
    pub target: Option<DVec3>,
    #[command(flatten)]
    pub lens: LensArgs,
    #[command(flatten)]
    pub streaming: StreamingArgs,
    #[command(flatten)]
    pub shown: ShownArgs,
    /// Writes the times and counts of the laps.
    #[arg(long, value_name = "FILE.json")]
    pub stats: Option<PathBuf>,
    /// Writes pictures into this folder, `lap1-00000.png` and so on. While one is written patches go on coming, and time goes on.
    #[arg(long, value_name = "DIR")]
    pub save: Option<PathBuf>,
    /// Every so many frames a picture.
    #[arg(long, value_name = "K", default_value_t = 10, requires = "save", value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    #[command(flatten)]
    pub on: DeviceArgs,
    /// No progress on stderr and no table on stdout, only the model's name.
    #[arg(short, long)]
    pub quiet: bool,
}

/// How patches come and stay.
#[derive(Debug, Args)]
pub struct StreamingArgs {
    /// Memory of the device for patches, such as 64M or 2G; no more is taken than the model needs.
    #[arg(long, value_name = "BYTES", default_value = "512M", value_parser = parse::bytes)]
    pub cache: u64,
    /// Most samples a frame; the threshold grows until they suffice.
    #[arg(long, value_name = "N", conflicts_with = "ms", value_parser = clap::value_parser!(u64).range(1..=u32::MAX as u64))]
    pub points: Option<u64>,
    /// How long a frame should take [ms]: the samples that it may have follow the frames before it.
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = parse::positive)]
    pub ms: Option<f64>,
    /// Does not look for what is hidden behind other things.
    #[arg(long)]
    pub no_occlusion: bool,
    /// Threads that read and decode.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub threads: u32,
    /// Frames over which a patch that has come fades in; 0: at once.
    #[arg(long, value_name = "N", default_value_t = Streaming::default().ramp, value_parser = clap::value_parser!(u32).range(..=1000))]
    pub ramp: u32,
    /// Which spacing of a patch is held against the threshold.
    #[arg(long, value_name = "measured|published", default_value = "measured", value_parser = axis(Rule::ALL))]
    pub rule: Rule,
}

/// How the surface looks.
#[derive(Debug, Args)]
pub struct ShownArgs {
    /// How splats of one pixel become one colour [default: fuzzy].
    #[arg(long, value_name = "NAME", value_parser = axis(Blend::ALL))]
    pub blend: Option<Blend>,
    /// What is rasterised for a splat.
    #[arg(long, value_name = "point|quad", default_value = "point", value_parser = axis(Primitive::ALL))]
    pub primitive: Primitive,
    /// Level of detail in pixels: how far apart samples may be in the picture.
    #[arg(long, value_name = "PX", default_value = "1", allow_negative_numbers = true, value_parser = parse::positive)]
    pub threshold: f64,
    /// Light [default: headlight where the model has normals, else edl].
    #[arg(long, value_enum)]
    pub shade: Option<Shade>,
    /// Adds eye-dome lighting of this strength to any light [1 with `--shade edl`].
    #[arg(long, value_name = "STRENGTH", allow_negative_numbers = true, value_parser = parse::not_negative)]
    pub edl: Option<f64>,
    /// How far behind the front still is the same surface, in radii of the splat.
    #[arg(long, value_name = "REL", default_value = "1", allow_negative_numbers = true, value_parser = parse::positive)]
    pub tolerance: f64,
    /// Splats that face away.
    #[arg(long, value_enum, default_value = "auto")]
    pub cull: Cull,
    /// Colour behind the points; its alpha stays in the picture.
    #[arg(long, value_name = "RRGGBB[AA]", default_value = "1d1f23", value_parser = parse::color)]
    pub background: [u8; 4],
}
