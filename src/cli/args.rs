//! What may be asked, by which names. Scripts rely on them.

use std::path::PathBuf;

use clap::builder::{OsStringValueParser, PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use glam::DVec3;

use super::bench::args::BenchArgs;
use super::camera::Named;
use super::fly::args::FlyArgs;
use super::offscreen::DeviceArgs;
use super::parse::{self, Input, MAX_POINTS, Orbit, Radius};
use surfel::standalone::Layers;
use surfel::structure::groups::Relax;
use surfel::structure::layered::{Normals, Sampling};
use surfel::structure::nodes::ErrorRule;
use surfel::structure::{Arrangement, Packing};
use surfel::style::{Ellipse, Front, Interval, SumPrecision, Voronoi};
use surfel::technique::{Blend, Primitive, Selection, Structure};

/// Renders point scans (LiDAR, photogrammetry, dense meshes) as elliptical Gaussian splats with Vulkan.
#[derive(Debug, Parser)]
#[command(name = "surfel", version, propagate_version = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Renders scans into a picture.
    Render(Box<RenderArgs>),
    /// Draws the picture that is right, without Vulkan: what others are measured by.
    Reference(Box<ReferenceArgs>),
    /// Builds a layered point cloud of scans of any size, in bounded memory.
    Build(BuildArgs),
    /// Says what is in a scan.
    Info(InfoArgs),
    /// Measures how two pictures differ.
    Compare(CompareArgs),
    /// Measures time against error, and writes a report.
    Bench(Box<BenchArgs>),
    /// Flies through a layered point cloud that comes as it is needed, and measures the frames.
    Fly(Box<FlyArgs>),
    /// Lists the Vulkan devices of this machine.
    Devices,
    /// Tries every technique and planted faults with the validation layers on.
    Selftest(SelftestArgs),
}

/// Light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Shade {
    /// The colours as they are.
    None,
    /// A lamp at the eye.
    Headlight,
    /// A lamp over the left shoulder, with highlights.
    Phong,
    /// Eye-dome lighting: what lies behind its neighbours is darker. Needs no normals.
    Edl,
}

/// What the points' colours show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ColorBy {
    /// The scan's colours.
    Rgb,
    /// The returns' strength, in grey.
    Intensity,
    /// LAS classes.
    Class,
    /// Height along `--up`.
    Height,
    /// The direction of the normal.
    Normal,
}

/// What is done with splats that face away.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Cull {
    /// Dropped where the surface is known to be closed.
    Auto,
    /// Always dropped.
    On,
    /// Never dropped.
    Off,
}

pub(super) fn inputs() -> impl TypedValueParser<Value = Input> {
    OsStringValueParser::new().try_map(parse::input)
}

/// Choices of an axis of the technique, by the library's own names.
pub(super) fn axis<T: Copy + Send + Sync + 'static>(
    all: &'static [(&'static str, T)],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.iter().map(|(name, _)| *name))
        .try_map(move |name| all.iter().find(|(n, _)| *n == name).map(|(_, v)| *v).ok_or("unknown"))
}

/// What is seen, and from where.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// Size of the picture in pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse::size)]
    pub size: [u32; 2],
    /// Azimuth and elevation in degrees, distance in radii of the bounding sphere. Azimuth 0 looks along −Z where y is
    /// up, along +Y where z is up.
    #[arg(long, value_name = "AZ,EL,DIST", allow_hyphen_values = true, conflicts_with_all = ["eye", "target"], value_parser = parse::orbit)]
    pub orbit: Option<Orbit>,
    /// Where the viewer stands, in the input's coordinates.
    #[arg(long, value_name = "x,y,z", allow_hyphen_values = true, requires = "target", value_parser = parse::vector)]
    pub eye: Option<DVec3>,
    /// A view that means the same for every scan.
    #[arg(long, value_enum, value_name = "NAME", conflicts_with_all = ["orbit", "eye", "target"])]
    pub view: Option<Named>,
    /// What the viewer looks at.
    #[arg(long, value_name = "x,y,z", allow_hyphen_values = true, requires = "eye", value_parser = parse::vector)]
    pub target: Option<DVec3>,
    #[command(flatten)]
    pub lens: LensArgs,
}

/// What every view has.
#[derive(Debug, Args)]
pub struct LensArgs {
    /// Which way is up [default: as the file says, else y for PLY].
    #[arg(long, value_name = "x|y|z|x,y,z", allow_hyphen_values = true, value_parser = parse::up)]
    pub up: Option<DVec3>,
    /// Vertical angle of view in degrees [default: 45, or 70 for the default view from inside].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = parse::fov)]
    pub fov: Option<f64>,
}

