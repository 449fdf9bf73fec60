//! `surfel bench raw`: what the device could do at best.

use std::fmt::Write as _;

use anyhow::{Context, Result, bail};
use serde_json::{Value, json};

use surfel::measure::Summary;
use surfel::measure::baseline::Samples;
use surfel::standalone::raw::{LARGEST, Measured, Setup, Untimed, cases, measure};
use surfel::standalone::{DeviceInfo, Options, Standalone};
use surfel::technique::Primitive;

use super::args::RawArgs;
use super::baseline::{self, Run};
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
    let before = args.baseline.as_deref().map(|path| baseline::read(path, parse)).transpose()?;
    if let Some(out) = &args.out {
        super::writable(out, args.baseline.as_deref())?;
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
        let now = parse(&value).context("the report cannot be read back")?;
        text += &baseline::compared(path, &before, &now);
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

/// What of a report matters for a comparison.
fn parse(value: &Value) -> Option<Run> {
    if value["schema"] != SCHEMA {
        return None;
    }
    let case = |value: &Value| {
        let values = match &value["gpu_ms"] {
            Value::Null => Vec::new(),
            list => list.as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?,
        };
        Some(Samples { name: value["name"].as_str()?.to_owned(), values })
    };
    Some(Run {
        setting: baseline::setting(value, &["device", "driver", "width", "height", "points"])?,
        cases: value["cases"].as_array()?.iter().map(case).collect::<Option<_>>()?,
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

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
        let (old, new) = (parse(&old).unwrap(), parse(&new).unwrap());
        let text = baseline::compared(Path::new("old.json"), &old, &new);
        let row = |name: &str| text.lines().find(|l| l.starts_with(&format!("{name} "))).unwrap_or("");
        assert!(row("a").ends_with("0.500 (0.500 to 0.500) faster"), "{text}");
        assert!(row("b").ends_with("SLOWER") && row("same").ends_with("no difference"), "{text}");
        assert!(row("gone").contains("MISSING") && row("new").ends_with("new") && row("lacking").is_empty(), "{text}");
        assert!(text.contains("WARNING: another device: one before, two now"), "{text}");
        assert!(!baseline::compared(Path::new("old.json"), &new, &new).contains("WARNING"));
    }

    #[test]
    fn other_files_are_no_runs() {
        assert_eq!(parse(&json!({"cases": []})), None);
        assert_eq!(parse(&file("one", json!([{"name": "a", "gpu_ms": ["x"]}]))), None);
        assert_eq!(parse(&file("one", json!([{"gpu_ms": [1.0]}]))), None);
        assert_eq!(parse(&file("one", json!([]))).unwrap().cases, []);
    }
}
