//! From a flat array to blocks.

use std::ops::Range;

use glam::{DVec3, Vec3};

use super::average::{Sample, Stored, average};
use super::{Block, Cell, Octree, Options, Preset, Run, grids, levels_a_depth, picks};
use crate::par;
use crate::structure::file::fingerprint;
use crate::structure::morton::{Cube, LEVELS, axes};
use crate::structure::nodes::NONE;
use crate::structure::{Flat, octahedral};

/// Squares of larger coordinates are not safe in single floats: what lies there is in no cell.
const FARTHEST: f32 = 1e15;
/// Points a task.
const GRAIN: usize = 1 << 14;

/// A place on the Morton curve, and the point there.
pub(super) type Place = (u64, u32);

/// A point that is to be stored.
#[derive(Clone, Copy)]
pub(super) enum Entry {
    /// One of the input's; in an r-grid at the centre of its cell of the deepest level.
    Point(u32),
    /// The average of those at these places, the cell of a depth.
    Average { first: u32, count: u32, depth: u8 },
}

pub(super) struct Builder<'a> {
    pub flat: &'a Flat,
    pub options: &'a Options,
    cube: Cube,
    /// Morton levels from a cell to its children.
    step: u32,
    /// Depth of the deepest cells.
    pub deepest: u8,
    pub places: Vec<Place>,
    /// For MOSPTs: by place, the depth of the inner cell that a point stands for.
    pub above: Vec<u8>,
    pub cells: Vec<Cell>,
    /// Of each cell, its places.
    ranges: Vec<Range<usize>>,
    /// By place, the level from which on a point is drawn, for Poisson-disk samples.
    pub sampled: Vec<u8>,
    /// For MOSPTs: of each inner cell, the point that stands for it.
    picked: Vec<u32>,
}

/// In `above`: it stands for none.
pub(super) const BELOW: u8 = u8::MAX;

impl Octree {
    /// Builds one. The same bytes for the same input. Points that are no splats (no number, no radius) or lie 10¹⁵ away are
    /// in no block, and always submitted.
    pub fn build(flat: &Flat, options: &Options) -> Octree {
        let full = flat.unpacked();
        let flat = &*full;
        let step = if options.preset == Preset::RGrid { options.r.clamp(2, 8).ilog2() } else { 1 };
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let mut loose = Vec::new();
        let mut inside = Vec::new();
        for (i, geometry) in (0..).zip(&flat.geometry) {
            if is_point(geometry) {
                let p = flat.position(i);
                (low, high) = (low.min(p), high.max(p));
                inside.push(i);
            } else {
                loose.push(i);
            }
        }
        let cube = Cube::round(low, high);
        let mut places: Vec<Place> = vec![(0, 0); inside.len()];
        par::fill(&mut places, GRAIN, |first, part| {
            for (place, &i) in part.iter_mut().zip(&inside[first..]) {
                *place = (cube.code(flat.position(i)), i);
            }
        });
        par::sort(&mut places);
        let above = vec![BELOW; if options.preset == Preset::Mospt { places.len() } else { 0 }];
        let deepest = (LEVELS / step) as u8;
        let (cells, ranges, picked, sampled) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut builder = Builder { flat, options, cube, step, deepest, places, above, sampled, cells, ranges, picked };
        if options.preset == Preset::RGrid {
            builder.deepest = builder.grid_depth();
        }
        if options.preset == Preset::Poisson {
            builder.sampled = builder.sample();
        }
        builder.build(&loose)
    }
}

