//! `surfel bench`: run time, always against error, and what the device could do at best.

pub mod args;
mod baseline;
mod ceiling;
mod journal;
mod plan;
mod plot;
mod raw;
mod record;
mod report;
mod summary;
mod sweep;
mod truth;
mod viewpoints;

use std::path::Path;

use anyhow::{Context, Result, bail};
use serde_json::json;

use super::progress::Progress;
use super::{Outcome, output};
use args::{BenchArgs, BenchCommand, SweepArgs};
use sweep::Sweep;

/// Runs the sweep, or measures the ceilings.
pub fn run(args: &BenchArgs) -> Result<Outcome> {
    match &args.command {
        Some(BenchCommand::Raw(args)) => raw::run(args),
        None => sweep(&args.sweep),
    }
}

fn sweep(args: &SweepArgs) -> Result<Outcome> {
    let out = args.out.as_deref().context("clap asks for --out")?;
    let before = args.baseline.as_deref().map(|path| baseline::read(path, record::parse)).transpose()?;
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    for name in ["results.json", "results.csv", "report.html"] {
        writable(&out.join(name), args.baseline.as_deref())?;
    }
    let progress = Progress::new(args.quiet);
    let sweep = sweep::run(args, out, &progress)?;
    let compared = match (before, &args.baseline) {
        (Some(before), Some(path)) => baseline::compared(path, &before, &record::run(&sweep.common, &sweep.records)?),
        _ => String::new(),
    };
    let Sweep { records, ceilings, common, .. } = &sweep;
    let text = |path: &str, text: String| output::write(&out.join(path), |out| Ok(out.write_all(text.as_bytes())?));
    text(
        "results.json",
        format!(
            "{:#}\n",
            json!({"schema": record::SCHEMA, "common": common, "ceilings": ceilings, "records": records})
        ),
    )?;
    text("results.csv", record::csv(records))?;
    text("report.html", report::html(&sweep, args, out, &compared)?)?;
    let table = if args.quiet {
        String::new()
    } else {
        summary::table(records, ceilings) + &viewpoints::table(records) + &compared
    };
    super::print(&format!("{}\n{table}", out.join("report.html").display()))?;
    failed(&sweep)
}

/// A device that fails the stress suite is told of after everything is written.
fn failed(sweep: &Sweep) -> Result<Outcome> {
    let cases = sweep.stress.as_deref().unwrap_or_default();
    let failed: Vec<&str> = cases.iter().filter(|c| !c.outcome.passed()).map(|c| c.name.as_str()).collect();
    if !failed.is_empty() {
        let (device, few) = (&sweep.device.name, failed.len());
        bail!("{device} fails {few} of {} cases of the stress suite: {}", cases.len(), failed.join("; "));
    }
    Ok(Outcome::Done)
}

/// Fails, before anything long begins, where `out` could not be written or is what is compared with.
fn writable(out: &Path, baseline: Option<&Path>) -> Result<()> {
    if let Some(old) = baseline.filter(|old| output::same(old, out)) {
        bail!("{}: is the baseline, and would be overwritten", old.display());
    }
    output::check(out)
}

/// FNV-1a (Fowler, Noll, Vo 1991): names of files that are the same on every machine.
fn hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ b as u64).wrapping_mul(0x100_0000_01b3))
}
