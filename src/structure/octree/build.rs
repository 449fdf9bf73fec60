//! From a flat array to blocks.

use std::ops::Range;

use glam::{DVec3, Vec3};

use super::{Block, Cell, Octree, Options, Preset, Run};
use crate::color::{decode_table, linear_to_srgb};
use crate::par;
use crate::structure::file::fingerprint;
use crate::structure::morton::{Cube, LEVELS};
use crate::structure::nodes::NONE;
use crate::structure::{Flat, octahedral};

/// Squares of larger coordinates are not safe in single floats: what lies there is in no cell.
const FARTHEST: f32 = 1e15;
/// Points a task.
const GRAIN: usize = 1 << 14;

/// A place on the Morton curve, and the point there.
type Place = (u64, u32);

/// A point that is to be stored.
#[derive(Clone, Copy)]
enum Entry {
    /// One of the input's; in an r-grid at the centre of its cell of the deepest level.
    Point(u32),
    /// The average of those at these places.
    Average { first: u32, count: u32, level: u8 },
}

struct Builder<'a> {
    flat: &'a Flat,
    options: &'a Options,
    cube: Cube,
    /// Morton levels a level.
    step: u32,
    /// The deepest level.
    deepest: u8,
    places: Vec<Place>,
    /// For MOSPTs: by place, the level of the inner cell that a point stands for.
    above: Vec<u8>,
    cells: Vec<Cell>,
    /// Of each cell, its places.
    ranges: Vec<Range<usize>>,
    /// For MOSPTs: of each inner cell, the point that stands for it.
    picked: Vec<u32>,
}

/// In `above`: it stands for none.
const BELOW: u8 = u8::MAX;

/// A block's points and averages with their levels, sorted by level.
struct Filled {
    points: Vec<(u8, Entry)>,
    averages: Vec<(u8, Entry)>,
}

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
        let (cells, ranges, picked) = (Vec::new(), Vec::new(), Vec::new());
        let mut builder = Builder { flat, options, cube, step, deepest, places, above, cells, ranges, picked };
        if options.preset == Preset::RGrid {
            builder.deepest = builder.grid_depth();
        }
        builder.build(&loose)
    }
}

