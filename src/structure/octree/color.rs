//! Groups for the points of an octree.

use super::samples::cover;
use super::{Octree, Preset, picks};
use crate::error::Result;
use crate::structure::groups::{Groups, Relax};

/// Levels that are coloured at once.
const STEP: u8 = 2;
/// From the level that shows this share of all points the others are coloured at once: few are left, and what is drawn hardly
/// larger than at the last level.
const REST: f64 = 0.75;

impl Octree {
    /// Groups in which splats of one cut do not overlap (with c, as in [`Relax`]), but for those whose blocks are drawn at different
    /// levels.
    ///
    /// # Errors
    /// As [`Groups::color`].
    pub fn color(&self, relax: &Relax) -> Result<Groups> {
        relax.check()?;
        let levels = self.levels();
        if !picks(self.preset) {
            // A cut has few neighbours that differ by more than a depth.
            let together = |a: usize, b: usize| levels[a].abs_diff(levels[b]) <= self.octave();
            return Groups::color_where(&self.flat, relax, together);
        }
        // All levels up to one are drawn together, with radii for that level: coarse to fine, each beside those before it.
        let step = if self.preset == Preset::Poisson { STEP } else { 1 };
        let mut counts = [0usize; 256];
        levels.iter().for_each(|level| counts[*level as usize] += 1);
        let (mut shown, mut rest) = (0, 0);
        while (shown as f64) < REST * levels.len() as f64 {
            shown += counts[rest];
            rest += 1;
        }
        // The first level that is none of these; numbers of steps.
        let rest = (rest as u8).div_ceil(step);
        let steps: Vec<u8> = levels.iter().map(|level| (level / step).min(rest)).collect();
        let radii = |of: u8| {
            let side = self.sides.first().map_or(0.0, |side| *side as f64);
            // What the coarsest level of the step has.
            let spacing = side / ((of * step) as f64 / self.octave() as f64).exp2();
            let least = |own: f32| match self.preset {
                Preset::Poisson => (1.0 / self.octave() as f64).exp2() * cover(spacing, own),
                _ => spacing,
            };
            (0..self.flat.len() as u32).map(|i| self.flat.point(i)[3]).map(|own| own.max(least(own) as f32)).collect()
        };
        Ok(Groups::by_level(&self.flat, &steps, 0..=rest, relax, &[], radii))
    }
}
