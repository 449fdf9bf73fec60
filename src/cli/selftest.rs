//! `surfel selftest`: every technique and the canaries with the layers on, for other people's CI.

use anyhow::{Result, bail};

use surfel::standalone::selftest::{self, Options, Outcome as Ended};

use super::args::SelftestArgs;
use super::{Outcome, output};

/// Runs everything, and fails in one line if anything failed.
pub fn run(args: &SelftestArgs) -> Result<Outcome> {
    if let Some(path) = &args.junit {
        output::check(path)?;
    }
    let mut printed = Ok(());
    let report = selftest::run(&Options { layers: args.layers, device: args.device.clone() }, |case| {
        let end = match &case.outcome {
            Ended::Passed => "ok".to_owned(),
            Ended::Failed(why) => format!("FAILED: {why}"),
        };
        let line = super::print(&format!("{}: {} ... {end} ({:.2} s)\n", case.group, case.name, case.seconds));
        if printed.is_ok() {
            printed = line;
        }
    })?;
    printed?;
    if let Some(path) = &args.junit {
        output::write(path, |out| Ok(out.write_all(report.junit().as_bytes())?))?;
    }
    super::print(&format!("{} cases on {}, {} failed\n", report.cases.len(), report.device, report.failures()))?;
    if !report.passed() {
        bail!("selftest: {} of {} cases failed", report.failures(), report.cases.len());
    }
    Ok(Outcome::Done)
}
