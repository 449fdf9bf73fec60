//! Poisson-disk samples of an octree's points, one a level.
//!
//! Cells of up to [`UNIT`] points are put in farthest-first order as a whole, so that blocks have no seams; along the border of a unit
//! points may be nearer to each other than a level has it.
//!
//! What is drawn from afar lies together: a cell of side L holds the points up to the level with s = L / 32 that its
//! ancestors do not hold, some hundreds. A cell without children, a block, holds the rest.

use std::ops::Range;

use glam::Vec3;

use super::build::{Builder, Entry};
use super::farthest::farthest_first;
use super::{Cell, Octree, Preset, Run, along, levels_a_depth};
use crate::par;
use crate::select::Sight;

/// Most points that are put in order together.
const UNIT: usize = 1 << 18;
/// Most points of a block whose radii are looked at: a file may have many blocks of the same points.
const ASKED: usize = 256;
/// A point stays down to a distance of so many of its radii, however near others are: beside its disc the one that would stand for
/// it may be small.
const STAYS: f32 = 0.5;
/// Octaves from a cell's side to the least distance between the points that it holds, unless it is a block.
const HELD: u8 = 5;

/// The last level of what an inner cell of a depth holds.
fn held(depth: u8) -> u8 {
    levels_a_depth(Preset::Poisson) * (depth + HELD)
}

impl Builder<'_> {
    /// Of all places the first level that shows them.
    pub fn sample(&self) -> Vec<u8> {
        let mut units = Vec::new();
        self.units(0..self.places.len(), 0, &mut units);
        let deepest = self.level(self.deepest);
        let squares: Vec<f32> =
            (0..deepest).map(|level| (self.side(0) as f64 / along(self.options, level)).powi(2) as f32).collect();
        let sampled = par::map(&units, |unit| {
            let points: Vec<Vec3> = self.places[unit.clone()].iter().map(|place| self.flat.position(place.1)).collect();
            // Of points at one place all but one are there in full detail alone.
            let mut levels = vec![deepest; points.len()];
            let level = |square: f32| squares.partition_point(|s| *s > square) as u8;
            farthest_first(&points, |i, left| levels[i] = level(left));
            for (own, place) in levels.iter_mut().zip(&self.places[unit.clone()]) {
                let radius = self.flat.geometry[place.1 as usize][3];
                *own = (*own).min(level((STAYS * radius).powi(2)));
            }
            levels
        });
        sampled.concat()
    }

    fn units(&self, range: Range<usize>, depth: u8, units: &mut Vec<Range<usize>>) {
        if range.len() <= UNIT || depth == self.deepest {
            units.push(range);
        } else {
            self.children(range, depth).for_each(|child| self.units(child, depth + 1, units));
        }
    }

    /// Those of a range that no ancestor of a cell of this depth holds.
    fn left(&self, range: Range<usize>, depth: u8) -> impl Iterator<Item = usize> {
        let above = depth.checked_sub(1).map(held);
        range.filter(move |&i| above.is_none_or(|above| self.sampled[i] > above))
    }

    /// Whether the rest of a range is a block.
    fn is_block(&self, range: &Range<usize>, depth: u8) -> bool {
        depth == self.deepest || self.left(range.clone(), depth).count() <= self.options.block.max(1) as usize
    }

    /// Cells of a range of places, depth first, none where ancestors hold all.
    pub fn split_samples(&mut self, range: Range<usize>, depth: u8, blocks: &mut Vec<usize>) {
        if self.left(range.clone(), depth).next().is_none() {
            return;
        }
        let own = self.cell_of(range.clone(), depth);
        let block = self.is_block(&range, depth);
        if block || self.left(range.clone(), depth).any(|i| self.sampled[i] <= held(depth)) {
            blocks.push(own);
        }
        if !block {
            let children: Vec<_> = self.children(range, depth).collect();
            children.into_iter().for_each(|child| self.split_samples(child, depth + 1, blocks));
        }
        self.cells[own].skip = self.cells.len() as u32;
    }

    /// What a cell holds itself.
    pub fn samples(&self, range: Range<usize>, cell: &Cell) -> Vec<(u8, Entry)> {
        let most = if self.is_block(&range, cell.level) { u8::MAX } else { held(cell.level) };
        self.left(range, cell.level)
            .map(|i| self.point(i, self.sampled[i]))
            .filter(|(level, _)| *level <= most)
            .collect()
    }
}

