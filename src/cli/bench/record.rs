//! What was measured, one record a combination and view, and the files that hold it.

use std::fmt::Write as _;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use surfel::measure::Summary;
use surfel::measure::baseline::Samples;

use super::baseline::{self, Run};

/// Everything that distinguishes one measurement from another of the same sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Combination {
    /// The file's name without its folder, or the scene.
    pub input: String,
    /// Changes with the input's content: length and time of the file.
    pub input_state: String,
    /// Points that the faces were sampled at; none where the vertices themselves are drawn.
    pub samples: Option<u32>,
    /// Preset.
    pub technique: String,
    pub ellipse: String,
    /// Factor on the radii.
    pub scale: f64,
    /// Depth tolerance in radii.
    pub tolerance: f64,
    /// Format of the sums.
    pub sums: String,
    /// Front of `fuzzy`; none for other blends.
    #[serde(default)]
    pub front: Option<String>,
    /// What decides within a group; none for other blends than `groups`.
    #[serde(default)]
    pub voronoi: Option<String>,
    /// c of the groups; none for other blends.
    #[serde(default)]
    pub factor: Option<f32>,
    /// Order of storage.
    #[serde(default = "as_read")]
    pub storage: String,
    /// How points are arranged.
    #[serde(default = "flat")]
    pub structure: String,
    /// Level of detail \[px\]; none for structures without.
    #[serde(default)]
    pub threshold: Option<f64>,
    /// Where points are tested one by one, and how; none where they are not.
    #[serde(default)]
    pub selection: Option<String>,
    #[serde(default)]
    pub interval: Option<String>,
    /// Number of the view, and how many there are.
    pub view: [u32; 2],
    /// Its name, where it has one: then its number says nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view_name: Option<String>,
    /// \[px\]
    pub size: [u32; 2],
}

/// What all results before there was a choice had.
fn as_read() -> String {
    "as-read".into()
}

fn flat() -> String {
    "flat".into()
}

impl Combination {
    /// One line that no other combination has.
    pub fn key(&self) -> String {
        let Combination { input, input_state, view: [view, views], size: [width, height], .. } = self;
        let view = self.view_name.clone().unwrap_or_else(|| format!("{view}/{views}"));
        format!("{input} ({input_state}) {} view {view} {width}x{height}", self.way())
    }

    /// The view's name, or its number.
    pub fn view(&self) -> String {
        self.view_name.clone().unwrap_or_else(|| self.view[0].to_string())
    }

    /// The part that is chosen, whatever is looked at: points of one plot with the same way belong together.
    pub fn way(&self) -> String {
        let mut text = self.technique.clone();
        if self.structure != "flat" {
            let _ = write!(text, " {}", self.structure);
        }
        if let Some(px) = self.threshold {
            let _ = write!(text, " {px} px");
        }
        if self.ellipse != "exact" {
            let _ = write!(text, " {}", self.ellipse);
        }
        if self.scale != 1.0 {
            let _ = write!(text, " ×{}", self.scale);
        }
        if self.tolerance != 1.0 {
            let _ = write!(text, " ε {}", self.tolerance);
        }
        if self.sums != "single" {
            let _ = write!(text, " {}", self.sums);
        }
        if let Some(c) = self.factor {
            let _ = write!(text, " c {c}");
        }
        let unusual = [
            (&self.front, "nearest"),
            (&self.voronoi, "cones"),
            (&Some(self.storage.clone()), "as-read"),
            (&self.selection, "compute"),
            (&self.interval, "exact"),
        ]
        .map(|(name, usual)| name.clone().filter(|n| n != usual));
        for name in unusual.into_iter().flatten() {
            let _ = write!(text, " {name}");
        }
        if let Some(n) = self.samples {
            let _ = write!(text, " {n} points");
        }
        text
    }
}

/// One measurement.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Record {
    #[serde(flatten)]
    pub combination: Combination,
    pub points_submitted: u64,
    pub points_drawn: u64,
    pub draw_calls: u32,
    /// Layers of `groups`, 0 for other blends.
    #[serde(default)]
    pub layers: u32,
    pub device_bytes: u64,
    /// Bytes of the structure, for each point of the input.
    #[serde(default)]
    pub bytes_a_point: f64,
    /// Points that no test of a structure let pass.
    #[serde(default)]
    pub culled_interval: u64,
    /// Root of the mean squared side of a footprint \[px\].
    pub footprint: f64,
    /// Times of the splat passes and the composite on the device \[ms\], every timed frame; empty without timestamps.
    pub gpu_ms: Vec<f64>,
    /// From the start of recording to the device's completion \[ms\], every timed frame.
    pub frame_ms: Vec<f64>,
    /// Against the truth, as `surfel compare --json` has it.
    pub errors: Value,
    /// What the truth is.
    pub truth: String,
    /// And where it is, relative to the folder.
    pub truth_file: String,
    /// The picture, relative to the folder.
    pub picture: String,
}