/// How the points become a picture.
#[derive(Debug, Args)]
pub struct TechniqueArgs {
    /// How the points are arranged.
    #[arg(long, value_name = "NAME", default_value = "flat", value_parser = axis(Structure::ALL))]
    pub structure: Structure,
    /// How splats of one pixel become one colour [default: fuzzy, or opaque with `--radius px:N`].
    #[arg(long, value_name = "NAME", value_parser = axis(Blend::ALL))]
    pub blend: Option<Blend>,
    /// Level of detail in pixels: how large the error, or the spacing, of what stands for finer points may be [default: 1].
    /// The flat structure has none: nothing is left out.
    #[arg(long, value_name = "PX", allow_negative_numbers = true, value_parser = parse::positive)]
    pub threshold: Option<f64>,
    /// Where structures that are tested point by point are: in the vertex stage, or in a compute pass that compacts.
    #[arg(long, value_name = "vertex|compute", default_value = "compute", value_parser = axis(Selection::ALL))]
    pub selection: Selection,
    /// For those structures: the exact test, or the published one, which draws some points along with their ancestors.
    #[arg(long, value_name = "exact|published", default_value = "exact", value_parser = axis(Interval::ALL))]
    pub interval: Interval,
    /// What is rasterised for a splat.
    #[arg(long, value_name = "point|quad", default_value = "point", value_parser = axis(Primitive::ALL))]
    pub primitive: Primitive,
    /// How a splat's outline is computed.
    #[arg(long, value_name = "NAME", default_value = "exact", value_parser = axis(Ellipse::ALL))]
    pub ellipse: Ellipse,
    /// Floats that colours and weights are summed in: half is for devices short of bandwidth.
    #[arg(long, value_name = "single|half", default_value = "single", value_parser = axis(SumPrecision::ALL))]
    pub sums: SumPrecision,
    /// For fuzzy: the depth that a pixel keeps as its front, the nearest or (as published) the first.
    #[arg(long, value_name = "nearest|first", default_value = "nearest", value_parser = axis(Front::ALL))]
    pub front: Front,
    /// For groups: what decides between splats of one group that overlap.
    #[arg(long, value_name = "cones|slabs|off", default_value = "cones", value_parser = axis(Voronoi::ALL))]
    pub voronoi: Voronoi,
}

/// How points are arranged before they are drawn.
#[derive(Debug, Args)]
pub struct StructureArgs {
    /// In which order points are stored: it changes what fuzzy draws, and how long any blend takes. The last two are for the
    /// view of the picture.
    #[arg(long, value_name = "ORDER", default_value = "as-read", value_parser = axis(Arrangement::ALL))]
    pub storage: Arrangement,
    #[command(flatten)]
    pub levels: LevelArgs,
    /// For groups: c, 0 to 1. Splats share a group where their centres are farther apart than c times the sum of their radii.
    #[arg(long, value_name = "C", default_value_t = Relax::default().factor, allow_negative_numbers = true, value_parser = parse::factor)]
    pub group_factor: f32,
    /// For groups: most of them, each a layer of attachments. Where they are not enough, splats of one group overlap more.
    #[arg(long, value_name = "K", default_value_t = Relax::default().limit, value_parser = clap::value_parser!(u32).range(1..=256))]
    pub group_limit: u32,
    /// For groups: read from here if the file fits, else made and written here, so that they are made once.
    #[arg(long, value_name = "FILE")]
    pub groups: Option<PathBuf>,
}

/// How many bytes points have, and how structures with levels of detail are built.
#[derive(Debug, Args)]
pub struct LevelArgs {
    /// Bytes a point: as it is, with exact positions and colours but smaller codes for the rest (16 B, with normals 18 B), or with
    /// positions in steps of the box of 256 points as well (8 B, with normals and colours 9 B).
    #[arg(long, value_name = "full|exact|quantised", default_value = "full", value_parser = axis(Packing::ALL))]
    pub packing: Packing,
    /// For sequential: which error of a node is held against the threshold.
    #[arg(long, value_name = "geometric|split|diameter", default_value = "geometric", value_parser = axis(&ErrorRule::ALL[..3]))]
    pub error: ErrorRule,
    /// For sequential: a list for each of 128 ranges of normals, so that those of a closed surface that face away are skipped.
    #[arg(long)]
    pub clusters: bool,
    /// For structures with levels of detail: read from here if the file fits, else made and written here, so that they are made once.
    #[arg(long, value_name = "FILE")]
    pub tree: Option<PathBuf>,
    /// For octrees, and for sequential without `--clusters`: most points a block; 4000 for poisson, else 10000.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1 << 24))]
    pub block: Option<u32>,
}

