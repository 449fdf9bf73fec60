//! `surfel`: renders point scans from the command line. Parses, runs, and turns what happened into an exit code.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
