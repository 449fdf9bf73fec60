//! `surfel bench`: run time, always against error, and what the device could do at best.

pub mod args;

use anyhow::{Result, bail};

use super::Outcome;
use args::{BenchArgs, BenchCommand};

/// Runs the sweep, or the ceilings.
pub fn run(args: &BenchArgs) -> Result<Outcome> {
    match &args.command {
        Some(BenchCommand::Raw(_)) => bail!("not there yet"),
        None => bail!("not there yet"),
    }
}
