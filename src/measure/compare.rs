//! How a picture differs from the truth.
//!
//! The first picture is always the truth, the second the one that is judged: holes, spill, depths and FLIP tell them
//! apart, the other errors are the same either way. Everything is measured on sRGB-encoded values from 0 to 1, since that
//! is closer to what eyes see than linear light.

use std::fmt;

use super::depth::{self, DepthError};
use super::image::Image;
use super::interior::{self, Interior};
use super::silhouette::{self, Silhouette};
use super::ssim;

/// Why two pictures cannot be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Incomparable {
    /// Width and height of each.
    Sizes([u32; 2], [u32; 2]),
    /// There are no pixels.
    Empty,
    /// A colour or the coverage of this pixel (x, y) is NaN or infinite in one of them, or its depth is NaN.
    NotFinite(u32, u32),
}

impl fmt::Display for Incomparable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Incomparable::Sizes([aw, ah], [bw, bh]) => {
                write!(f, "pictures of different sizes: {aw}×{ah} and {bw}×{bh}")
            }
            Incomparable::Empty => write!(f, "pictures without pixels"),
            Incomparable::NotFinite(x, y) => write!(f, "pixel {x}, {y} is not finite"),
        }
    }
}

impl std::error::Error for Incomparable {}

/// How a picture differs from the truth, in units of the full range (1 = from black to white).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// Pixels compared.
    pub pixels: u64,
    /// Pixels that either picture covers (coverage > 0); `None` unless both know their coverage.
    pub covered: Option<u64>,
    /// Root of the mean squared error over all pixels and the three colours.
    pub rmse: f64,
    /// 20 log₁₀ (1 / rmse), in dB; infinite for equal pictures.
    pub psnr: f64,
    /// The same over covered pixels; `None` without coverage or where nothing is covered.
    pub psnr_covered: Option<f64>,
    /// Largest error of any colour.
    pub max: f64,
    /// Largest error of the coverage, where both know it.
    pub max_alpha: Option<f64>,
    /// Pixels in which a colour, or the coverage where both know it, is off by more than the tolerance.
    pub over: u64,
    /// Mean structural similarity of the luma, 1 for equal pictures; `None` for pictures below 11 × 11, the window's size.
    pub ssim: Option<f64>,
    /// Mean of the perceptual error FLIP, 0 to 1, of the pictures in 8 bit at 67 pixels a degree (`flip::error_map`);
    /// `None` without the feature `flip`, or for pictures of more pixels than it takes.
    pub flip: Option<f64>,
    /// Errors away from every outline; `None` unless both know their coverage.
    pub interior: Option<Interior>,
    /// Errors of the outline; `None` unless both know their coverage.
    pub silhouette: Option<Silhouette>,
    /// Errors of the depth; `None` unless both know it.
    pub depth: Option<DepthError>,
    /// Both pictures show one colour all over: suspect, even where they are equal.
    pub blank: bool,
}

/// Compares a picture with the truth, of the same size; pixels off by more than `tolerance` (of the full range) are
/// counted.
///
/// # Errors
/// As [`Incomparable`] tells.
///
/// # Panics
/// If an [`Image`] has not one value a pixel.
pub fn compare(truth: &Image, picture: &Image, tolerance: f64) -> Result<Difference, Incomparable> {
    if (truth.width, truth.height) != (picture.width, picture.height) {
        return Err(Incomparable::Sizes([truth.width, truth.height], [picture.width, picture.height]));
    }
    let pixels = truth.rgb.len();
    if pixels == 0 {
        return Err(Incomparable::Empty);
    }
    for image in [truth, picture] {
        let bad = |&i: &usize| {
            !(image.rgb[i].iter().all(|v| v.is_finite())
                && image.alpha.as_ref().is_none_or(|a| a[i].is_finite())
                && image.depth.as_ref().is_none_or(|z| !z[i].is_nan()))
        };
        if let Some(i) = (0..pixels).find(bad) {
            return Err(Incomparable::NotFinite(i as u32 % image.width, i as u32 / image.width));
        }
    }

    let alphas = truth.alpha.as_ref().zip(picture.alpha.as_ref());
    let (mut squares, mut squares_covered, mut covered) = (0.0, 0.0, 0);
    let (mut max, mut max_alpha, mut over) = (0.0f64, 0.0f64, 0);
    for i in 0..pixels {
        let square = square(truth, picture, i);
        let mut worst = (0..3).fold(0.0f64, |m, c| m.max((truth.rgb[i][c] - picture.rgb[i][c]).abs()));
        squares += square;
        max = max.max(worst);
        if let Some((a, b)) = alphas {
            if a[i] > 0.0 || b[i] > 0.0 {
                covered += 1;
                squares_covered += square;
            }
            let error = (a[i] - b[i]).abs();
            max_alpha = max_alpha.max(error);
            worst = worst.max(error);
        }
        over += (worst > tolerance) as u64;
    }
    let all = rmse(squares, pixels as u64);
    let size = [truth.width as usize, truth.height as usize];
    Ok(Difference {
        pixels: pixels as u64,
        covered: alphas.map(|_| covered),
        rmse: all,
        psnr: psnr(all),
        psnr_covered: (covered > 0).then(|| psnr(rmse(squares_covered, covered))),
        max,
        max_alpha: alphas.map(|_| max_alpha),
        over,
        ssim: ssim::ssim(&truth.luma(), &picture.luma(), size[0], size[1]),
        flip: mean_flip(truth, picture),
        interior: interior::interior(truth, picture),
        silhouette: alphas.map(|(truth, picture)| silhouette::silhouette(truth, picture, size)),
        depth: truth.depth.as_ref().zip(picture.depth.as_ref()).map(|(truth, picture)| depth::depth(truth, picture)),
        blank: truth.is_uniform() && picture.is_uniform(),
    })
}

/// The sum of the three colours' squared errors of pixel `i`.
pub(super) fn square(truth: &Image, picture: &Image, i: usize) -> f64 {
    (0..3).map(|c| (truth.rgb[i][c] - picture.rgb[i][c]).powi(2)).sum()
}

/// Root mean square of a colour's error from a sum of squares over `pixels`.
pub(super) fn rmse(squares: f64, pixels: u64) -> f64 {
    (squares / (3 * pixels) as f64).sqrt()
}

/// In dB, for a range of 1.
pub(super) fn psnr(rmse: f64) -> f64 {
    -20.0 * rmse.log10()
}

#[cfg(feature = "flip")]
fn mean_flip(truth: &Image, picture: &Image) -> Option<f64> {
    super::flip::error_map(truth, picture).map(|map| map.mean())
}

#[cfg(not(feature = "flip"))]
fn mean_flip(_: &Image, _: &Image) -> Option<f64> {
    None
}

#[cfg(test)]
#[path = "compare_tests.rs"]
mod tests;