impl Builder<'_> {
    /// The depth at which 95 of a hundred points are alone in their cells: there a grid ends, and the others are merged.
    fn grid_depth(&self) -> u8 {
        let mut alone = vec![0usize; self.deepest as usize + 1];
        for level in self.alone(&(0..self.places.len())) {
            alone[level.min(self.deepest) as usize] += 1;
        }
        let mut sum = 0;
        let enough = |n: &usize| {
            sum += n;
            sum * 20 >= self.places.len() * 19
        };
        alone.iter().position(enough).map_or(self.deepest, |level| level as u8)
    }

    /// The least depth at which each of a range of places is alone in its cell of the octree among them.
    pub fn alone<'a>(&'a self, range: &Range<usize>) -> impl Iterator<Item = u8> + 'a {
        let places = &self.places[range.clone()];
        // Codes have 63 bits, three a Morton level.
        let shared = |a: u64, b: u64| ((a ^ b).leading_zeros().saturating_sub(1) / 3 / self.step) as u8;
        let depth = move |a: Option<&Place>, b: &Place| a.map_or(0, |a| shared(a.0, b.0) + 1);
        (0..places.len()).map(move |i| {
            let before = i.checked_sub(1).map(|i| &places[i]);
            depth(before, &places[i]).max(depth(places.get(i + 1), &places[i]))
        })
    }

    /// Ranges of places in the children of a cell.
    pub fn children(&self, range: Range<usize>, depth: u8) -> impl Iterator<Item = Range<usize>> + use<'_> {
        let mut start = range.start;
        std::iter::from_fn(move || {
            let digits = self.prefix(self.places.get(start).filter(|_| start < range.end)?.0, depth + 1);
            let rest = &self.places[start..range.end];
            let end = start + rest.partition_point(|place| self.prefix(place.0, depth + 1) <= digits);
            let child = start..end;
            start = end;
            Some(child)
        })
    }

    fn build(mut self, loose: &[u32]) -> Octree {
        let mut blocks = Vec::new();
        let all = 0..self.places.len();
        if self.options.preset == Preset::Poisson {
            self.split_samples(all, 0, &mut blocks);
        } else if !self.places.is_empty() {
            self.split(all, 0, &mut blocks);
        }
        let filled = par::map(&blocks, |&cell| self.fill(self.ranges[cell].clone(), &self.cells[cell]));

        let mut entries: Vec<Entry> = loose.iter().map(|&i| Entry::Point(i)).collect();
        let mut represented = vec![NONE; self.cells.len()];
        if !picks(self.options.preset) {
            // By depth: those of siblings are neighbours.
            let mut by_depth: Vec<usize> = (0..self.cells.len()).collect();
            by_depth.sort_by_key(|&cell| self.cells[cell].level);
            for cell in by_depth {
                let (range, depth) = (&self.ranges[cell], self.cells[cell].level);
                represented[cell] = entries.len() as u32;
                entries.push(Entry::Average { first: range.start as u32, count: range.len() as u32, depth });
            }
        }
        let above = entries.len();
        let mut ends = Vec::new();
        let mut runs = vec![Block::default(); blocks.len()];
        let mut averages = Vec::new();
        for (block, filled) in runs.iter_mut().zip(&filled) {
            block.averages = run(&filled.averages, (above + averages.len()) as u32, &mut ends);
            averages.extend(filled.averages.iter().map(|(_, average)| *average));
        }
        for (block, filled) in runs.iter_mut().zip(&filled) {
            block.points = run(&filled.points, (entries.len() + averages.len()) as u32, &mut ends);
            entries.extend(filled.points.iter().map(|(_, entry)| *entry));
        }
        drop(filled);
        if self.options.preset == Preset::Mospt {
            let mut at = vec![NONE; self.flat.len()];
            for (i, entry) in (0..).zip(&entries) {
                if let Entry::Point(point) = entry {
                    at[*point as usize] = i;
                }
            }
            for (by, &point) in represented.iter_mut().zip(&self.picked) {
                *by = at.get(point as usize).copied().unwrap_or(NONE);
            }
        }

        let (flat, moved) = self.store(&entries, &averages, above);
        for (number, &cell) in blocks.iter().enumerate() {
            self.cells[cell].block = number as u32;
            if represented[cell] == NONE {
                represented[cell] = runs[number].points.first;
            }
        }
        let sides = (0..=self.deepest).map(|depth| self.side(depth)).collect();
        for (cell, by) in self.cells.iter_mut().zip(&represented) {
            cell.represented_by = *by;
        }
        for at in (0..self.cells.len()).rev().filter(|&at| represented[at] == NONE) {
            // All of its points stand for cells above: then what stands for the first one below does.
            self.cells[at].represented_by = self.cells[at + 1].represented_by;
        }
        let mut octree = Octree {
            flat,
            preset: self.options.preset,
            options: *self.options,
            cloud: fingerprint(self.flat),
            cells: std::mem::take(&mut self.cells),
            points: self.flat.len() as u32,
            moved,
            loose: loose.len() as u32,
            blocks: runs,
            ends,
            sides,
            grids: grids(self.options, self.deepest),
        };
        octree.measure();
        octree.enclose();
        octree
    }

    /// Number of the level that the cells of a depth are.
    pub fn level(&self, depth: u8) -> u8 {
        levels_a_depth(self.options.preset) * depth
    }

    /// Edge of the cells of a depth.
    pub fn side(&self, depth: u8) -> f32 {
        (self.cube.side / (1u64 << (self.step * depth as u32)) as f32).max(f32::MIN_POSITIVE)
    }

    /// Digits of a place down to a depth.
    pub fn prefix(&self, code: u64, depth: u8) -> u64 {
        code.checked_shr(3 * (LEVELS - self.step * depth as u32)).unwrap_or(0)
    }

    /// Cells of a range of places, depth first.
    fn split(&mut self, range: Range<usize>, level: u8, blocks: &mut Vec<usize>) {
        let own = self.cell_of(range.clone(), level);
        if range.len() <= self.options.block.max(1) as usize || level == self.deepest {
            blocks.push(own);
        } else {
            if self.options.preset == Preset::Mospt {
                let centre = self.centre(self.places[range.start].0, level);
                let free = range.clone().filter(|&i| self.above[i] == BELOW);
                if let Some(nearest) = self.nearest(free, centre) {
                    self.above[nearest] = level;
                    self.picked[own] = self.places[nearest].1;
                }
            }
            let children: Vec<_> = self.children(range, level).collect();
            children.into_iter().for_each(|child| self.split(child, level + 1, blocks));
        }
        self.cells[own].skip = self.cells.len() as u32;
    }

    /// Adds a cell of these places at a depth, without its descendants. Returns its number.
    pub fn cell_of(&mut self, range: Range<usize>, level: u8) -> usize {
        let (min, max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        self.cells.push(Cell { min, max, reach: 0.0, level, finest: 0, skip: 0, represented_by: NONE, block: NONE });
        self.ranges.push(range);
        self.picked.push(NONE);
        self.cells.len() - 1
    }

    /// Of places, the point nearest to somewhere; of equals the first.
    pub fn nearest(&self, places: impl Iterator<Item = usize>, to: Vec3) -> Option<usize> {
        let far = |i: usize| (self.flat.position(self.places[i].1) - to).length_squared();
        places
            .fold(None, |best: Option<(usize, f32)>, i| match best {
                Some((_, d)) if d <= far(i) => best,
                _ => Some((i, far(i))),
            })
            .map(|(i, _)| i)
    }

    /// Middle of the cell of a depth at a place.
    pub fn centre(&self, code: u64, depth: u8) -> Vec3 {
        let side = self.cube.side as f64 / (1u64 << (self.step * depth as u32)) as f64;
        let [x, y, z] = axes(self.prefix(code, depth)).map(|v| v as f64 + 0.5);
        (self.cube.low.as_dvec3() + side * DVec3::new(x, y, z)).as_vec3()
    }

    /// What stands for the points of the cell of a depth at a place.
    pub fn cell(&self, samples: impl Iterator<Item = Sample>, code: u64, depth: u8) -> Stored {
        let mut stored = average(samples, self.flat.closed, self.side(depth));
        if self.options.preset == Preset::RGrid {
            stored.geometry[..3].copy_from_slice(&self.centre(code, depth).to_array());
        }
        stored
    }

    /// The points to be drawn, `averages` after the first few entries, and how far one was moved.
    fn store(&self, entries: &[Entry], averages: &[Stored], above: usize) -> (Flat, f32) {
        let flat = self.flat;
        let grid = self.options.preset == Preset::RGrid;
        let centre = |i: &u32| self.centre(self.cube.code(flat.position(*i)), self.deepest);
        let moves = |i: &u32| grid && is_point(&flat.geometry[*i as usize]);
        let make = |entry: &Entry| match entry {
            Entry::Point(i) => {
                let at = *i as usize;
                let mut geometry = flat.geometry[at];
                if moves(i) {
                    geometry[..3].copy_from_slice(&centre(i).to_array());
                }
                let normal = flat.normals.as_ref().map_or(octahedral::NONE, |n| n[at]);
                let color = flat.colors.as_ref().map_or(0, |c| c[at]);
                Stored { geometry, normal, color }
            }
            &Entry::Average { first, count, depth } => {
                let places = &self.places[first as usize..][..count as usize];
                self.cell(places.iter().map(|place| Sample::of(flat, place.1)), places[0].0, depth)
            }
        };
        let (first, rest) = entries.split_at(above);
        let mut stored = par::map(first, make);
        stored.extend_from_slice(averages);
        stored.extend(par::map(rest, make));
        let away = |entry: &Entry| match entry {
            Entry::Point(i) if moves(i) => (centre(i) - flat.position(*i)).length(),
            _ => 0.0,
        };
        let moved = if grid { entries.iter().map(away).fold(0.0, f32::max) } else { 0.0 };
        let geometry: Vec<[f32; 4]> = stored.iter().map(|s| s.geometry).collect();
        let radius = |i: &Place| flat.geometry[i.1 as usize][3];
        let finest = self.places.iter().map(radius).fold(0.0, f32::max);
        let made = Flat {
            origin: flat.origin,
            blocks: crate::structure::flat::blocks(geometry.len(), |i| geometry[i]),
            geometry,
            normals: flat.normals.as_ref().map(|_| stored.iter().map(|s| s.normal).collect()),
            colors: flat.colors.as_ref().map(|_| stored.iter().map(|s| s.color).collect()),
            closed: flat.closed,
            groups: None,
            finest: Some(finest),
            packed: None,
        };
        (made, moved)
    }
}

/// Whether a point can lie in a cell: its square is a number, and it is a splat.
fn is_point(&[x, y, z, r]: &[f32; 4]) -> bool {
    [x, y, z].iter().all(|v| v.abs() < FARTHEST) && r > 0.0 && r.is_finite()
}

/// A run of entries sorted by level, which begins at `first`.
fn run<T>(entries: &[(u8, T)], first: u32, ends: &mut Vec<u32>) -> Run {
    let (Some((low, _)), Some((high, _))) = (entries.first(), entries.last()) else { return Run::default() };
    let table = ends.len() as u32;
    ends.extend((*low..=*high).map(|level| entries.partition_point(|(l, _)| *l <= level) as u32));
    Run { first, base: *low, table, levels: high - low + 1 }
}
