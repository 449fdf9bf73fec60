//! Where the points lie, and the picture that they must give.

use super::case::{Case, Passes, Vertices};

/// The largest side of a square \[px\]: the same places serve all sizes.
pub const LARGEST: u32 = 64;

/// Depths as fractions of 65535, reversed: a closed surface has a front and a back.
const BACK: u16 = 16384;
const FRONT: u16 = 49152;

/// Upper left corner of a point's square \[px\], and its depth, by its number. The corner is whole, so the square covers
/// whole pixels; the largest one lies in the picture.
fn place(i: u32, places: [u32; 2]) -> [u16; 3] {
    let h = hash(i);
    let depth = if hash(h) & 1 != 0 { FRONT } else { BACK };
    [((h & 0xffff) % places[0]) as u16, ((h >> 16) % places[1]) as u16, depth]
}

/// As in glsl/shared/raw.glsl.
fn hash(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// How many places there are along each side of a picture \[px\].
pub fn places(extent: [u32; 2]) -> [u32; 2] {
    extent.map(|side| side - LARGEST + 1)
}

/// The bytes of `points` vertices: fractions of 65535. `Computed` has none.
pub fn vertices(format: Vertices, points: u32, extent: [u32; 2]) -> Vec<u8> {
    let places = places(extent);
    let all = (0..points).map(|i| place(i, places));
    let floats = |[x, y, z]: [u16; 3]| [x, y, z, u16::MAX].map(|v| v as f32 / 65535.0);
    match format {
        Vertices::F32x3 => {
            all.flat_map(|p| bytemuck::cast::<_, [u8; 12]>([floats(p)[0], floats(p)[1], floats(p)[2]])).collect()
        }
        Vertices::F32x4 | Vertices::Pulled => all.flat_map(|p| bytemuck::cast::<_, [u8; 16]>(floats(p))).collect(),
        Vertices::Unorm16x4 => all.flat_map(|[x, y, z]| bytemuck::cast::<_, [u8; 8]>([x, y, z, u16::MAX])).collect(),
        Vertices::Computed => Vec::new(),
    }
}

/// What a picture must show, by pixel.
pub struct Predicted {
    /// Fragments that stay: added, or one that is put in place. Without the limits of a format.
    pub fragments: Vec<u32>,
    /// Depth of the front, 0 where there is nothing.
    pub depth: Vec<f32>,
}

/// Draws the case on the processor: whole pixels, so every one is known.
pub fn predict(case: &Case, points: u32, extent: [u32; 2]) -> Predicted {
    let [width, height] = extent.map(|side| side as usize);
    let (mut front, mut back) = (vec![0u32; width * height], vec![0u32; width * height]);
    let places = places(extent);
    for i in 0..points {
        let [x, y, depth] = place(i, places);
        let into = if depth == FRONT { &mut front } else { &mut back };
        for row in 0..case.size as usize {
            let start = (y as usize + row) * width + x as usize;
            into[start..start + case.size as usize].iter_mut().for_each(|count| *count += 1);
        }
    }
    let depths = front.iter().zip(&back).map(|(f, b)| match (f, b) {
        (0, 0) => 0.0,
        (0, _) => BACK as f32 / 65535.0,
        _ => FRONT as f32 / 65535.0,
    });
    let stay = front.iter().zip(&back).map(|(&f, &b)| match case.passes {
        Passes::TwoPass if f > 0 => f,
        _ => f + b,
    });
    let fragments = stay.map(|n| if case.blend { n } else { n.min(1) }).collect();
    Predicted { depth: depths.collect(), fragments }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::standalone::raw::cases;

    #[test]
    fn every_fragment_is_in_the_picture() {
        let extent = [71, 90];
        for case in cases().iter().filter(|c| c.blend && c.passes == Passes::Color) {
            let sum: u64 = predict(case, 500, extent).fragments.iter().map(|&n| n as u64).sum();
            assert_eq!(sum, 500 * (case.size as u64).pow(2), "{case}");
        }
    }

    #[test]
    fn points_are_spread_over_places_and_depths() {
        let mut seen = [[0; 3]; 2];
        for i in 0..30_000 {
            let [x, y, depth] = place(i, [3, 3]);
            seen[0][x as usize] += 1;
            seen[1][y as usize] += (depth == FRONT) as u32;
        }
        // Binomial: 10,000 ± 5 · 82 and 5,000 ± 5 · 65.
        assert!(seen[0].iter().all(|n| (9_590..10_410).contains(n)), "{seen:?}");
        assert!(seen[1].iter().all(|n| (4_675..5_325).contains(n)), "{seen:?}");
    }

    #[test]
    fn two_passes_keep_the_front() {
        let two_pass = cases().into_iter().find(|c| c.passes == Passes::TwoPass).expect("there is one");
        let all = Case { passes: Passes::Color, ..two_pass };
        let (kept, all) = (predict(&two_pass, 300, [80, 80]), predict(&all, 300, [80, 80]));
        let sum = |p: &Predicted| p.fragments.iter().sum::<u32>();
        assert!(sum(&kept) < sum(&all) && sum(&kept) > sum(&all) / 2);
        assert!(kept.fragments.iter().zip(&kept.depth).all(|(n, z)| (*n > 0) == (*z > 0.0)));
    }
}
