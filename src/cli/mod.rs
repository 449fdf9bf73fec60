//! The command line. It uses the library's public items only, as any embedder would.
//!
//! Exit codes: 0; 1 with one line that names file, place and reason; 2 for usage; 3 when a validation layer spoke.
#![forbid(unsafe_code)]

mod args;
mod bench;
mod build;
mod camera;
mod color;
mod compare;
mod devices;
mod fly;
mod frames;
mod info;
mod input;
mod layered;
mod look;
mod memory;
mod offscreen;
mod output;
mod palette;
mod parse;
mod placed;
mod progress;
mod reference;
mod render;
mod report;
mod scene;
mod scene_file;
mod selftest;
mod structure;

use std::fmt;
use std::io::{self, Write};
use std::process::ExitCode;

use clap::Parser;

use args::{Cli, Command};

/// Asked for what cannot be, whatever the files hold: exit code 2.
#[derive(Debug)]
struct Usage(String);

impl fmt::Display for Usage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Usage {}

/// How a command that did not fail ended.
enum Outcome {
    Done,
    /// `--validate` saw messages; they are printed already.
    Spoken,
}

/// Parses, runs, reports.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => {
            // Help and version go to stdout with code 0, the rest to stderr with code 2. A closed pipe is no failure.
            let _ = e.print();
            return ExitCode::from(e.exit_code() as u8);
        }
    };
    let result = match cli.command {
        Command::Render(args) => render::run(&args),
        Command::Reference(args) => reference::run(&args),
        Command::Build(args) => build::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Fly(args) => fly::run(&args),
        Command::Devices => devices::run(),
        Command::Selftest(args) => selftest::run(&args),
    };
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Spoken) => ExitCode::from(3),
        Err(e) => {
            let usage = e.downcast_ref::<Usage>().is_some();
            // Nothing is left to do where stderr is closed.
            let _ = match usage {
                true => writeln!(io::stderr(), "error: {}\n\nFor more information, try '--help'.", one_line(&e)),
                false => writeln!(io::stderr(), "surfel: {}", one_line(&e)),
            };
            ExitCode::from(if usage { 2 } else { 1 })
        }
    }
}

/// The chain of causes on one line. A cause that its effect's text already tells is not told again.
fn one_line(error: &anyhow::Error) -> String {
    let mut parts: Vec<String> = Vec::new();
    for cause in error.chain() {
        let text = cause.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        if parts.last().is_none_or(|before| !before.contains(&text)) {
            parts.push(text);
        }
    }
    parts.join(": ")
}

/// Writes to stdout. A reader that has gone away (`surfel info … | head -1`) is no failure.
fn print(text: &str) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(anyhow::Error::new(e).context("stdout")),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_told_once() {
        let io = io::Error::new(io::ErrorKind::NotFound, "no such\nfile");
        let error = anyhow::Error::new(io).context("a.ply: no such file").context("input 2");
        assert_eq!(one_line(&error), "input 2: a.ply: no such file");
    }
}
