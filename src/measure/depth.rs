//! Errors of the depth.

use super::timing::quantile;

/// Relative errors |z / z_truth − 1| of linear view depths, over the pixels where both pictures have one.
///
/// A pixel has a depth where it is finite and above zero, in front of the eye.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthError {
    /// Pixels where both have a depth.
    pub pixels: u64,
    /// Pixels where only the truth has one.
    pub only_truth: u64,
    /// Pixels where only the picture has one.
    pub only_picture: u64,
    /// Half of the errors lie below; `None` without pixels.
    pub median: Option<f64>,
    /// 99 of 100 errors lie below; `None` without pixels.
    pub p99: Option<f64>,
    /// The largest; `None` without pixels.
    pub max: Option<f64>,
}

impl DepthError {
    /// Nothing differs.
    pub fn is_equal(&self) -> bool {
        self.only_truth == 0 && self.only_picture == 0 && self.max.is_none_or(|m| m == 0.0)
    }
}

/// From the depths of two pictures of one size.
pub(super) fn depth(truth: &[f64], picture: &[f64]) -> DepthError {
    let there = |z: f64| z.is_finite() && z > 0.0;
    let (mut only_truth, mut only_picture, mut errors) = (0, 0, Vec::new());
    for (&t, &p) in truth.iter().zip(picture) {
        match (there(t), there(p)) {
            (true, true) => errors.push((p / t - 1.0).abs()),
            (true, false) => only_truth += 1,
            (false, true) => only_picture += 1,
            (false, false) => {}
        }
    }
    errors.sort_unstable_by(f64::total_cmp);
    let at = |q: f64| (!errors.is_empty()).then(|| quantile(&errors, q));
    DepthError { pixels: errors.len() as u64, only_truth, only_picture, median: at(0.5), p99: at(0.99), max: at(1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let nothing = f64::INFINITY;
        let truth = [2.0, 4.0, 8.0, nothing, nothing, 5.0, 5.0, 0.0];
        let picture = [2.0, 5.0, 4.0, nothing, 3.0, nothing, -1.0, 0.0];
        let d = depth(&truth, &picture);
        assert_eq!((d.pixels, d.only_truth, d.only_picture), (3, 2, 1));
        // 0, 1/4 and 1/2; the 99th percentile at position 1.98 of 0 to 2.
        assert_eq!((d.median, d.max), (Some(0.25), Some(0.5)));
        assert!((d.p99.unwrap() - (0.25 + 0.98 * 0.25)).abs() < 1e-12);
        assert!(!d.is_equal() && depth(&truth, &truth).is_equal() && !depth(&truth[4..5], &picture[4..5]).is_equal());
        // Relative to the truth: 2 for 4 is one half off, 4 for 2 a whole.
        assert_eq!((depth(&[4.0], &[2.0]).max, depth(&[2.0], &[4.0]).max), (Some(0.5), Some(1.0)));
    }

    #[test]
    fn nothing_to_compare() {
        let d = depth(&[f64::INFINITY], &[1.0]);
        assert_eq!((d.pixels, d.only_picture, d.median, d.p99, d.max), (0, 1, None, None, None));
    }
}
