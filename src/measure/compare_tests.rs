use super::*;
use crate::measure::Image;

/// A picture with structure in every channel, different along x and y.
fn scene(width: u32, height: u32) -> Image {
    let pixel = |i: u32| {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        [0.5 + 0.4 * (0.9 * x).sin(), 0.5 + 0.4 * (0.7 * y).cos(), 0.25 + 0.2 * (0.5 * (x + y)).sin()]
    };
    Image { width, height, rgb: (0..width * height).map(pixel).collect(), alpha: None, depth: None, pixel: None }
}

fn grey(width: u32, height: u32, value: impl Fn(u32, u32) -> f64) -> Image {
    let rgb = (0..width * height).map(|i| [value(i % width, i / width); 3]).collect();
    Image { width, height, rgb, alpha: None, depth: None, pixel: None }
}

#[test]
fn equal_pictures() {
    let a = scene(20, 15);
    let d = compare(&a, &a, 0.0).unwrap();
    assert_eq!((d.rmse, d.psnr, d.max, d.over, d.blank), (0.0, f64::INFINITY, 0.0, 0, false));
    assert!((d.ssim.unwrap() - 1.0).abs() < 1e-12);
    assert_eq!((d.covered, d.psnr_covered, d.max_alpha, d.pixels), (None, None, None, 300));
}

#[test]
fn one_wrong_channel_by_hand() {
    let a = grey(2, 2, |_, _| 0.5);
    let mut b = a.clone();
    b.rgb[3][1] = 0.8;
    let d = compare(&a, &b, 0.25).unwrap();
    // One of twelve values is off by 0.3: √(0.09 / 12), 20 log₁₀ (√12 / 0.3).
    assert!((d.rmse - 0.0866025403784).abs() < 1e-12);
    assert!((d.psnr - 21.2493873661).abs() < 1e-9);
    assert!((d.max - 0.3).abs() < 1e-15);
    assert_eq!((d.over, compare(&a, &b, 0.31).unwrap().over), (1, 0));
    assert_eq!(d.ssim, None, "smaller than the window");
    assert!(!d.blank, "one of the two has something to show");
}

#[test]
fn covered_pixels_alone() {
    let mut a = grey(2, 2, |_, _| 0.0);
    let mut b = a.clone();
    a.alpha = Some(vec![1.0, 0.0, 0.0, 0.0]);
    b.alpha = Some(vec![1.0, 0.25, 0.0, 0.0]);
    b.rgb[1] = [0.1; 3];
    let d = compare(&a, &b, 0.2).unwrap();
    assert_eq!((d.covered, d.max_alpha), (Some(2), Some(0.25)));
    // Mean squares 0.01 / 4 over all, 0.01 / 2 over the covered two.
    assert!((d.psnr - 26.0205999133).abs() < 1e-9);
    assert!((d.psnr_covered.unwrap() - 23.0102999566).abs() < 1e-9);
    assert_eq!(d.over, 1, "by its coverage alone");
    b.alpha = Some(vec![0.0; 4]);
    a.alpha = Some(vec![0.0; 4]);
    assert_eq!(compare(&a, &b, 0.0).unwrap().psnr_covered, None);
}

#[test]
fn similarity_of_constant_pictures() {
    // No variance: the structure term is 1, and (2ab + c₁) / (a² + b² + c₁) remains.
    let d = compare(&grey(12, 14, |_, _| 0.2), &grey(12, 14, |_, _| 0.6), 0.0).unwrap();
    let expected = (2.0 * 0.12 + 1e-4) / (0.04 + 0.36 + 1e-4);
    assert!((d.ssim.unwrap() - expected).abs() < 1e-9, "{d:?}");
    assert!(d.blank);
}

#[test]
fn similarity_of_a_picture_and_its_negative() {
    // A chessboard has mean ½ and variance ¼ under the window (to some 10⁻⁶: the Gaussian's alternating sum), the negative has
    // covariance −¼: (½ + c₁)(−½ + c₂) / ((½ + c₁)(½ + c₂)).
    let board = grey(16, 16, |x, y| ((x + y) % 2) as f64);
    let negative = grey(16, 16, |x, y| ((x + y + 1) % 2) as f64);
    let d = compare(&board, &negative, 0.0).unwrap();
    let expected = (-0.5 + 9e-4) / (0.5 + 9e-4);
    assert!((d.ssim.unwrap() - expected).abs() < 1e-5, "{d:?} {expected}");
    assert_eq!(d.max, 1.0);
}

