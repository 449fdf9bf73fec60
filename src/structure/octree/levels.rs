//! What a block holds, by level.

use std::ops::Range;

use super::average::{Sample, Stored, average};
use super::build::{BELOW, Builder, Entry, Place};
use super::{Cell, Preset, along, levels_a_depth};
use crate::structure::morton::{LEVELS, axes};

/// Between two of the octree's levels is a grid where at least one in so many points shares its cell at the coarser one. Beyond,
/// nearly all points are drawn anyhow, and what a grid would save is less than what it takes.
const SHARE: usize = 2;

/// A block's points and averages with their levels, sorted by level.
pub(super) struct Filled {
    pub points: Vec<(u8, Entry)>,
    pub averages: Vec<(u8, Stored)>,
}

/// Points of a block by their cell in a grid that is none of the octree's.
struct Grid {
    level: u8,
    /// Cell, and number of the point in the block; sorted.
    cells: Vec<(u64, u32)>,
}

impl Builder<'_> {
    /// Levels of the points of a cell that is a block, and its averages.
    pub fn fill(&self, range: Range<usize>, cell: &Cell) -> Filled {
        let depth = cell.level;
        let mut filled = match self.options.preset {
            Preset::VboR => Filled { points: range.map(|i| self.point(i, depth)).collect(), averages: Vec::new() },
            Preset::Mospt => Filled { points: self.picked_by_level(range, depth), averages: Vec::new() },
            Preset::Poisson => Filled { points: self.samples(range, cell), averages: Vec::new() },
            Preset::Espt | Preset::RGrid => self.averaged(range, depth),
        };
        filled.points.sort_by_key(|(level, _)| *level);
        filled
    }

    pub fn point(&self, i: usize, level: u8) -> (u8, Entry) {
        (level, Entry::Point(self.places[i].1))
    }

    /// The point nearest to a cell's centre stands for it, level by level.
    fn picked_by_level(&self, range: Range<usize>, depth: u8) -> Vec<(u8, Entry)> {
        let (mut left, above): (Vec<usize>, Vec<usize>) = range.partition(|&i| self.above[i] == BELOW);
        let mut points: Vec<_> = above.into_iter().map(|i| self.point(i, self.above[i])).collect();
        for level in depth..self.deepest {
            if left.is_empty() {
                break;
            }
            let mut deeper = Vec::with_capacity(left.len());
            let same =
                |a: &usize, b: &usize| self.prefix(self.places[*a].0, level) == self.prefix(self.places[*b].0, level);
            for cell in left.chunk_by(same) {
                let centre = self.centre(self.places[cell[0]].0, level);
                let nearest = self.nearest(cell.iter().copied(), centre);
                points.extend(nearest.map(|i| self.point(i, level)));
                deeper.extend(cell.iter().copied().filter(|i| Some(*i) != nearest));
            }
            left = deeper;
        }
        points.extend(left.into_iter().map(|i| self.point(i, self.deepest)));
        points
    }

    /// Averages of cells, and the points by the level from which on they are alone.
    fn averaged(&self, range: Range<usize>, depth: u8) -> Filled {
        let places = &self.places[range.clone()];
        let (a_depth, own) = (levels_a_depth(self.options.preset), self.level(depth));
        let (levels, grids) = self.levels(&range, depth);
        let deepest = levels.iter().copied().max().unwrap_or(own);
        let samples: Vec<Sample> = places.iter().map(|place| Sample::of(self.flat, place.1)).collect();
        let mut averages = Vec::new();
        for level in (own..deepest).step_by(a_depth as usize) {
            let (at, mut first) = (level / a_depth, 0);
            for cell in places.chunk_by(|a, b| self.prefix(a.0, at) == self.prefix(b.0, at)) {
                let end = first + cell.len();
                // What is alone here, but not in a finer grid, is drawn as an average of one.
                if levels[first] > level {
                    averages.push((level, self.cell(samples[first..end].iter().copied(), cell[0].0, at)));
                }
                first = end;
            }
            if let Some(grid) = grids.iter().find(|grid| grid.level == level + 1 && grid.level < deepest) {
                let side = self.side(depth) / along(self.options, grid.level - own) as f32;
                for cell in grid.cells.chunk_by(|a, b| a.0 == b.0) {
                    if levels[cell[0].1 as usize] > grid.level {
                        let samples = cell.iter().map(|&(_, i)| samples[i as usize]);
                        averages.push((grid.level, average(samples, self.flat.closed, side)));
                    }
                }
            }
        }
        Filled { points: self.alone_or_merged(range, &levels, deepest), averages }
    }

    /// The least level of each point from which on no cell holds it with another of the block, and the grids between the
    /// octree's levels.
    fn levels(&self, range: &Range<usize>, depth: u8) -> (Vec<u8>, Vec<Grid>) {
        let own = self.level(depth);
        let nested = |alone: u8| self.level(alone.clamp(depth, self.deepest.max(depth)));
        let mut levels: Vec<u8> = self.alone(range).map(nested).collect();
        let mut grids = Vec::new();
        if self.options.preset != Preset::Espt {
            return (levels, grids);
        }
        let sharing = |level: u8| levels.iter().filter(|own| **own > level).count();
        let enough = |level: &u8| SHARE * sharing(*level - 1) >= range.len();
        // One cell and a half along an edge is the block itself.
        let there = (own + 3..self.level(self.deepest)).step_by(2).take_while(enough);
        grids.extend(there.map(|level| Grid { level, cells: self.grid(range, depth, level - own) }));
        // Beyond the last grid in which a point shares its cell.
        let mut shared = vec![0; levels.len()];
        for grid in &grids {
            for cell in grid.cells.chunk_by(|a, b| a.0 == b.0).filter(|cell| cell.len() > 1) {
                cell.iter().for_each(|&(_, i)| shared[i as usize] = grid.level + 1);
            }
        }
        for (level, shared) in levels.iter_mut().zip(shared) {
            if shared >= *level {
                *level = shared;
            } else if grids.iter().any(|grid| grid.level + 1 == *level) {
                *level -= 1;
            }
        }
        (levels, grids)
    }

    /// A block's points by cell, some half octaves below it. In whole numbers: a place has as many bits as codes have left.
    fn grid(&self, range: &Range<usize>, depth: u8, half_octaves: u8) -> Vec<(u64, u32)> {
        let (bits, n) = (LEVELS - depth as u32, along(self.options, half_octaves) as u64);
        let cell = |code: u64| {
            let [x, y, z] = axes(code).map(|v| ((v & ((1 << bits) - 1)) * n) >> bits);
            (z * n + y) * n + x
        };
        let mut cells: Vec<(u64, u32)> = (0..).zip(&self.places[range.clone()]).map(|(i, p)| (cell(p.0), i)).collect();
        cells.sort_unstable();
        cells
    }

    /// A block's points; where a grid ends, those of one cell are one.
    fn alone_or_merged(&self, range: Range<usize>, levels: &[u8], deepest: u8) -> Vec<(u8, Entry)> {
        let places = &self.places[range.clone()];
        let mut points = Vec::with_capacity(places.len());
        let merged = self.options.preset == Preset::RGrid && deepest == self.deepest;
        let mut first = range.start;
        let same = |a: &Place, b: &Place| merged && self.prefix(a.0, deepest) == self.prefix(b.0, deepest);
        for cell in places.chunk_by(same) {
            if cell.len() > 1 {
                points
                    .push((deepest, Entry::Average { first: first as u32, count: cell.len() as u32, depth: deepest }));
            } else {
                points.push(self.point(first, levels[first - range.start]));
            }
            first += cell.len();
        }
        points
    }
}
