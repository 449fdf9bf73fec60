//! Mean structural similarity: Wang, Bovik, Sheikh, Simoncelli: Image Quality Assessment: From Error Visibility to
//! Structural Similarity, IEEE Transactions on Image Processing 13(4), 2004, with the paper's window and constants,
//! without its optional downsampling.

/// Side of the window \[px\] and the Gaussian's σ.
const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;

/// Mean over all windows that lie within the picture, 1 for equal pictures; `None` for pictures that have none.
pub(super) fn ssim(a: &[f64], b: &[f64], width: usize, height: usize) -> Option<f64> {
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
