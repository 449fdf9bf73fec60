//! How long to wait before something is tried again.

use std::time::Duration;

use crate::rng::Rng;

/// Exponential back-off: the n-th pause is `first` · 2ⁿ⁻¹, at most `cap`, of which the upper half is by chance, so that clients
/// that failed together do not come back together ("equal jitter": Brooker, "Exponential Backoff and Jitter", 2015).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Backoff {
    /// The first pause.
    pub first: Duration,
    /// The longest.
    pub cap: Duration,
}

impl Default for Backoff {
    fn default() -> Self {
        Backoff::DEFAULT
    }
}

impl Backoff {
    /// 100 ms, doubled up to 30 s.
    pub const DEFAULT: Backoff = Backoff { first: Duration::from_millis(100), cap: Duration::from_secs(30) };

    /// The pause after `failures` in a row, of which there is at least one.
    pub(super) fn pause(&self, failures: u32, rng: &mut Rng) -> Duration {
        let doubled = self.first.saturating_mul(1 << failures.saturating_sub(1).min(31)).min(self.cap);
        doubled.mul_f64(0.5 + 0.5 * rng.unit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_the_cap_and_differ_by_seed() {
        let backoff = Backoff { first: Duration::from_millis(8), cap: Duration::from_millis(100) };
        let pauses = |seed| {
            let mut rng = Rng::new(seed);
            [1, 2, 3, 4, 5, 6, 40, u32::MAX].map(|failures| backoff.pause(failures, &mut rng).as_secs_f64() * 1e3)
        };
        for (got, full) in pauses(1).into_iter().zip([8.0, 16.0, 32.0, 64.0, 100.0, 100.0, 100.0, 100.0]) {
            assert!((0.5 * full..=full).contains(&got), "{got} of {full} ms");
        }
        assert_eq!(pauses(1), pauses(1));
        assert_ne!(pauses(1), pauses(2));
    }
}