impl Record {
    /// Device time where there are timestamps, else the frame's.
    pub fn times(&self) -> &[f64] {
        if self.gpu_ms.is_empty() { &self.frame_ms } else { &self.gpu_ms }
    }

    /// Median of [`times`](Self::times) \[ms\].
    pub fn time(&self) -> Option<Summary> {
        Summary::of(self.times())
    }

    /// An error by its key, `depth/max` for one of the depth; `None` where it has no value.
    pub fn error(&self, key: &str) -> Option<f64> {
        self.errors.pointer(&format!("/{key}"))?.as_f64()
    }
}

/// Of the file that is written and that `--baseline` reads.
pub const SCHEMA: &str = "surfel.bench/1";

/// What of a report matters for a comparison; `None` if it is none.
pub fn parse(report: &Value) -> Option<Run> {
    let records = Vec::<Record>::deserialize(&report["records"]).ok().filter(|_| report["schema"] == SCHEMA)?;
    run(&report["common"], &records).ok()
}

/// The same of records in memory. A case is named without what tells one input's state from another's: to compare with
/// what was there before is the point. Its samples are one a round, the median of the round's frames: frames that follow
/// each other share what disturbs them, and taken for independent would make the interval too narrow: simulated with five
/// rounds of three frames, half of whose variance is the round's, 11 % of unchanged cases are called different, and 3 % with
/// medians.
pub fn run(common: &Value, records: &[Record]) -> Result<Run> {
    let setting =
        baseline::setting(common, &["device", "driver", "look", "lens"]).context("device, driver, look, lens")?;
    let frames = common["frames"].as_u64().filter(|n| *n > 0).context("frames")? as usize;
    let rounds = |times: &[f64]| times.chunks(frames).filter_map(Summary::of).map(|s| s.median).collect();
    let case = |r: &Record| {
        let Combination { input, view: [view, views], size: [width, height], .. } = &r.combination;
        let view = r.combination.view_name.clone().unwrap_or_else(|| format!("{}/{views}", view + 1));
        let name = format!("{input} {} view {view} {width}x{height}", r.combination.way());
        Samples { name, values: rounds(r.times()) }
    };
    Ok(Run { setting, cases: records.iter().map(case).collect() })
}

/// A column of the table, and how to get it.
type Column = (&'static str, fn(&Record) -> Option<f64>);

/// Columns after the combination's.
const COLUMNS: &[Column] = &[
    ("points_submitted", |r| Some(r.points_submitted as f64)),
    ("points_drawn", |r| Some(r.points_drawn as f64)),
    ("gpu_ms_median", |r| Summary::of(&r.gpu_ms).map(|s| s.median)),
    ("gpu_ms_lower", |r| Summary::of(&r.gpu_ms).map(|s| s.lower)),
    ("gpu_ms_upper", |r| Summary::of(&r.gpu_ms).map(|s| s.upper)),
    ("frame_ms_median", |r| Summary::of(&r.frame_ms).map(|s| s.median)),
    ("layers", |r| Some(r.layers as f64)),
    ("device_bytes", |r| Some(r.device_bytes as f64)),
    ("bytes_a_point", |r| Some(r.bytes_a_point)),
    ("culled_interval", |r| Some(r.culled_interval as f64)),
    ("footprint_px", |r| Some(r.footprint)),
];

/// Errors in the table.
const ERRORS: &[&str] = &[
    "rmse",
    "psnr",
    "psnr_covered",
    "rmse_interior",
    "ssim",
    "flip",
    "max",
    "max_alpha",
    "over",
    "holes",
    "holes_inside",
    "spill",
    "outline",
    "depth/median",
    "depth/p99",
    "depth/max",
];

/// The records as comma-separated values, with a header (RFC 4180; empty where there is no value).
pub fn csv(records: &[Record]) -> String {
    let quoted = |text: &str| match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    };
    let mut header = vec![
        "input",
        "samples",
        "technique",
        "ellipse",
        "scale",
        "tolerance",
        "sums",
        "front",
        "voronoi",
        "factor",
        "storage",
        "view",
        "width",
        "height",
    ];
    header.extend(COLUMNS.iter().map(|(name, _)| name));
    header.extend(ERRORS);
    header.extend(["truth", "picture"]);
    let mut text = header.join(",") + "\r\n";
    for record in records {
        let c = &record.combination;
        let mut row = vec![
            quoted(&c.input),
            c.samples.map_or(String::new(), |n| n.to_string()),
            c.technique.clone(),
            c.ellipse.clone(),
            c.scale.to_string(),
            c.tolerance.to_string(),
            c.sums.clone(),
            c.front.clone().unwrap_or_default(),
            c.voronoi.clone().unwrap_or_default(),
            c.factor.map_or(String::new(), |c| c.to_string()),
            c.storage.clone(),
            c.view(),
            c.size[0].to_string(),
            c.size[1].to_string(),
        ];
        let number = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
        row.extend(COLUMNS.iter().map(|(_, get)| number(get(record))));
        row.extend(ERRORS.iter().map(|key| number(record.error(key))));
        row.extend([quoted(&record.truth), quoted(&record.picture)]);
        text += &(row.join(",") + "\r\n");
    }
    text
}

