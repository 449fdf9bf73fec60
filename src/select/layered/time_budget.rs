//! How many samples a frame has time for.

/// Frames that the estimate looks back on.
const WINDOW: usize = 9;

/// A controller of the number of samples by measured time: samples = rate × time, where the rate is the median of samples over
/// time of the last nine frames.
///
/// - **Outliers** (a pipeline compiled, another process): up to four of any nine in a row do not move the median out of the
///   range of the others.
/// - **Band**: where n samples take a + b n seconds and each measurement is off by a factor between 1 − ε and 1 + ε, so is
///   the rate, and frames come to last between T / (1 + ε) and T / (1 − ε) seconds and stay there, T the aim.
/// - **Convergence**: what n is off becomes a / (a + b n) of itself, never more, so nothing overshoots; far below the aim that
///   is a factor of T / a a window. After a device has changed its speed, five frames bring the new rate. Where a is T or more there
///   is no such number, and the least is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeBudget {
    seconds: f64,
    /// Samples a second, the latest last; the first number of samples over the aim before anything is measured.
    rates: Vec<f64>,
}

impl TimeBudget {
    /// Aims at frames of `seconds`, more than 0, and begins with `first` samples.
    pub fn new(seconds: f64, first: u64) -> TimeBudget {
        TimeBudget { seconds, rates: vec![first as f64 / seconds] }
    }

    /// A frame that drew so many samples took so long. What can be no measurement (no samples, no time) is ignored.
    pub fn measured(&mut self, samples: u64, seconds: f64) {
        let rate = samples as f64 / seconds;
        if rate.is_normal() && rate > 0.0 {
            if self.rates.len() == WINDOW {
                self.rates.remove(0);
            }
            self.rates.push(rate);
        }
    }

    /// How many samples the next frame has time for, at least 1.
    pub fn samples(&self) -> u64 {
        let mut sorted = self.rates.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        // Of an even number the lower one: rather a picture too coarse than a frame too long.
        ((sorted[(sorted.len() - 1) / 2] * self.seconds) as u64).max(1)
    }
}
