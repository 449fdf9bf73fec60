//! The angular step of a scanner, by the rows and columns that its points came in.

use std::collections::HashMap;

use glam::DVec3;

/// Angles that a median is believed of.
const ENOUGH: usize = 16;
/// Scans' steps that differ by less than this factor are one.
const ALIKE: f64 = 1.05;

/// Angles between neighbours of a scan's grid, as seen from the scan's own origin. Neither needs the distance, so steps in
/// depth do not matter; the median leaves out what was rounded or moved.
///
/// Only the last point of each row and each column is kept, in whatever order points are stored.
#[derive(Default)]
pub(super) struct Grid {
    /// The last point of each row: its column and direction.
    rows: HashMap<i64, (i64, DVec3)>,
    /// The last point of each column: its row and direction.
    columns: HashMap<i64, (i64, DVec3)>,
    /// Between columns, and between rows \[rad\].
    angles: [Vec<f32>; 2],
}

impl Grid {
    /// The next point, in the scan's own frame.
    pub(super) fn push(&mut self, row: i64, column: i64, p: DVec3) {
        if p == DVec3::ZERO {
            return;
        }
        let [across, along] = &mut self.angles;
        for (last, of, at, angles) in [(&mut self.rows, row, column, across), (&mut self.columns, column, row, along)] {
            if let Some((before, q)) = last.insert(of, (at, p))
                && at.abs_diff(before) == 1
            {
                angles.push(p.cross(q).length().atan2(p.dot(q)) as f32);
            }
        }
    }

    /// The wider of both steps \[rad\]: what lies across the scanner's rays is covered in both directions.
    pub(super) fn step(&mut self) -> Option<f64> {
        let median = |angles: &mut Vec<f32>| {
            let middle = angles.len() / 2;
            (angles.len() >= ENOUGH).then(|| f64::from(*angles.select_nth_unstable_by(middle, f32::total_cmp).1))
        };
        let [across, along] = self.angles.each_mut().map(median);
        usable(across.into_iter().chain(along).fold(0.0, f64::max))
    }
}

/// A step that a radius can be made of.
pub(super) fn usable(step: f64) -> Option<f64> {
    (step > 0.0 && step < std::f64::consts::FRAC_PI_2).then_some(step)
}

/// One step for all scans, if they are alike.
pub(super) fn agreed(steps: &[Option<f64>]) -> Option<f64> {
    let steps: Vec<f64> = steps.iter().copied().collect::<Option<_>>()?;
    let (least, most) = (steps.iter().copied().reduce(f64::min)?, steps.iter().copied().reduce(f64::max)?);
    (most <= ALIKE * least).then_some(most)
}