#[cfg(test)]
pub mod tests {
    use serde_json::json;

    use super::*;

    pub fn record(technique: &str, ms: f64, rmse: f64) -> Record {
        Record {
            combination: Combination {
                input: "a,b.ply".into(),
                input_state: "12 bytes".into(),
                samples: None,
                technique: technique.into(),
                ellipse: "exact".into(),
                scale: 1.0,
                tolerance: 1.0,
                sums: "single".into(),
                front: None,
                voronoi: None,
                factor: None,
                storage: as_read(),
                structure: flat(),
                threshold: None,
                selection: None,
                interval: None,
                view: [0, 1],
                view_name: None,
                size: [64, 48],
            },
            points_submitted: 10,
            points_drawn: 9,
            draw_calls: 2,
            layers: 0,
            bytes_a_point: 24.0,
            culled_interval: 0,
            device_bytes: 1000,
            footprint: 4.0,
            gpu_ms: vec![ms, 2.0 * ms, 0.5 * ms],
            frame_ms: vec![3.0 * ms],
            errors: json!({"rmse": rmse, "psnr": null}),
            truth: "mesh".into(),
            truth_file: "truth/0.exr".into(),
            picture: "pictures/0.png".into(),
        }
    }

    #[test]
    fn ways_and_keys() {
        let mut c = record("flat.two-pass.point", 1.0, 0.1).combination;
        assert_eq!(c.way(), "flat.two-pass.point");
        let plain = c.key();
        c.ellipse = "approximate".into();
        (c.scale, c.tolerance, c.sums, c.samples) = (0.5, 2.0, "half".into(), Some(7));
        assert_eq!(c.way(), "flat.two-pass.point approximate ×0.5 ε 2 half 7 points");
        (c.factor, c.voronoi, c.front, c.storage) =
            (Some(0.4), Some("slabs".into()), Some("nearest".into()), "morton".into());
        assert_eq!(c.way(), "flat.two-pass.point approximate ×0.5 ε 2 half c 0.4 slabs morton 7 points");
        assert_ne!(plain, c.key());
        c.view[0] = 1;
        assert!(c.key().contains("view 1/1 64x48"));
    }

    #[test]
    fn tables_are_rectangular_and_quoted() {
        let text = csv(&[record("t", 1.0, 0.25)]);
        let lines: Vec<&str> = text.split_terminator("\r\n").collect();
        assert_eq!(lines.len(), 2);
        assert!(lines[1].starts_with("\"a,b.ply\",,t,exact,1,1,single,,,,as-read,0,64,48,10,9,1,"));
        // The quoted comma is one more.
        assert_eq!(lines[1].matches(',').count(), lines[0].matches(',').count() + 1);
        assert!(lines[1].contains(",0.25,,"), "RMSE, then no PSNR: {}", lines[1]);
    }

    #[test]
    fn a_round_is_one_sample() {
        let mut r = record("t", 1.0, 0.25);
        r.gpu_ms = vec![1.0, 3.0, 2.0, 6.0, 5.0, 4.0];
        let mut common = json!({"device": "d", "driver": "1", "look": "", "lens": "", "frames": 3});
        assert_eq!(run(&common, &[r.clone()]).unwrap().cases[0].values, [2.0, 5.0]);
        common["frames"] = json!(0);
        assert!(run(&common, &[r]).is_err());
    }

    #[test]
    fn records_survive_json() {
        let r = record("t", 1.5, 0.25);
        let back: Record = serde_json::from_str(&serde_json::to_string(&r).unwrap()).unwrap();
        assert_eq!(back.combination, r.combination);
        assert_eq!((back.gpu_ms, back.errors), (r.gpu_ms, r.errors));
    }
}
