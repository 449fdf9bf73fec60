//! Statistics of repeated timings: medians, because a busy machine only ever adds time.

/// Order statistics of samples, in the samples' unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Number of samples, at least 1.
    pub samples: usize,
    /// The smallest.
    pub min: f64,
    /// A quarter of the samples lies below.
    pub lower: f64,
    /// Half of the samples lies below.
    pub median: f64,
    /// Three quarters of the samples lie below.
    pub upper: f64,
    /// The largest.
    pub max: f64,
}

impl Summary {
    /// The summary of these samples, in any order; `None` if there is none or one is not finite, so that no field ever is
    /// NaN. Quantiles are interpolated between neighbours.
    pub fn of(samples: &[f64]) -> Option<Summary> {
        if samples.is_empty() || samples.iter().any(|s| !s.is_finite()) {
            return None;
        }
        let mut sorted = samples.to_vec();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len() - 1;
        let quantile = |q: f64| quantile(&sorted, q);
        Some(Summary {
            samples: sorted.len(),
            min: sorted[0],
            lower: quantile(0.25),
            median: quantile(0.5),
            upper: quantile(0.75),
            max: sorted[last],
        })
    }

    /// Distance between the quartiles.
    pub fn spread(&self) -> f64 {
        self.upper - self.lower
    }
}

/// The `q`-quantile of sorted samples, at least one; interpolated between neighbours (Hyndman and Fan 1996, definition 7).
pub fn quantile(sorted: &[f64], q: f64) -> f64 {
    let last = sorted.len() - 1;
    let at = q * last as f64;
    let (low, share) = (at.floor() as usize, at.fract());
    let high = (low + 1).min(last);
    sorted[low] * (1.0 - share) + sorted[high] * share
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_even_and_single() {
        let s = Summary::of(&[5.0, 1.0, 3.0, 2.0, 4.0]).unwrap();
        assert_eq!((s.min, s.lower, s.median, s.upper, s.max, s.samples), (1.0, 2.0, 3.0, 4.0, 5.0, 5));
        assert_eq!(s.spread(), 2.0);
        // Positions 0.75, 1.5, 2.25 between 1, 2, 4, 8.
        let s = Summary::of(&[8.0, 1.0, 4.0, 2.0]).unwrap();
        assert_eq!((s.lower, s.median, s.upper), (1.75, 3.0, 5.0));
        let s = Summary::of(&[7.0]).unwrap();
        assert_eq!((s.min, s.lower, s.median, s.upper, s.max, s.spread()), (7.0, 7.0, 7.0, 7.0, 7.0, 0.0));
    }

    #[test]
    fn nothing_and_nonsense_have_no_summary() {
        assert_eq!(Summary::of(&[]), None);
        assert_eq!(Summary::of(&[1.0, f64::NAN]), None);
        assert_eq!(Summary::of(&[f64::INFINITY]), None);
    }
}
