//! How two pictures differ.
//!
//! Everything is measured on sRGB-encoded values from 0 to 1, since that is closer to what eyes see than linear light.
//! SSIM: Wang, Bovik, Sheikh, Simoncelli: Image Quality Assessment: From Error Visibility to Structural Similarity, IEEE
//! Transactions on Image Processing 13(4), 2004, with the paper's window and constants, without its optional downsampling.

use std::fmt;

use crate::color::{linear_to_srgb, srgb_to_linear};

/// A picture in the encoding that errors are measured in.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// sRGB-encoded red, green, blue, nominally 0 to 1; rows from the top.
    pub rgb: Vec<[f64; 3]>,
    /// Coverage, 0 to 1, where it is known.
    pub alpha: Option<Vec<f64>>,
}

impl Image {
    /// From sRGB bytes, `channels` of them a pixel: 3, or 4 with coverage. Colours are taken as they are.
    ///
    /// # Panics
    /// For any other number of channels, or if `bytes` is not as long as the size asks for.
    pub fn from_srgb8(width: u32, height: u32, channels: usize, bytes: &[u8]) -> Image {
        assert!(channels == 3 || channels == 4, "three or four channels");
        assert_eq!(bytes.len(), width as usize * height as usize * channels, "one value a channel");
        let value = |b: u8| b as f64 / 255.0;
        let pixels = || bytes.chunks_exact(channels);
        Image {
            width,
            height,
            rgb: pixels().map(|p| [value(p[0]), value(p[1]), value(p[2])]).collect(),
            alpha: (channels == 4).then(|| pixels().map(|p| value(p[3])).collect()),
        }
    }

    /// From premultiplied linear light with coverage, as [`crate::reference`] and the float targets have it, over an
    /// sRGB-encoded background, clamped to 0…1 as on a screen.
    ///
    /// # Panics
    /// If there is not one value a pixel.
    pub fn from_linear(width: u32, height: u32, rgba: &[[f64; 4]], background: [u8; 3]) -> Image {
        assert_eq!(rgba.len(), width as usize * height as usize, "one value a pixel");
        let background = background.map(|b| srgb_to_linear(b as f64 / 255.0));
        let over = |p: &[f64; 4]| {
            std::array::from_fn(|i| {
                let v = p[i] + (1.0 - p[3]) * background[i];
                // NaN must stay, so that `compare` can refuse it.
                linear_to_srgb(if v.is_nan() { v } else { v.clamp(0.0, 1.0) })
            })
        };
        Image { width, height, rgb: rgba.iter().map(over).collect(), alpha: Some(rgba.iter().map(|p| p[3]).collect()) }
    }

    /// Luma of ITU-R BT.601 on encoded values, the grey that SSIM's authors use.
    fn luma(&self) -> Vec<f64> {
        self.rgb.iter().map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect()
    }

    fn is_uniform(&self) -> bool {
        let same = self.rgb.windows(2).all(|w| w[0] == w[1]);
        same && self.alpha.as_ref().is_none_or(|a| a.windows(2).all(|w| w[0] == w[1]))
    }
}

/// Why two pictures cannot be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Incomparable {
    /// Width and height of each.
    Sizes([u32; 2], [u32; 2]),
    /// There are no pixels.
    Empty,
    /// A value of this pixel (x, y) is NaN or infinite in one of them.
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

/// How two pictures differ, in units of the full range (1 = from black to white).
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
    /// Both pictures show one colour all over: suspect, even where they are equal.
    pub blank: bool,
}

