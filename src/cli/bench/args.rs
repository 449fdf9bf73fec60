//! What may be asked of `surfel bench`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::super::args::{LensArgs, LevelArgs, LookArgs, axis, inputs};
use super::super::camera::Named;
use super::super::parse::{self, Input, MAX_POINTS};
use surfel::structure::Arrangement;
use surfel::structure::groups::Relax;
use surfel::style::{Ellipse, Front, Interval, SumPrecision, Voronoi};
use surfel::technique::{PRESETS, Selection, Structure, Technique};

/// Measures time against error. `surfel bench raw` measures what the device could do at best.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct BenchArgs {
    #[command(subcommand)]
    pub command: Option<BenchCommand>,
    #[command(flatten)]
    pub sweep: SweepArgs,
}

#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Points and fragments a second by size, primitive, vertex format and attachments.
    Raw(RawArgs),
}

/// What the pictures are judged by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TruthKind {
    /// The mesh where the input has faces, else the supersampled reference.
    Auto,
    /// A ray cast of the input's faces, interpolated normals and colours.
    Mesh,
    /// All points in f64, two-pass, at eight times the size.
    Supersampled,
}

/// Where the input is looked at from.
#[derive(Debug, Clone, PartialEq)]
pub enum Views {
    /// So many, evenly spread.
    Around(u32),
    /// Each once.
    Named(Vec<Named>),
}

impl Views {
    /// How many.
    pub fn len(&self) -> u32 {
        match self {
            Views::Around(n) => *n,
            Views::Named(names) => names.len() as u32,
        }
    }

    /// What `--view` calls one of them.
    pub fn name(&self, number: u32) -> Option<String> {
        let Views::Named(names) = self else { return None };
        Some(names.get(number as usize)?.to_possible_value()?.get_name().to_owned())
    }
}

fn views(text: &str) -> Result<Views, String> {
    if let Ok(n) = text.parse::<u32>() {
        return match n {
            1..=1000 => Ok(Views::Around(n)),
            _ => Err("1 to 1000 views".into()),
        };
    }
    let mut names = Vec::new();
    for name in text.split(',') {
        let named = Named::from_str(name, false)
            .map_err(|_| format!("{name:?} is no view: a number, or names of distance, border, centre"))?;
        if !names.contains(&named) {
            names.push(named);
        }
    }
    Ok(Views::Named(names))
}