impl Builder<'_> {
    /// The level at which 95 of a hundred points are alone in their cells: there a grid ends, and the others are merged.
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

    /// The least level at which each of a range of places is alone in its cell among them.
    fn alone<'a>(&'a self, range: &Range<usize>) -> impl Iterator<Item = u8> + 'a {
        let places = &self.places[range.clone()];
        // Codes have 63 bits, three a Morton level.
        let shared = |a: u64, b: u64| ((a ^ b).leading_zeros().saturating_sub(1) / 3 / self.step) as u8;
        let level = move |a: Option<&Place>, b: &Place| a.map_or(0, |a| shared(a.0, b.0) + 1);
        (0..places.len()).map(move |i| {
            let before = i.checked_sub(1).map(|i| &places[i]);
            level(before, &places[i]).max(level(places.get(i + 1), &places[i]))
        })
    }

    fn build(mut self, loose: &[u32]) -> Octree {
        let mut blocks = Vec::new();
        if !self.places.is_empty() {
            self.split(0..self.places.len(), 0, &mut blocks);
        }
        let mut filled = par::map(&blocks, |&cell| self.fill(self.ranges[cell].clone(), self.cells[cell].level));

        let mut entries: Vec<(u8, Entry)> = loose.iter().map(|&i| (0, Entry::Point(i))).collect();
        let mut represented = vec![NONE; self.cells.len()];
        if self.options.preset != Preset::Mospt {
            // Level by level: those of siblings are neighbours.
            let mut by_level: Vec<usize> = (0..self.cells.len()).collect();
            by_level.sort_by_key(|&cell| self.cells[cell].level);
            for cell in by_level {
                let (range, level) = (&self.ranges[cell], self.cells[cell].level);
                represented[cell] = entries.len() as u32;
                entries.push((level, Entry::Average { first: range.start as u32, count: range.len() as u32, level }));
            }
        }
        let mut ends = Vec::new();
        let mut runs = vec![Block::default(); blocks.len()];
        for (block, filled) in runs.iter_mut().zip(&mut filled) {
            block.averages = run(&filled.averages, entries.len() as u32, &mut ends);
            entries.append(&mut filled.averages);
        }
        for (block, filled) in runs.iter_mut().zip(&mut filled) {
            block.points = run(&filled.points, entries.len() as u32, &mut ends);
            entries.append(&mut filled.points);
        }
        drop(filled);
        if self.options.preset == Preset::Mospt {
            let mut at = vec![NONE; self.flat.len()];
            for (i, (_, entry)) in (0..).zip(&entries) {
                if let Entry::Point(point) = entry {
                    at[*point as usize] = i;
                }
            }
            for (by, &point) in represented.iter_mut().zip(&self.picked) {
                *by = at.get(point as usize).copied().unwrap_or(NONE);
            }
        }

        let (flat, moved) = self.store(&entries);
        for (number, &cell) in blocks.iter().enumerate() {
            self.cells[cell].block = number as u32;
            if represented[cell] == NONE {
                represented[cell] = runs[number].points.first;
            }
        }
        let sides = (0..=self.deepest).map(|level| self.side(level)).collect();
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
        };
        octree.enclose();
        octree
    }

    /// Edge of the cells of a level.
    fn side(&self, level: u8) -> f32 {
        (self.cube.side / (1u64 << (self.step * level as u32)) as f32).max(f32::MIN_POSITIVE)
    }

    /// Digits of a place down to a level.
    fn prefix(&self, code: u64, level: u8) -> u64 {
        code.checked_shr(3 * (LEVELS - self.step * level as u32)).unwrap_or(0)
    }

    /// Cells of a range of places, depth first.
    fn split(&mut self, range: Range<usize>, level: u8, blocks: &mut Vec<usize>) {
        let own = self.cells.len();
        let (min, max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        self.cells.push(Cell { min, max, reach: 0.0, level, skip: 0, represented_by: NONE, block: NONE });
        self.ranges.push(range.clone());
        self.picked.push(NONE);
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
            let mut start = range.start;
            while start < range.end {
                let digits = self.prefix(self.places[start].0, level + 1);
                let rest = &self.places[start..range.end];
                let end = start + rest.partition_point(|place| self.prefix(place.0, level + 1) <= digits);
                self.split(start..end, level + 1, blocks);
                start = end;
            }
        }
        self.cells[own].skip = self.cells.len() as u32;
    }

    /// Of places, the point nearest to somewhere; of equals the first.
    fn nearest(&self, places: impl Iterator<Item = usize>, to: Vec3) -> Option<usize> {
        let far = |i: usize| (self.flat.position(self.places[i].1) - to).length_squared();
        places
            .fold(None, |best: Option<(usize, f32)>, i| match best {
                Some((_, d)) if d <= far(i) => best,
                _ => Some((i, far(i))),
            })
            .map(|(i, _)| i)
    }

    /// Middle of the cell of a level at a place.
    fn centre(&self, code: u64, level: u8) -> Vec3 {
        let side = self.cube.side as f64 / (1u64 << (self.step * level as u32)) as f64;
        let digits = self.prefix(code, level);
        let axis = |axis: u32| {
            (0..self.step * level as u32).fold(0u64, |sum, bit| sum | (digits >> (3 * bit + axis) & 1) << bit)
        };
        let at = DVec3::new(axis(0) as f64, axis(1) as f64, axis(2) as f64) + 0.5;
        (self.cube.low.as_dvec3() + side * at).as_vec3()
    }

    /// Levels of a block's points, and its averages.
    fn fill(&self, range: Range<usize>, level: u8) -> Filled {
        let mut points: Vec<(u8, Entry)> = Vec::with_capacity(range.len());
        let mut averages = Vec::new();
        let point = |i: usize, level: u8| (level, Entry::Point(self.places[i].1));
        match self.options.preset {
            Preset::VboR => points.extend(range.map(|i| point(i, level))),
            Preset::Mospt => {
                let (mut left, above): (Vec<usize>, Vec<usize>) = range.partition(|&i| self.above[i] == BELOW);
                points.extend(above.into_iter().map(|i| point(i, self.above[i])));
                for level in level..self.deepest {
                    if left.is_empty() {
                        break;
                    }
                    let mut deeper = Vec::with_capacity(left.len());
                    for cell in left
                        .chunk_by(|&a, &b| self.prefix(self.places[a].0, level) == self.prefix(self.places[b].0, level))
                    {
                        let centre = self.centre(self.places[cell[0]].0, level);
                        let nearest = self.nearest(cell.iter().copied(), centre);
                        points.extend(nearest.map(|i| point(i, level)));
                        deeper.extend(cell.iter().copied().filter(|i| Some(*i) != nearest));
                    }
                    left = deeper;
                }
                points.extend(left.into_iter().map(|i| point(i, self.deepest)));
            }
            Preset::Espt | Preset::RGrid => {
                let places = &self.places[range.clone()];
                let levels: Vec<u8> =
                    self.alone(&range).map(|alone| alone.clamp(level, self.deepest.max(level))).collect();
                let deepest = levels.iter().copied().max().unwrap_or(level);
                let cells_of = |level: u8, into: &mut Vec<(u8, Entry)>| {
                    let mut first = range.start as u32;
                    for cell in places.chunk_by(|a, b| self.prefix(a.0, level) == self.prefix(b.0, level)) {
                        let count = cell.len() as u32;
                        if count > 1 {
                            into.push((level, Entry::Average { first, count, level }));
                        }
                        first += count;
                    }
                };
                (level..deepest).for_each(|level| cells_of(level, &mut averages));
                // Where a grid ends, points of one cell are one.
                let merged = self.options.preset == Preset::RGrid && deepest == self.deepest;
                if merged {
                    cells_of(deepest, &mut points);
                }
                let code = |i: usize| self.prefix(places[i].0, deepest);
                for (i, level) in levels.into_iter().enumerate() {
                    let twin = |other: Option<usize>| other.is_some_and(|j| j < places.len() && code(j) == code(i));
                    if !(merged && (twin(i.checked_sub(1)) || twin(Some(i + 1)))) {
                        points.push(point(range.start + i, level));
                    }
                }
            }
        }
        points.sort_by_key(|(level, _)| *level);
        Filled { points, averages }
    }

    /// The points to be drawn, and how far one was moved.
    fn store(&self, entries: &[(u8, Entry)]) -> (Flat, f32) {
        let flat = self.flat;
        struct Stored {
            geometry: [f32; 4],
            normal: u32,
            color: u32,
            moved: f32,
        }
        let grid = self.options.preset == Preset::RGrid;
        let stored = par::map(entries, |(_, entry)| match *entry {
            Entry::Point(i) => {
                let i = i as usize;
                let mut geometry = flat.geometry[i];
                let mut moved = 0.0;
                let p = flat.position(i as u32);
                if grid && is_point(&flat.geometry[i]) {
                    let centre = self.centre(self.cube.code(p), self.deepest);
                    moved = (centre - p).length();
                    geometry[..3].copy_from_slice(&centre.to_array());
                }
                let normal = flat.normals.as_ref().map_or(octahedral::NONE, |n| n[i]);
                let color = flat.colors.as_ref().map_or(0, |c| c[i]);
                Stored { geometry, normal, color, moved }
            }
            Entry::Average { first, count, level } => {
                let places = &self.places[first as usize..][..count as usize];
                let (position, normal, color) = average(flat, places);
                let at = if grid { self.centre(places[0].0, level) } else { position };
                Stored { geometry: [at.x, at.y, at.z, self.side(level)], normal, color, moved: 0.0 }
            }
        });
        let geometry: Vec<[f32; 4]> = stored.iter().map(|s| s.geometry).collect();
        let moved = stored.iter().map(|s| s.moved).fold(0.0, f32::max);
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
fn run(entries: &[(u8, Entry)], first: u32, ends: &mut Vec<u32>) -> Run {
    let (Some((low, _)), Some((high, _))) = (entries.first(), entries.last()) else { return Run::default() };
    let table = ends.len() as u32;
    ends.extend((*low..=*high).map(|level| entries.partition_point(|(l, _)| *l <= level) as u32));
    Run { first, base: *low, table, levels: high - low + 1 }
}

/// Mean position, normal and colour, colours in linear light.
fn average(flat: &Flat, places: &[Place]) -> (Vec3, u32, u32) {
    let table = decode_table();
    let (mut position, mut normal, mut color) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for &(_, i) in places {
        position += flat.position(i).as_dvec3();
        if let Some(n) = flat.normals.as_ref().and_then(|n| octahedral::decode(n[i as usize])) {
            // A normal that was only estimated may point either way.
            normal += if normal.dot(n) < 0.0 && !flat.closed { -n } else { n };
        }
        if let Some(colors) = &flat.colors {
            let [r, g, b, _] = colors[i as usize].to_le_bytes();
            color += DVec3::new(table[r as usize], table[g as usize], table[b as usize]);
        }
    }
    let n = places.len() as f64;
    let code =
        if normal.length() > 1e-3 * n { octahedral::encode(normal.normalize().as_vec3()) } else { octahedral::NONE };
    let [r, g, b] = (color / n).to_array().map(|v| (linear_to_srgb(v) * 255.0).round() as u8);
    ((position / n).as_vec3(), code, u32::from_le_bytes([r, g, b, 255]))
}
