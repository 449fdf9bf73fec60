//! `surfel`: renders point scans from the command line. Parses, runs, and turns what happened into an exit code.

mod cli;

fn main() -> std::process::ExitCode {
    // SAFETY: the process has only this thread yet.
    unsafe { surfel::standalone::validation::check_across_submits() };
    cli::main()
}
