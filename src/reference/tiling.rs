//! Pictures in tiles: each tile is one task, and its bytes do not depend on which thread runs it.

use rayon::prelude::*;

use super::{Counts, Picture};

/// A finished pixel, or one of its samples.
#[derive(Clone, Copy)]
pub struct Pixel {
    /// Linear light, premultiplied.
    pub rgba: [f64; 4],
    /// Linear depth; infinite where nothing is.
    pub depth: f64,
    pub tie: bool,
    /// See [`Picture::sensitivity`].
    pub sensitivity: f64,
}

impl Pixel {
    /// Nothing there.
    pub const EMPTY: Pixel = Pixel { rgba: [0.0; 4], depth: f64::INFINITY, tie: false, sensitivity: 0.0 };

    /// The box filter: the mean of the samples' premultiplied light, the lower median of the depths of those that are
    /// covered. On a slope that is the centre's depth to within the samples' distance, and at an edge it is one of the
    /// two surfaces', never a depth between them where nothing is.
    pub fn mean(samples: &[Pixel]) -> Pixel {
        let mut sum = [0.0; 4];
        let mut depths: Vec<f64> = Vec::with_capacity(samples.len());
        for sample in samples {
            for (sum, value) in sum.iter_mut().zip(sample.rgba) {
                *sum += value;
            }
            depths.extend(Some(sample.depth).filter(|z| z.is_finite()));
        }
        let depth = match depths.len() {
            0 => f64::INFINITY,
            n => *depths.select_nth_unstable_by((n - 1) / 2, f64::total_cmp).1,
        };
        Pixel {
            rgba: sum.map(|s| s / samples.len() as f64),
            depth,
            tie: samples.iter().any(|s| s.tie),
            sensitivity: samples.iter().map(|s| s.sensitivity).fold(0.0, f64::max),
        }
    }
}

/// The picture whose tiles of `side` × `side` pixels `draw` returns, row by row, given the tile's number and its area
/// (x0, y0, x1, y1 \[px\], the last two exclusive). Tiles count along rows; those at the right and lower border are cut.
pub fn picture(width: u32, height: u32, side: u32, draw: impl Fn(usize, [u32; 4]) -> Vec<Pixel> + Sync) -> Picture {
    let columns = width.div_ceil(side) as usize;
    let area = |tile: usize| {
        let (x0, y0) = ((tile % columns) as u32 * side, (tile / columns) as u32 * side);
        [x0, y0, (x0 + side).min(width), (y0 + side).min(height)]
    };
    let number = columns * height.div_ceil(side) as usize;
    let tiles: Vec<Vec<Pixel>> = (0..number).into_par_iter().map(|tile| draw(tile, area(tile))).collect();

    let pixels = width as usize * height as usize;
    let mut picture = Picture {
        width,
        height,
        rgba: vec![[0.0; 4]; pixels],
        depth: vec![f64::INFINITY; pixels],
        ties: vec![false; pixels],
        sensitivity: vec![0.0; pixels],
        counts: Counts::default(),
    };
    for (tile, finished) in tiles.iter().enumerate() {
        let [x0, y0, x1, y1] = area(tile);
        let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| y as usize * width as usize + x as usize));
        for (at, pixel) in places.zip(finished) {
            picture.rgba[at] = pixel.rgba;
            picture.depth[at] = pixel.depth;
            picture.ties[at] = pixel.tie;
            picture.sensitivity[at] = pixel.sensitivity;
        }
    }
    picture
}