/// Every value of every list is combined with every other.
#[derive(Debug, Args)]
pub struct SweepArgs {
    /// Files (PLY, LAS, LAZ, E57), or `scene:NAME[:POINTS[:SEED]]`; each is measured by itself.
    #[arg(required = true, value_name = "INPUT", value_parser = inputs())]
    pub inputs: Vec<Input>,
    /// Folder for report.html, results.json, results.csv and the pictures. What is finished there is not done again.
    #[arg(short, long, value_name = "DIR", required = true)]
    pub out: Option<PathBuf>,
    /// Number of views, evenly spread about the input, each as near as everything fits; or names of `surfel render --view`.
    #[arg(long, value_name = "N|NAME,…", default_value = "3", value_parser = views)]
    pub views: Views,
    /// Sizes of the picture in pixels.
    #[arg(long, value_name = "WxH,…", default_value = "640x640", value_delimiter = ',', value_parser = parse::size)]
    pub sizes: Vec<[u32; 2]>,
    /// Techniques by name [default: all].
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = axis(PRESETS))]
    pub techniques: Vec<Technique>,
    /// How points are arranged: each technique with each of these.
    #[arg(long, value_name = "NAME,…", default_value = "flat", value_delimiter = ',', value_parser = axis(Structure::ALL))]
    pub structures: Vec<Structure>,
    /// For structures with levels of detail: thresholds in pixels.
    #[arg(long, value_name = "PX,…", default_value = "1", value_delimiter = ',', value_parser = parse::positive)]
    pub thresholds: Vec<f64>,
    /// For structures that are tested point by point: where.
    #[arg(long, value_name = "NAME,…", default_value = "compute", value_delimiter = ',', value_parser = axis(Selection::ALL))]
    pub selections: Vec<Selection>,
    /// For those: which test.
    #[arg(long, value_name = "NAME,…", default_value = "exact", value_delimiter = ',', value_parser = axis(Interval::ALL))]
    pub intervals: Vec<Interval>,
    /// How outlines are computed.
    #[arg(long, value_name = "NAME,…", default_value = "exact", value_delimiter = ',', value_parser = axis(Ellipse::ALL))]
    pub ellipses: Vec<Ellipse>,
    /// Floats that colours and weights are summed in.
    #[arg(long, value_name = "NAME,…", default_value = "single", value_delimiter = ',', value_parser = axis(SumPrecision::ALL))]
    pub sums: Vec<SumPrecision>,
    /// Splat sizes: factors on the radii.
    #[arg(long, value_name = "S,…", default_value = "1", value_delimiter = ',', value_parser = parse::positive)]
    pub scales: Vec<f64>,
    /// Depth tolerances in radii [default: the one of `--tolerance`].
    #[arg(long, value_name = "REL,…", value_delimiter = ',', value_parser = parse::positive)]
    pub tolerances: Vec<f64>,
    /// For groups: c, 0 to 1 [default: that of `surfel render`].
    #[arg(long, value_name = "C,…", default_values_t = [Relax::default().factor], value_delimiter = ',', value_parser = parse::factor)]
    pub factors: Vec<f32>,
    /// For groups: what decides between splats of one group that overlap.
    #[arg(long, value_name = "NAME,…", default_value = "cones", value_delimiter = ',', value_parser = axis(Voronoi::ALL))]
    pub voronois: Vec<Voronoi>,
    /// For fuzzy: the depth that a pixel keeps as its front.
    #[arg(long, value_name = "NAME,…", default_value = "nearest", value_delimiter = ',', value_parser = axis(Front::ALL))]
    pub fronts: Vec<Front>,
    /// Orders of storage; those for a view are made for each.
    #[arg(long, value_name = "NAME,…", default_value = "as-read", value_delimiter = ',', value_parser = axis(Arrangement::ALL))]
    pub storages: Vec<Arrangement>,
    /// Numbers of points: the faces are sampled evenly so often, instead of drawing the vertices.
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=MAX_POINTS as i64))]
    pub samples: Vec<u32>,
    #[command(flatten)]
    pub levels: LevelArgs,
    /// What the pictures are judged by.
    #[arg(long, value_enum, default_value = "auto")]
    pub truth: TruthKind,
    /// Rounds: in each, every combination is timed once, so that a disturbance meets all of them.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// Timed frames of a combination in a round, after one untimed.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub frames: u32,
    #[command(flatten)]
    pub lens: LensArgs,
    #[command(flatten)]
    pub look: LookArgs,
    /// Colour behind the points.
    #[arg(long, value_name = "RRGGBB", default_value = "1d1f23", value_parser = parse::color)]
    pub background: [u8; 4],
    /// Runs the numerical stress suite as well, for the report.
    #[arg(long)]
    pub stress: bool,
    /// A results.json of before: says what is faster or slower, with confidence intervals.
    #[arg(long, value_name = "OLD.json")]
    pub baseline: Option<PathBuf>,
    /// Part of the name of the device to use [default: the fastest kind].
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// No progress on stderr, and only the report's path on stdout.
    #[arg(short, long)]
    pub quiet: bool,
}

#[derive(Debug, Args)]
pub struct RawArgs {
    /// Writes device, cases and every single time.
    #[arg(short, long, value_name = "FILE.json")]
    pub out: Option<PathBuf>,
    /// Points of a case; those of more than 16 pixels are fewer, for as many fragments.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    pub points: u32,
    /// Size of the picture in pixels, at least 64x64.
    #[arg(long, value_name = "WxH", default_value = "640x640", value_parser = parse::size)]
    pub size: [u32; 2],
    /// Rounds: in each, every case is timed once, so that a disturbance meets all of them.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// Part of the name of the device to use [default: the fastest kind].
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// A file of `--out` of before: says what is faster or slower, with confidence intervals.
    #[arg(long, value_name = "OLD.json")]
    pub baseline: Option<PathBuf>,
    /// Only whether it runs: 20,000 points, 160x160, 5 rounds.
    #[arg(long, conflicts_with_all = ["points", "size", "rounds"])]
    pub quick: bool,
    /// No progress on stderr and no table on stdout.
    #[arg(short, long)]
    pub quiet: bool,
}