#[test]
fn similarity_weighs_the_centre_of_the_window() {
    // A single window, b = a + 0.5 at one pixel; by hand from the weights w = g(0)² or g(5)² with Σg = 1.
    let g: Vec<f64> = (-5..=5).map(|d: i32| (-(d * d) as f64 / 4.5).exp()).collect();
    let total: f64 = g.iter().sum();
    for (x, y) in [(5usize, 5usize), (0, 0), (3, 8)] {
        let w = g[x] * g[y] / (total * total);
        let a = grey(11, 11, |_, _| 0.25);
        let mut b = a.clone();
        b.rgb[y * 11 + x] = [0.75; 3];
        let (ma, mb) = (0.25, 0.25 + 0.5 * w);
        let variance = 0.25 * w * (1.0 - w);
        let expected = (2.0 * ma * mb + 1e-4) * 9e-4 / ((ma * ma + mb * mb + 1e-4) * (variance + 9e-4));
        let d = compare(&a, &b, 0.0).unwrap();
        assert!((d.ssim.unwrap() - expected).abs() < 1e-9, "{x} {y}: {d:?} {expected}");
    }
}

// The harness itself: what must not pass.

#[test]
fn a_shifted_picture_is_different() {
    let a = scene(24, 16);
    let mut b = a.clone();
    b.rgb.rotate_right(1);
    let d = compare(&a, &b, 1.0 / 255.0).unwrap();
    assert!(d.over > 300 && d.psnr < 20.0 && d.ssim.unwrap() < 0.95, "{d:?}");
}

#[test]
fn swapped_channels_are_different() {
    let a = scene(24, 16);
    let mut b = a.clone();
    b.rgb.iter_mut().for_each(|p| p.swap(0, 2));
    let d = compare(&a, &b, 1.0 / 255.0).unwrap();
    assert!(d.over > 300 && d.max > 0.3, "{d:?}");
}

#[test]
fn a_blank_pair_is_reported() {
    let blank = grey(16, 16, |_, _| 0.3);
    let d = compare(&blank, &blank, 0.0).unwrap();
    assert!(d.blank && d.rmse == 0.0);
    assert!(!compare(&blank, &scene(16, 16), 0.0).unwrap().blank);
    let mut covered = blank.clone();
    covered.alpha = Some((0..256).map(|i| (i % 2) as f64).collect());
    assert!(!compare(&covered, &covered, 0.0).unwrap().blank, "its coverage has a shape");
}

#[test]
fn what_cannot_be_compared() {
    let a = scene(4, 3);
    assert_eq!(compare(&a, &scene(3, 4), 0.0), Err(Incomparable::Sizes([4, 3], [3, 4])));
    assert_eq!(compare(&scene(0, 0), &scene(0, 0), 0.0), Err(Incomparable::Empty));
    let mut b = a.clone();
    b.rgb[6][2] = f64::NAN;
    assert_eq!(compare(&a, &b, 0.0), Err(Incomparable::NotFinite(2, 1)));
    assert_eq!(Incomparable::Sizes([4, 3], [3, 4]).to_string(), "pictures of different sizes: 4×3 and 3×4");
}

#[test]
fn pictures_from_bytes_and_from_linear_light() {
    let image = Image::from_srgb8(1, 2, 4, &[255, 0, 51, 102, 0, 255, 0, 255]);
    assert_eq!(image.rgb, [[1.0, 0.0, 0.2], [0.0, 1.0, 0.0]]);
    assert_eq!(image.alpha, Some(vec![0.4, 1.0]));
    assert_eq!(Image::from_srgb8(1, 1, 3, &[0, 0, 0]).alpha, None);
    // Half-covered white over black is ½ in linear light, 0.7354 encoded; over white it is white; overshoot is clamped.
    let half = [[0.5, 0.5, 2.0, 0.5]];
    let over_black = Image::from_linear(1, 1, &half, [0; 3]);
    assert!((over_black.rgb[0][0] - 0.735356983052445).abs() < 1e-12 && (over_black.rgb[0][2] - 1.0).abs() < 1e-12);
    assert!((Image::from_linear(1, 1, &half, [255; 3]).rgb[0][0] - 1.0).abs() < 1e-12);
    assert_eq!(over_black.alpha, Some(vec![0.5]));
    let nan = Image::from_linear(1, 1, &[[f64::NAN, 0.0, 0.0, 1.0]], [0; 3]);
    assert_eq!(compare(&nan, &nan, 0.0), Err(Incomparable::NotFinite(0, 0)));
}
