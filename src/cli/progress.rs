//! Progress on stderr, for people: nothing is shown where stderr is no terminal, and nothing once a step is done.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Where bars come from.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    shown: bool,
}

impl Progress {
    /// Bars that are shown if stderr is a terminal and `quiet` is not asked for.
    pub fn new(quiet: bool) -> Progress {
        Progress { shown: !quiet && console_is_terminal() }
    }

    /// A bar for one step. It vanishes when dropped.
    pub fn step(&self, name: impl Into<String>, total: u64) -> Step {
        if !self.shown {
            return Step(ProgressBar::hidden());
        }
        let bar = ProgressBar::with_draw_target(Some(total.max(1)), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{msg:32!} [{bar:40}] {percent:>3} %  {elapsed}, {eta} left") {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_message(name.into());
        Step(bar)
    }
}

fn console_is_terminal() -> bool {
    use std::io::IsTerminal;
    std::io::stderr().is_terminal()
}

/// One bar.
pub struct Step(ProgressBar);

impl Step {
    /// So much is done of so much.
    pub fn set(&self, done: u64, total: u64) {
        self.0.set_length(total.max(1));
        self.0.set_position(done.min(total));
    }

    /// This share is done, 0 to 1. May be called by several threads that overtake each other.
    pub fn share(&self, share: f32) {
        let position = (share.clamp(0.0, 1.0) * 1000.0) as u64;
        if position > self.0.position() {
            self.set(position, 1000);
        }
    }
}

impl Drop for Step {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
