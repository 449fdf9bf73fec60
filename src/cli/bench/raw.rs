//! `surfel bench raw`: what the device could do at best.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use serde_json::{Value, json};

use surfel::measure::Summary;
use surfel::measure::baseline::{Change, Samples, Verdict, changes};
use surfel::standalone::raw::{LARGEST, Measured, Setup, Untimed, cases, measure};
use surfel::standalone::{DeviceInfo, Options, Standalone};
use surfel::technique::Primitive;

use super::args::RawArgs;
use crate::cli::progress::Progress;
use crate::cli::{Outcome, Usage, memory, output, print};

/// Of the file that `--out` writes and `--baseline` reads.
const SCHEMA: &str = "surfel.bench.raw/1";

/// Measures, tells, compares. A picture that is not as predicted fails, after everything is written.
pub fn run(args: &RawArgs) -> Result<Outcome> {
    let setup = match args.quick {
        true => Setup { points: 20_000, extent: [160, 160], rounds: 5 },
        false => Setup { points: args.points, extent: args.size, rounds: args.rounds },
    };
    if setup.extent.iter().any(|side| !(LARGEST..=65_535).contains(side)) {
        return Err(Usage(format!("--size: each side from {LARGEST}, the largest square, to 65535 pixels")).into());
    }
    let before = args.baseline.as_deref().map(Run::read).transpose()?;
    if let Some(out) = &args.out {
        if let Some(old) = args.baseline.as_ref().filter(|old| output::same(old, out)) {
            bail!("{}: is the baseline, and would be overwritten", old.display());
        }
        output::check(out)?;
    }
    let standalone = Standalone::new(&Options { device: args.device.clone(), ..Options::default() })?;
    fits(&standalone.info, &setup)?;
    let step = Progress::new(args.quiet).step("ceilings", 1);
    let results = measure(&standalone, &cases(), &setup, |done, all| step.set(done, all))?;
    drop(step);
    let value = as_json(&standalone.info, &setup, &results);
    if let Some(out) = &args.out {
        output::write(out, |file| Ok(writeln!(file, "{value:#}")?))?;
    }
    let mut text = String::new();
    if !args.quiet {
        text += &table(&standalone.info, &setup, &results);
    }
    if let (Some(before), Some(path)) = (before, &args.baseline) {
        let now = Run::parse(&value).ok_or_else(|| anyhow!("the report cannot be read back"))?;
        text += &compared(path, &before, &now);
    }
    print(&text)?;
    let wrong: Vec<_> = results
        .iter()
        .filter_map(|m| match &m.times {
            Err(Untimed::Wrong(how)) => Some(format!("{}: {how}", m.case)),
            _ => None,
        })
        .collect();
    if !wrong.is_empty() {
        bail!("{} does not draw what it must: {}", standalone.info.name, wrong.join("; "));
    }
    Ok(Outcome::Done)
}

/// Before the device is asked: points in all formats and their staging; attachments, one read back and the prediction.
fn fits(device: &DeviceInfo, setup: &Setup) -> Result<()> {
    let attachments = if device.kind == "cpu" { 4 * 16 + 4 + 8 + 4 + 4 + 8 } else { 0 };
    let points = setup.points as u64 * if device.kind == "cpu" { 12 + 16 + 8 + 2 * 16 } else { 2 * 16 };
    let pixels = setup.extent[0] as u64 * setup.extent[1] as u64;
    memory::ensure("the cases", points + pixels.saturating_mul(attachments + 3 * 16 + 4 * 4))
}

fn as_json(device: &DeviceInfo, setup: &Setup, results: &[Measured]) -> Value {
    let quartiles =
        |samples: &[f64]| Summary::of(samples).map(|s| json!({"median": s.median, "lower": s.lower, "upper": s.upper}));
    let case = |m: &Measured| {
        let c = &m.case;
        let (lacks, wrong) = match &m.times {
            Ok(_) => (None, None),
            Err(Untimed::Lacking(what)) => (Some(what), None),
            Err(Untimed::Wrong(how)) => (None, Some(how)),
        };
        json!({
            "name": c.to_string(),
            "axis": c.axis,
            "primitive": if c.primitive == Primitive::Quad { "quad" } else { "point" },
            "size_px": c.size,
            "vertices": c.vertices.name(),
            "passes": c.passes.name(),
            "attachments": c.attachments,
            "format": (c.attachments > 0).then(|| c.color.name()),
            "blend": c.blend,
            "points": m.points,
            "fragments": m.fragments,
            "gpu_ms": m.times.as_ref().ok(),
            "points_per_s": quartiles(&m.points_per_second()),
            "fragments_per_s": quartiles(&m.fragments_per_second()),
            "lacks": lacks,
            "wrong": wrong,
        })
    };
    json!({
        "schema": SCHEMA,
        "device": device.name,
        "driver": device.driver,
        "vulkan": device.api,
        "points": setup.points,
        "width": setup.extent[0],
        "height": setup.extent[1],
        "rounds": setup.rounds,
        "timed": "the device's time of all passes of a frame, clearing included; one sample a round, all cases in turn",
        "cases": results.iter().map(case).collect::<Vec<_>>(),
    })
}