/// Compares two pictures of one size; pixels off by more than `tolerance` (of the full range) are counted.
pub fn compare(a: &Image, b: &Image, tolerance: f64) -> Result<Difference, Incomparable> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(Incomparable::Sizes([a.width, a.height], [b.width, b.height]));
    }
    let pixels = a.rgb.len();
    if pixels == 0 {
        return Err(Incomparable::Empty);
    }
    for image in [a, b] {
        let bad = |i: &usize| {
            !(image.rgb[*i].iter().all(|v| v.is_finite()) && image.alpha.as_ref().is_none_or(|a| a[*i].is_finite()))
        };
        if let Some(i) = (0..pixels).find(bad) {
            return Err(Incomparable::NotFinite(i as u32 % a.width, i as u32 / a.width));
        }
    }

    let alphas = a.alpha.as_ref().zip(b.alpha.as_ref());
    let (mut squares, mut squares_covered, mut covered) = (0.0, 0.0, 0);
    let (mut max, mut max_alpha, mut over) = (0.0f64, 0.0f64, 0);
    for i in 0..pixels {
        let errors: [f64; 3] = std::array::from_fn(|c| (a.rgb[i][c] - b.rgb[i][c]).abs());
        let square: f64 = errors.iter().map(|e| e * e).sum();
        let mut worst = errors.iter().fold(0.0f64, |m, &e| m.max(e));
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
    let rmse = |squares: f64, pixels: u64| (squares / (3 * pixels) as f64).sqrt();
    let psnr = |rmse: f64| -20.0 * rmse.log10();
    let all = rmse(squares, pixels as u64);
    Ok(Difference {
        pixels: pixels as u64,
        covered: alphas.map(|_| covered),
        rmse: all,
        psnr: psnr(all),
        psnr_covered: (covered > 0).then(|| psnr(rmse(squares_covered, covered))),
        max,
        max_alpha: alphas.map(|_| max_alpha),
        over,
        ssim: ssim(&a.luma(), &b.luma(), a.width as usize, a.height as usize),
        blank: a.is_uniform() && b.is_uniform(),
    })
}

/// Side of the window \[px\] and the Gaussian's σ.
const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;

/// Mean over all windows that lie within the picture.
fn ssim(a: &[f64], b: &[f64], width: usize, height: usize) -> Option<f64> {
    if width < WINDOW || height < WINDOW {
        return None;
    }
    let mean_a = blur(width, height, |i| a[i]);
    let mean_b = blur(width, height, |i| b[i]);
    let squares_a = blur(width, height, |i| a[i] * a[i]);
    let squares_b = blur(width, height, |i| b[i] * b[i]);
    let products = blur(width, height, |i| a[i] * b[i]);
    // (K₁ L)² and (K₂ L)² with L = 1.
    let (c1, c2) = (0.01f64.powi(2), 0.03f64.powi(2));
    let sum: f64 = (0..mean_a.len())
        .map(|i| {
            let (ma, mb) = (mean_a[i], mean_b[i]);
            let (va, vb, cov) = (squares_a[i] - ma * ma, squares_b[i] - mb * mb, products[i] - ma * mb);
            (2.0 * ma * mb + c1) * (2.0 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
        })
        .sum();
    Some(sum / mean_a.len() as f64)
}

/// Gaussian means at the (width − 10) · (height − 10) places where the window fits.
fn blur(width: usize, height: usize, value: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut kernel: [f64; WINDOW] = std::array::from_fn(|i| {
        let d = i as f64 - (WINDOW / 2) as f64;
        (-0.5 * d * d / (SIGMA * SIGMA)).exp()
    });
    let total: f64 = kernel.iter().sum();
    kernel.iter_mut().for_each(|k| *k /= total);
    let columns = width + 1 - WINDOW;
    let mut rows = Vec::with_capacity(columns * height);
    for y in 0..height {
        for x in 0..columns {
            rows.push((0..WINDOW).map(|k| kernel[k] * value(y * width + x + k)).sum::<f64>());
        }
    }
    let mut out = Vec::with_capacity(columns * (height + 1 - WINDOW));
    for y in 0..height + 1 - WINDOW {
        for x in 0..columns {
            out.push((0..WINDOW).map(|k| kernel[k] * rows[(y + k) * columns + x]).sum());
        }
    }
    out
}

#[cfg(test)]
#[path = "compare_tests.rs"]
mod tests;
