//! Pictures of the error, for eyes.

use super::image::Image;

/// The factor at which an error of 1/32 of the full range is white: what is worth seeing is small.
pub const GAIN: f64 = 32.0;

/// The absolute error of each colour times `gain`, as sRGB bytes, three a pixel; rows from the top. Zero is black.
///
/// # Panics
/// If the pictures differ in size.
pub fn absolute(truth: &Image, picture: &Image, gain: f64) -> Vec<u8> {
    assert_eq!((truth.width, truth.height), (picture.width, picture.height), "pictures of one size");
    let byte = |a: f64, b: f64| ((a - b).abs() * gain * 255.0).round().clamp(0.0, 255.0) as u8;
    let pairs = truth.rgb.iter().flatten().zip(picture.rgb.iter().flatten());
    pairs.map(|(&a, &b)| byte(a, b)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_scaled_and_clamped() {
        let image = |rgb| Image { width: 1, height: 1, rgb: vec![rgb], alpha: None, depth: None, pixel: None };
        let (a, b) = (image([0.5, 0.5, 0.5]), image([0.5, 0.51, 0.1]));
        assert_eq!(absolute(&a, &b, 10.0), [0, 26, 255]);
        assert_eq!(absolute(&b, &a, 10.0), [0, 26, 255]);
    }
}