impl Octree {
    /// Adds the spans that a view needs.
    pub(super) fn select_samples(&self, sight: &Sight, push: &mut impl FnMut(u32, u32, f32)) {
        let octave = self.octave() as f64;
        let mut at = 0;
        while let Some(cell) = self.cells.get(at) {
            let distance = sight.distance(cell.min, cell.max);
            let farthest = distance + (cell.max - cell.min).length() as f64;
            let least = (1.0 / octave).exp2() * cover(sight.tau * farthest, cell.reach);
            if sight.misses(cell.min, cell.max, cell.reach.max(least as f32)) {
                at = cell.skip as usize;
                continue;
            }
            // The first level whose distances suffice for the nearest point. From the infinite to u8::MAX.
            let level = (octave * (self.sides[0] as f64 / (sight.tau * distance)).log2()).ceil() as u8;
            let full = level >= cell.finest;
            if let Some(block) = self.blocks.get(cell.block as usize) {
                let least = if full { 0.0 } else { self.wide(level, block.own) };
                push(block.points.first, self.up_to(&block.points, level), least);
            }
            at = if full || level > held(cell.level) { at + 1 } else { cell.skip as usize };
        }
    }

    /// Least radius at a level of points whose median radius is `own`. Rounded up to the distance of a level, or every block had a least
    /// radius of its own, and a draw.
    fn wide(&self, level: u8, own: f32) -> f32 {
        let octave = self.octave() as f64;
        let side = self.sides[0] as f64;
        let spacing = side / (level as f64 / octave).exp2();
        let levels = (octave * (cover(spacing, own) / spacing).log2() - 1e-6).ceil();
        (side / ((level as f64 - levels) / octave).exp2()) as f32
    }

    /// Finds what selection needs to know of Poisson-disk samples beside what is stored, in time for each cell and block.
    pub(super) fn measure(&mut self) {
        if self.preset != Preset::Poisson {
            return;
        }
        for at in 0..self.blocks.len() {
            let Run { first, base, levels, .. } = self.blocks[at].points;
            let count = self.up_to(&self.blocks[at].points, base + levels - 1);
            let some = (first..first + count).step_by(count as usize / ASKED + 1);
            let mut radii: Vec<f32> = some.map(|i| self.flat.point(i)[3]).collect();
            radii.sort_unstable_by(f32::total_cmp);
            self.blocks[at].own = radii.get(radii.len() / 2).copied().unwrap_or(0.0);
        }
        for at in (0..self.cells.len()).rev() {
            let block = self.blocks.get(self.cells[at].block as usize);
            let mut finest = block.map_or(0, |block| block.points.base + block.points.levels - 1);
            let mut child = at + 1;
            while child < self.cells[at].skip as usize {
                finest = finest.max(self.cells[child].finest);
                child = self.cells[child].skip as usize;
            }
            self.cells[at].finest = finest;
        }
    }
}

/// Radius with which points that far apart cover all that those between them did, which have a radius of `own`. Gaps are as wide
/// as the distance, and 1/√2 of it in a grid, for which a radius is made; and what is left out reaches into a gap of the scan,
/// about half of its radius, which is no more than the distance: it is left out for lying that near.
pub(super) fn cover(spacing: f64, own: f32) -> f64 {
    (2.0 * spacing.powi(2) + 0.5 * (own as f64).min(spacing).powi(2)).sqrt()
}
