//! Errors of the outline: where a picture has holes in the truth's surface, and where it spills over its rim.

use super::all_around;

/// A pixel is covered from this coverage on: then its centre is more likely on the surface than off it.
const COVERED: f64 = 0.5;

/// Pixels that are covered in one picture only; covered means a coverage of at least one half.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Silhouette {
    /// Pixels that the truth covers.
    pub covered: u64,
    /// Covered pixels of the truth with an uncovered one beside, above or below them, within the picture: the measure of
    /// its outline's length.
    pub outline: u64,
    /// Pixels that the truth covers and the picture does not.
    pub holes: u64,
    /// Those of them whose neighbours, diagonal ones too, are all covered in the truth: real holes. The others may as well be
    /// a rim that is displaced by a pixel.
    pub holes_inside: u64,
    /// Pixels that the picture covers and the truth does not.
    pub spill: u64,
}

impl Silhouette {
    /// Holes as a share of the truth's outline; `None` where it has none. One pixel lost all along the rim is about 1; holes
    /// inside may bring it above.
    pub fn holes_share(&self) -> Option<f64> {
        self.share(self.holes)
    }

    /// Spill as a share of the truth's outline; `None` where it has none.
    pub fn spill_share(&self) -> Option<f64> {
        self.share(self.spill)
    }

    fn share(&self, count: u64) -> Option<f64> {
        (self.outline > 0).then(|| count as f64 / self.outline as f64)
    }
}

/// From the coverages of two pictures of `size` \[px\].
pub(super) fn silhouette(truth: &[f64], picture: &[f64], size: [usize; 2]) -> Silhouette {
    let [width, height] = size;
    let in_truth = |i: usize| truth[i] >= COVERED;
    let mut s = Silhouette { covered: 0, outline: 0, holes: 0, holes_inside: 0, spill: 0 };
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            match (in_truth(i), picture[i] >= COVERED) {
                (true, false) => {
                    s.holes += 1;
                    s.holes_inside += all_around(size, [x, y], 1, in_truth) as u64;
                }
                (false, true) => s.spill += 1,
                _ => {}
            }
            if in_truth(i) {
                let open = (x > 0 && !in_truth(i - 1))
                    || (x + 1 < width && !in_truth(i + 1))
                    || (y > 0 && !in_truth(i - width))
                    || (y + 1 < height && !in_truth(i + width));
                s.covered += 1;
                s.outline += open as u64;
            }
        }
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drawing: `#` is covered, `.` is not.
    fn parse(rows: &[&str]) -> (Vec<f64>, [usize; 2]) {
        let value = |c: char| if c == '#' { 0.5 } else { 0.5 - 1e-9 };
        (rows.iter().flat_map(|r| r.chars().map(value)).collect(), [rows[0].len(), rows.len()])
    }

    fn counts(truth: &[&str], picture: &[&str]) -> [u64; 5] {
        let ((a, size), (b, _)) = (parse(truth), parse(picture));
        let s = silhouette(&a, &b, size);
        [s.covered, s.outline, s.holes, s.holes_inside, s.spill]
    }

    const BLOCK: [&str; 6] = [".......", ".#####.", ".#####.", ".#####.", ".#####.", "......."];

    #[test]
    fn by_hand() {
        // 5 × 4 pixels have a rim of 14.
        assert_eq!(counts(&BLOCK, &BLOCK), [20, 14, 0, 0, 0]);
        // One hole inside, one in the rim, one corner, two of spill.
        let broken = ["..#....", ".####..", ".#.###.", "######.", ".####..", "......."];
        assert_eq!(counts(&BLOCK, &broken), [20, 14, 3, 1, 2]);
        // Seen from the other picture, holes are spill.
        let swapped = counts(&broken, &BLOCK);
        assert_eq!((swapped[2], swapped[4]), (2, 3));
        // A diagonal neighbour counts for the inside, not for the outline.
        assert_eq!(counts(&["##.", "###", "###"], &["##.", "#.#", "###"]), [8, 2, 1, 0, 0]);
    }

    #[test]
    fn a_rim_displaced_by_one_pixel_is_no_hole_inside() {
        let shifted = [".......", "..#####", "..#####", "..#####", "..#####", "......."];
        assert_eq!(counts(&BLOCK, &shifted), [20, 14, 4, 0, 4]);
    }

    #[test]
    fn the_border_of_the_picture_is_no_outline() {
        let full = ["###", "###"];
        assert_eq!(counts(&full, &full), [6, 0, 0, 0, 0]);
        assert_eq!(counts(&full, &[".##", "###"]), [6, 0, 1, 1, 0]);
        let (a, size) = parse(&full);
        assert_eq!(silhouette(&a, &a, size).holes_share(), None);
    }

    #[test]
    fn shares_are_of_the_outline() {
        let s = Silhouette { covered: 100, outline: 40, holes: 10, holes_inside: 0, spill: 60 };
        assert_eq!((s.holes_share(), s.spill_share()), (Some(0.25), Some(1.5)));
    }
}
