//! Is it faster than before? Ratios of medians with confidence intervals.
//!
//! The interval is the bootstrap's percentile interval: Efron and Tibshirani: An Introduction to the Bootstrap, 1993,
//! chapter 13. Of many cases that did not change, about one in twenty is called different all the same.

use super::timing::quantile;
use crate::rng::Rng;

/// Resamples: the authors ask for a thousand at least; ten times as many leave the interval's ends, where samples are
/// discrete, the same from one seed to the next in all but rare cases.
const RESAMPLES: usize = 10_000;

/// Fewer samples than this cannot carry such an interval: the span from the smallest to the largest of n holds the median
/// with probability 1 − 2^(1 − n), 94 % for five and 88 % for four.
pub const LEAST: usize = 5;

/// A ratio of medians, new to old, and its 95 % confidence interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratio {
    /// Median of the new samples by that of the old ones.
    pub ratio: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

/// What a ratio of times says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The whole interval lies below 1.
    Faster,
    /// The whole interval lies above 1.
    Slower,
    /// The interval contains 1.
    NoDifference,
}

impl Ratio {
    /// For samples that are times: less is better.
    pub fn verdict(&self) -> Verdict {
        match self {
            Ratio { high, .. } if *high < 1.0 => Verdict::Faster,
            Ratio { low, .. } if *low > 1.0 => Verdict::Slower,
            _ => Verdict::NoDifference,
        }
    }
}

/// The ratio of two sets of positive samples in one unit, whatever their order: the same samples give the same bits.
///
/// `None` for fewer than [`LEAST`] samples on either side, and where one is not finite or not above zero.
pub fn ratio(old: &[f64], new: &[f64]) -> Option<Ratio> {
    let usable = |s: &[f64]| s.len() >= LEAST && s.iter().all(|v| v.is_finite() && *v > 0.0);
    if !usable(old) || !usable(new) {
        return None;
    }
    let sorted = |s: &[f64]| {
        let mut s = s.to_vec();
        s.sort_unstable_by(f64::total_cmp);
        s
    };
    let (old, new) = (sorted(old), sorted(new));
    let mut rng = Rng::new(1);
    let mut resampled = |of: &[f64]| {
        let mut ranks: Vec<usize> = (0..of.len()).map(|_| (rng.unit() * of.len() as f64) as usize).collect();
        ranks.sort_unstable();
        quantile(&ranks.into_iter().map(|r| of[r]).collect::<Vec<_>>(), 0.5)
    };
    let ratios: Vec<f64> = (0..RESAMPLES).map(|_| resampled(&new) / resampled(&old)).collect();
    let ratios = sorted(&ratios);
    Some(Ratio {
        ratio: quantile(&new, 0.5) / quantile(&old, 0.5),
        low: quantile(&ratios, 0.025),
        high: quantile(&ratios, 0.975),
    })
}

/// Samples of a case, by its name.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    /// The same in both runs.
    pub name: String,
    /// In one unit; empty if it was not measured.
    pub values: Vec<f64>,
}

/// What became of a case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// In both runs; `None` where the samples say nothing (see [`ratio`]).
    Both(Option<Ratio>),
    /// It was there and is no more, or is not measured any more.
    Missing,
    /// It was not there, or not measured.
    New,
}

/// Every case of either run with what became of it: those of the new run in its order, then those that are missing. Cases
/// that were measured in neither are left out.
pub fn changes(old: &[Samples], new: &[Samples]) -> Vec<(String, Change)> {
    let find = |of: &[Samples], name: &str| {
        of.iter().find(|s| s.name == name && !s.values.is_empty()).map(|s| s.values.clone())
    };
    let mut all = Vec::new();
    for s in new.iter().filter(|s| !s.values.is_empty()) {
        let change = find(old, &s.name).map_or(Change::New, |before| Change::Both(ratio(&before, &s.values)));
        all.push((s.name.clone(), change));
    }
    let gone = old.iter().filter(|s| !s.values.is_empty() && find(new, &s.name).is_none());
    all.extend(gone.map(|s| (s.name.clone(), Change::Missing)));
    all
}

#[cfg(test)]
#[path = "baseline_tests.rs"]
mod tests;
