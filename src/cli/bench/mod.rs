//! `surfel bench`: run time, always against error, and what the device could do at best.

pub mod args;
mod raw;

use anyhow::{Result, bail};

use super::Outcome;
use args::{BenchArgs, BenchCommand};

/// Runs the sweep, or the ceilings.
pub fn run(args: &BenchArgs) -> Result<Outcome> {
    match &args.command {
        Some(BenchCommand::Raw(args)) => raw::run(args),
        None => bail!("not there yet"),
    }
}