fn table(device: &DeviceInfo, setup: &Setup, results: &[Measured]) -> String {
    let [width, height] = setup.extent;
    let mut text = format!("{} ({}), {width}x{height}, {} rounds\n", device.name, device.driver, setup.rounds);
    text += "medians, quartiles in brackets; times are the device's, clearing included\n";
    let mut axis = "";
    for m in results {
        if m.case.axis != axis {
            axis = m.case.axis;
            // Writing to a string cannot fail.
            let _ = writeln!(text, "\n{axis:<42} {:>26} {:>28}", "M points/s", "M fragments/s");
        }
        let name = m.case.to_string();
        let rate = |samples: &[f64]| {
            let s = Summary::of(samples)?;
            Some(format!("{:.2} ({:.2} to {:.2})", s.median * 1e-6, s.lower * 1e-6, s.upper * 1e-6))
        };
        let _ = match (&m.times, rate(&m.points_per_second()), rate(&m.fragments_per_second())) {
            (Err(Untimed::Lacking(what)), ..) => writeln!(text, "{name:<42} not timed, this device lacks: {what}"),
            (Err(Untimed::Wrong(how)), ..) => writeln!(text, "{name:<42} not timed, WRONG: {how}"),
            (Ok(_), Some(points), Some(fragments)) => writeln!(text, "{name:<42} {points:>26} {fragments:>28}"),
            (Ok(_), ..) => writeln!(text, "{name:<42} not timed"),
        };
    }
    text
}

/// What of a file matters for a comparison.
#[derive(Debug, PartialEq)]
struct Run {
    /// Device, driver, size and points: what must be equal for times to be comparable.
    setting: Vec<(&'static str, String)>,
    cases: Vec<Samples>,
}

impl Run {
    fn read(path: &Path) -> Result<Run> {
        let name = || path.display().to_string();
        let text = std::fs::read_to_string(path).with_context(name)?;
        let value = serde_json::from_str(&text).with_context(name)?;
        Run::parse(&value).ok_or_else(|| anyhow!("{}: not a file that `surfel bench raw --out` wrote", path.display()))
    }

    fn parse(value: &Value) -> Option<Run> {
        if value["schema"] != SCHEMA {
            return None;
        }
        let text = |key: &'static str| match &value[key] {
            Value::String(text) => Some((key, text.clone())),
            Value::Number(number) => Some((key, number.to_string())),
            _ => None,
        };
        let case = |value: &Value| {
            let values = match &value["gpu_ms"] {
                Value::Null => Vec::new(),
                list => list.as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?,
            };
            Some(Samples { name: value["name"].as_str()?.to_owned(), values })
        };
        Some(Run {
            setting: ["device", "driver", "width", "height", "points"].into_iter().map(text).collect::<Option<_>>()?,
            cases: value["cases"].as_array()?.iter().map(case).collect::<Option<_>>()?,
        })
    }
}

fn compared(path: &Path, before: &Run, now: &Run) -> String {
    let mut text = format!("\nagainst {}: time now / before, with its 95 % confidence interval\n", path.display());
    for ((key, old), (_, new)) in before.setting.iter().zip(&now.setting).filter(|(old, new)| old != new) {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "WARNING: another {key}: {old} before, {new} now. These times cannot be compared.");
    }
    let all = changes(&before.cases, &now.cases);
    for (name, change) in &all {
        let _ = match change {
            Change::New => writeln!(text, "{name:<42} new"),
            Change::Missing => writeln!(text, "{name:<42} MISSING: timed before, and not now"),
            Change::Both(None) => writeln!(text, "{name:<42} too few samples"),
            Change::Both(Some(r)) => {
                let verdict = match r.verdict() {
                    Verdict::Faster => "faster",
                    Verdict::Slower => "SLOWER",
                    Verdict::NoDifference => "no difference",
                };
                writeln!(text, "{name:<42} {:.3} ({:.3} to {:.3}) {verdict}", r.ratio, r.low, r.high)
            }
        };
    }
    let both = all.iter().filter(|(_, change)| matches!(change, Change::Both(Some(_)))).count();
    text +=
        &format!("{both} cases compared; of those that did not change, one in twenty is called different by chance,\n");
    text += "and more where the machine itself was slower or faster on the whole: that is in no interval\n";
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(device: &str, cases: Value) -> Value {
        let mut value = json!({"schema": SCHEMA, "device": device, "driver": "d 1", "width": 64, "height": 64});
        value["points"] = json!(10);
        value["cases"] = cases;
        value
    }

    #[test]
    fn runs_are_compared_and_differences_said() {
        let times = |name: &str, ms: f64| json!({"name": name, "gpu_ms": [ms, ms, ms, ms, ms]});
        let old = file("one", json!([times("a", 2.0), times("b", 1.0), times("gone", 1.0), times("same", 1.0)]));
        let none = json!({"name": "lacking", "gpu_ms": null});
        let new = file("two", json!([times("a", 1.0), times("b", 2.0), times("new", 1.0), times("same", 1.0), none]));
        let (old, new) = (Run::parse(&old).unwrap(), Run::parse(&new).unwrap());
        let text = compared(Path::new("old.json"), &old, &new);
        let row = |name: &str| text.lines().find(|l| l.starts_with(&format!("{name} "))).unwrap_or("");
        assert!(row("a").ends_with("0.500 (0.500 to 0.500) faster"), "{text}");
        assert!(row("b").ends_with("SLOWER") && row("same").ends_with("no difference"), "{text}");
        assert!(row("gone").contains("MISSING") && row("new").ends_with("new") && row("lacking").is_empty(), "{text}");
        assert!(text.contains("WARNING: another device: one before, two now"), "{text}");
        assert!(!compared(Path::new("old.json"), &new, &new).contains("WARNING"));
    }

    #[test]
    fn other_files_are_no_runs() {
        assert_eq!(Run::parse(&json!({"cases": []})), None);
        assert_eq!(Run::parse(&file("one", json!([{"name": "a", "gpu_ms": ["x"]}]))), None);
        assert_eq!(Run::parse(&file("one", json!([{"gpu_ms": [1.0]}]))), None);
        assert_eq!(Run::parse(&file("one", json!([]))).unwrap().cases, []);
    }
}
