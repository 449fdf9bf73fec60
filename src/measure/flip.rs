//! The perceptual error ꟻLIP: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild: FLIP: A Difference
//! Evaluator for Alternating Images, Proceedings of the ACM on Computer Graphics and Interactive Techniques 3(2), 2020.
//! Computed by the authors' own code (crate `nv-flip`), for a viewer at 67 pixels a degree.

use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8, flip, magma_lut};

use super::image::Image;

/// More than any picture has; the authors' code counts bytes, up to 16 a pixel, in 32 bits with a sign.
const MOST_PIXELS: u64 = i32::MAX as u64 / 16;

/// How much one would notice, flipping between two pictures, at each pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorMap {
    /// \[px\]
    pub width: u32,
    /// \[px\]
    pub height: u32,
    /// 0, nothing, to 1; rows from the top.
    pub errors: Vec<f32>,
}

/// The error of a picture, both in 8 bit; `None` for pictures of more than 134 million pixels.
///
/// # Panics
/// If the pictures differ in size.
pub fn error_map(truth: &Image, picture: &Image) -> Option<ErrorMap> {
    let (width, height) = (truth.width, truth.height);
    assert_eq!((width, height), (picture.width, picture.height), "pictures of one size");
    let pixels = width as u64 * height as u64;
    if pixels == 0 || pixels > MOST_PIXELS {
        return None;
    }
    let image = |of: &Image| FlipImageRgb8::with_data(width, height, &of.to_srgb8());
    let errors = flip(image(truth), image(picture), DEFAULT_PIXELS_PER_DEGREE).to_vec();
    Some(ErrorMap { width, height, errors })
}

impl ErrorMap {
    /// The mean over all pixels: the one number that the authors recommend.
    pub fn mean(&self) -> f64 {
        self.errors.iter().map(|&e| e as f64).sum::<f64>() / self.errors.len() as f64
    }

    /// In the authors' colours (magma: black is 0, light yellow 1), as sRGB bytes, three a pixel; rows from the top.
    pub fn magma(&self) -> Vec<u8> {
        let table = magma_lut().to_vec();
        let color = |e: &f32| (e.clamp(0.0, 1.0) * 255.0).round() as usize * 3;
        self.errors.iter().map(color).flat_map(|at| [table[at], table[at + 1], table[at + 2]]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32, value: impl Fn(u32, u32) -> f64) -> Image {
        let rgb = (0..width * height).map(|i| [value(i % width, i / width); 3]).collect();
        Image { width, height, rgb, alpha: None, depth: None, pixel: None }
    }

    /// L* of CIELAB (1976) of linear luminance.
    fn lightness(y: f64) -> f64 {
        let delta: f64 = 6.0 / 29.0;
        116.0 * if y > delta.powi(3) { y.cbrt() } else { y / (3.0 * delta * delta) + 4.0 / 29.0 } - 16.0
    }

    /// The paper's mapping (section 4.3) of a difference in lightness alone, from its constants q_c = 0.7, p_c = 0.4,
    /// p_t = 0.95, and the largest difference, green to blue: after Hunt's adjustment L*a*b* (87.74, −75.62, 72.98) and
    /// (32.30, 25.57, −34.84) from the colours' published L*a*b*, (87.74, −86.19, 83.18) and (32.30, 79.19, −107.86).
    fn expected(difference: f64) -> f64 {
        let largest = (87.74 - 32.30 + f64::hypot(75.62 + 25.57, 72.98 + 34.84)).powf(0.7);
        let error = difference.powf(0.7);
        let knee = 0.4 * largest;
        if error < knee { 0.95 * error / knee } else { 0.95 + 0.05 * (error - knee) / (largest - knee) }
    }

    #[test]
    fn equal_pictures_have_none() {
        let a = image(30, 20, |x, y| ((x * 7 + y * 13) % 16) as f64 / 15.0);
        let map = error_map(&a, &a).unwrap();
        assert_eq!((map.errors.len(), map.mean()), (600, 0.0));
        assert!(map.magma().chunks_exact(3).all(|p| p == &map.magma()[..3]));
    }

    #[test]
    fn constant_pictures_by_hand() {
        // Filters keep constants and see no features in them; what is left is the difference of two greys. In f32 the
        // derivative filters' weights, some 2·10⁻⁶ in sum, leave a feature of √(2·10⁻⁶) = 1.4·10⁻³ at most, which as an
        // exponent moves an error e by e |ln e| · 1.4·10⁻³ < 5.2·10⁻⁴; the rounded constants above, 10⁻⁴.
        for [a, b] in [[0.0, 1.0], [1.0, 0.0], [0.2, 0.8], [0.4, 0.6]] {
            let value = error_map(&image(4, 3, |_, _| a), &image(4, 3, |_, _| b)).unwrap().mean();
            let light = |v: f64| lightness(crate::color::srgb_to_linear(v));
            let expected = expected((light(a) - light(b)).abs());
            assert!((value - expected).abs() < 6.2e-4, "{a} {b}: {value} {expected}");
        }
    }

    #[test]
    fn an_error_reaches_as_far_as_the_filters_at_67_pixels_a_degree() {
        // The widest filter, of blue against yellow, has radius ⌈3 √(0.04 / 2π²) · 67⌉ = 10: nothing is seen beyond.
        let flat = image(41, 41, |_, _| 0.5);
        let mut dot = flat.clone();
        dot.rgb[20 * 41 + 20] = [0.0, 0.0, 1.0];
        let map = error_map(&flat, &dot).unwrap();
        let at = |x: usize, y: usize| map.errors[y * 41 + x];
        assert_eq!([at(31, 20), at(20, 9), at(0, 0)], [0.0; 3]);
        assert!(at(30, 20) > 0.0 && at(20, 10) > 0.0, "{} {}", at(30, 20), at(20, 10));
        assert!(at(20, 20) > 0.1 && map.mean() > 0.0 && map.mean() < at(20, 20) as f64);
        let colors = map.magma();
        assert_eq!(colors[..3], magma_lut().to_vec()[..3]);
        assert_ne!(colors[(20 * 41 + 20) * 3..][..3], colors[..3]);
    }
}
