//! Errors away from every outline, where convergence to the truth is judged.

use super::all_around;
use super::compare::{psnr, rmse, square};
use super::image::Image;

/// How far from a pixel everything must be covered \[px\]. The renderers' low-pass reaches one pixel, so at this distance from
/// an outline no pixel mixes in what lies behind it; more would only lose pixels of thin parts.
const RADIUS: usize = 1;

/// Fully covered, as far as eight bits tell.
const FULL: f64 = 1.0 - 1.0 / 255.0;

/// Steepest surface that is no outline, as depth a pixel's width: 2 is 63°. A surface that is steeper, or one before another,
/// shows itself within a pixel's width, and what a pixel then shows is a matter of filtering, not of the surface's shape.
const STEEPEST: f64 = 2.0;

/// Errors over the pixels away from every outline: their whole neighbourhood of 3 × 3 is fully covered (at least 1 − 1/255) in
/// both pictures, and, where the truth knows its depth and how wide a pixel is, its depths in there differ by no more than
/// those of a surface at 63° to the view. At the picture's border, what there is of the neighbourhood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interior {
    /// How many they are.
    pub pixels: u64,
    /// Root of the mean squared error over them and the three colours; `None` where there are none.
    pub rmse: Option<f64>,
    /// 20 log₁₀ (1 / rmse), in dB; infinite where they are equal, `None` where there are none.
    pub psnr: Option<f64>,
}

/// `None` unless both pictures, of one size, know their coverage.
pub(super) fn interior(truth: &Image, picture: &Image) -> Option<Interior> {
    let (a, b) = truth.alpha.as_ref().zip(picture.alpha.as_ref())?;
    let size = [truth.width as usize, truth.height as usize];
    // Eight-bit values are exact quotients: 254/255 must not fail by its rounding.
    let full = |i: usize| a[i].min(b[i]) >= FULL - 1e-12;
    // Across the diagonal, at most: to the first order a plane's depth changes by z · pixel · slope from pixel to pixel.
    let reach = RADIUS as f64 * std::f64::consts::SQRT_2 * STEEPEST;
    let depths = truth.depth.as_ref().zip(truth.pixel);
    let (mut pixels, mut squares) = (0, 0.0);
    for i in 0..a.len() {
        let smooth = |j: usize| depths.is_none_or(|(z, pixel)| (z[j] - z[i]).abs() <= reach * pixel * z[i]);
        if all_around(size, [i % size[0], i / size[0]], RADIUS, |j| full(j) && smooth(j)) {
            pixels += 1;
            squares += square(truth, picture, i);
        }
    }
    let rmse = (pixels > 0).then(|| rmse(squares, pixels));
    Some(Interior { pixels, rmse, psnr: rmse.map(psnr) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: u32, height: u32, value: f64) -> Image {
        let pixels = (width * height) as usize;
        Image { width, height, rgb: vec![[value; 3]; pixels], alpha: Some(vec![1.0; pixels]), depth: None, pixel: None }
    }

    #[test]
    fn only_pixels_away_from_the_outline_count() {
        let (truth, mut picture) = (grey(7, 5, 0.5), grey(7, 5, 0.5));
        // Column 0 is not quite covered in the truth: columns 0 and 1 are out, whatever they show.
        let mut open = truth.clone();
        for y in 0..5 {
            open.alpha.as_mut().unwrap()[y * 7] = 253.0 / 255.0;
            picture.rgb[y * 7] = [0.0; 3];
            picture.rgb[y * 7 + 1] = [1.0; 3];
        }
        let found = interior(&open, &picture).unwrap();
        assert_eq!((found.pixels, found.rmse, found.psnr), (25, Some(0.0), Some(f64::INFINITY)));
        // One of 75 values is off by 0.3.
        picture.rgb[2 * 7 + 4][1] = 0.8;
        let found = interior(&open, &picture).unwrap();
        assert!((found.rmse.unwrap() - (0.09f64 / 75.0).sqrt()).abs() < 1e-15, "{found:?}");
        // The picture's own coverage counts as well.
        let mut pierced = picture.clone();
        pierced.alpha.as_mut().unwrap()[2 * 7 + 4] = 0.0;
        let found = interior(&open, &pierced).unwrap();
        assert_eq!((found.pixels, found.rmse), (16, Some(0.0)));
        // With 254 of 255 column 0 is covered, and all its errors count.
        for y in 0..5 {
            open.alpha.as_mut().unwrap()[y * 7] = 254.0 / 255.0;
        }
        assert_eq!(interior(&open, &picture).unwrap().pixels, 35);
    }

    #[test]
    fn one_surface_before_another_is_an_outline() {
        // Depths 10 and, from column 4 on, 10 + jump; a pixel is 0.1 wide there.
        let stepped = |jump: f64| {
            let mut truth = grey(7, 5, 0.5);
            truth.depth = Some((0..35).map(|i| if i % 7 < 4 { 10.0 } else { 10.0 + jump }).collect());
            truth.pixel = Some(0.01);
            interior(&truth, &grey(7, 5, 0.5)).unwrap().pixels
        };
        // √2 · 2 · 0.1 is what a slope may do; beyond, columns 3 and 4 are out.
        assert_eq!((stepped(0.28), stepped(0.3), stepped(-0.5)), (35, 25, 25));
        assert_eq!(stepped(f64::INFINITY), 15, "what has no depth has no surface");
        let mut unknown = grey(7, 5, 0.5);
        unknown.depth = Some((0..35).map(|i| if i % 7 < 4 { 1.0 } else { 9.0 }).collect());
        assert_eq!(interior(&unknown, &grey(7, 5, 0.5)).unwrap().pixels, 35, "nobody knows how wide a pixel is");
    }

    #[test]
    fn nothing_inside_and_nothing_known() {
        let mut empty = grey(3, 3, 0.5);
        empty.alpha.as_mut().unwrap()[4] = 0.0;
        assert_eq!(interior(&empty, &empty), Some(Interior { pixels: 0, rmse: None, psnr: None }));
        let unknown = Image { alpha: None, ..empty.clone() };
        assert_eq!((interior(&unknown, &empty), interior(&empty, &unknown)), (None, None));
    }
}