/// How the surface looks, whatever draws it.
#[derive(Debug, Args)]
pub struct LookArgs {
    /// Light [default: headlight where the scan has normals or faces, else edl].
    #[arg(long, value_enum)]
    pub shade: Option<Shade>,
    /// What colours show [default: rgb, intensity or height, whichever the scan has first].
    #[arg(long, value_enum)]
    pub color: Option<ColorBy>,
    /// Radius of splats: automatic, a length in the input's unit, a factor on the automatic one, `angle:DEG` for a scanner's
    /// angular step times the distance from it (`angle:auto`: the step that the file tells), or `px:N` for opaque points of
    /// N pixels.
    #[arg(long, value_name = "auto|VALUE|scale:S|angle:DEG|angle:auto|px:N", default_value = "auto", allow_negative_numbers = true, value_parser = parse::radius)]
    pub radius: Radius,
    /// Where the scanner stood, in the input's coordinates [default: as the file says]: normals are turned to it, and
    /// `--radius angle:DEG` measures from it.
    #[arg(long, value_name = "x,y,z", allow_hyphen_values = true, value_parser = parse::vector)]
    pub scanner: Option<DVec3>,
    /// How far behind the front still is the same surface, in radii of the splat.
    #[arg(long, value_name = "REL", default_value = "1", allow_negative_numbers = true, value_parser = parse::positive)]
    pub tolerance: f64,
    /// Splats that face away.
    #[arg(long, value_enum, default_value = "auto")]
    pub cull: Cull,
    /// Adds eye-dome lighting of this strength to any light [1 with `--shade edl`].
    #[arg(long, value_name = "STRENGTH", allow_negative_numbers = true, value_parser = parse::not_negative)]
    pub edl: Option<f64>,
}

/// What is drawn into which picture, by whatever draws it.
#[derive(Debug, Args)]
pub struct PictureArgs {
    /// Files (PLY, LAS, LAZ, E57), or `scene:NAME[:POINTS[:SEED]]` for a scene from formulas, such as `scene:demo`; or one
    /// scene file (JSON) that draws inputs many times.
    #[arg(required = true, value_name = "INPUT", value_parser = inputs())]
    pub inputs: Vec<Input>,
    /// The picture to write. EXR has linear light, premultiplied, without background, and the depth along the view (Z).
    #[arg(short, long, value_name = "OUT.png|OUT.exr")]
    pub output: PathBuf,
    #[command(flatten)]
    pub view: ViewArgs,
    #[command(flatten)]
    pub technique: TechniqueArgs,
    #[command(flatten)]
    pub structure: StructureArgs,
    #[command(flatten)]
    pub look: LookArgs,
    /// Colour behind the points; its alpha stays in the picture.
    #[arg(long, value_name = "RRGGBB[AA]", default_value = "1d1f23", value_parser = parse::color)]
    pub background: [u8; 4],
    /// No progress on stderr and no table on stdout, only the picture's path.
    #[arg(short, long)]
    pub quiet: bool,
}

#[derive(Debug, Args)]
pub struct RenderArgs {
    #[command(flatten)]
    pub picture: PictureArgs,
    /// Frames to time. One more, before them, counts points and builds what is built once.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub frames: u32,
    /// Frames to draw untimed before.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=100_000))]
    pub warmup: u32,
    /// For --structure layered: most samples; the threshold grows until they suffice.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=u32::MAX as u64))]
    pub points: Option<u64>,
    /// Draws so many points spread evenly over the faces, in place of the vertices: for one input with faces.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=MAX_POINTS as i64))]
    pub samples: Option<u32>,
    /// Writes what the frames did and took.
    #[arg(long, value_name = "FILE.json")]
    pub stats: Option<PathBuf>,
    #[command(flatten)]
    pub on: DeviceArgs,
}

/// What is taken for true.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TruthKind {
    /// Nothing more than `render` draws: the same splats, exactly.
    None,
    /// The input's faces, by rays.
    Mesh,
    /// The splats, with many samples a pixel.
    Supersampled,
}

#[derive(Debug, Args)]
pub struct ReferenceArgs {
    #[command(flatten)]
    pub picture: PictureArgs,
    /// What is drawn.
    #[arg(long, value_enum, default_value = "none")]
    pub truth: TruthKind,
    /// Samples along a pixel's side [default: 4 for mesh, 8 for supersampled].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub samples: Option<u32>,
}

/// How a layered point cloud is built.
#[derive(Debug, Args)]
pub struct BuildArgs {
    /// Files (PLY, LAS, LAZ, E57), or `scene:NAME[:POINTS[:SEED]]`, that share one world and become one model.
    #[arg(required = true, value_name = "INPUT", value_parser = inputs())]
    pub inputs: Vec<Input>,
    /// The model to write. Temporary files lie beside it.
    #[arg(short, long, value_name = "MODEL.lpc")]
    pub output: PathBuf,
    /// M, samples a node.
    #[arg(long, value_name = "M", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(64..=65536))]
    pub patch: u32,
    /// K, candidates that a sample is chosen from: more leave fewer holes where points lie thinly, and take longer.
    #[arg(long, value_name = "K", default_value_t = 16, value_parser = clap::value_parser!(u32).range(2..=64))]
    pub candidates: u32,
    /// Which candidates are kept: those that keep apart, or (as published) any.
    #[arg(long, value_name = "elimination|random", default_value = "elimination", value_parser = axis(Sampling::ALL))]
    pub sampling: Sampling,
    /// Of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// How far a position may be moved, in local spacings; as published 0.5.
    #[arg(long, value_name = "SHARE", default_value = "0.125", allow_negative_numbers = true, conflicts_with = "exact", value_parser = parse::positive)]
    pub precision: f64,
    /// Keeps positions, normals and radii as they are read.
    #[arg(long)]
    pub exact: bool,
    /// Normals: the input's or else estimated, the input's or none, or estimated whatever it has. Where they are estimated,
    /// missing radii are too.
    #[arg(long, value_name = "auto|input|estimate", default_value = "auto", value_parser = axis(Normals::ALL))]
    pub normals: Normals,
    /// Stores every sample's group, for `fly --blend groups`.
    #[arg(long)]
    pub groups: bool,
    /// c, 0 to 1. Samples share a group where their centres are farther apart than c times the sum of their radii.
    #[arg(long, value_name = "C", default_value_t = Relax::default().factor, requires = "groups", allow_negative_numbers = true, value_parser = parse::factor)]
    pub group_factor: f32,
    /// Most groups, each a layer of attachments. Where they are not enough, samples of one group overlap more.
    #[arg(long, value_name = "K", default_value_t = Relax::default().limit, requires = "groups", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub group_limit: u32,
    /// Memory to work in, such as 512M or 2G.
    #[arg(long, value_name = "BYTES", default_value = "1G", value_parser = parse::memory)]
    pub memory: u64,
    /// No progress on stderr and no table on stdout, only the model's path.
    #[arg(short, long)]
    pub quiet: bool,
}

#[derive(Debug, Args)]
pub struct InfoArgs {
    /// A file, or `scene:NAME[:POINTS[:SEED]]`, or a scene file (JSON).
    #[arg(value_name = "INPUT", value_parser = inputs())]
    pub input: Input,
    /// Reads and checks every patch of a layered point cloud.
    #[arg(long)]
    pub verify: bool,
    /// For programs.
    #[arg(long)]
    pub json: bool,
}

/// What a picture of the error shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ErrorMapKind {
    /// What one would notice, flipping between the pictures: FLIP, black for none to light yellow.
    Flip,
    /// The absolute error of each colour, 32 times as strong.
    Absolute,
}

#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The picture that is right: PNG, or EXR with linear, premultiplied colours, coverage and depth.
    #[arg(value_name = "TRUTH")]
    pub truth: PathBuf,
    /// The picture that is judged, of the same size.
    #[arg(value_name = "PICTURE")]
    pub picture: PathBuf,
    /// For programs.
    #[arg(long)]
    pub json: bool,
    /// Counts the pixels in which a channel differs by more than this, of 255.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub tolerance: u8,
    /// What an EXR is shown over, and a transparent PNG where the other is an EXR.
    #[arg(long, value_name = "RRGGBB", default_value = "1d1f23", value_parser = parse::color)]
    pub background: [u8; 4],
    /// Writes a picture of the error.
    #[arg(long, value_name = "OUT.png")]
    pub difference: Option<PathBuf>,
    /// What the picture of the error shows.
    #[arg(long, value_enum, default_value = "flip", requires = "difference")]
    pub map: ErrorMapKind,
}

#[derive(Debug, Args)]
pub struct SelftestArgs {
    /// Checks of the validation layers: core, sync, gpu-av.
    #[arg(long, value_name = "LIST", default_value = "core,sync", value_parser = Layers::parse)]
    pub layers: Layers,
    /// Writes a report that CI systems read.
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Part of the name of the device to use [default: the fastest kind].
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
}
