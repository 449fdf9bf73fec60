//! Which splats overlap which: a sorted grid for each class of radii, and the graph of the pairs that count.
//!
//! # The search, in pseudo-code
//! ```text
//! class of a splat: radii within a factor of 2 share one; cells of a class are 2 c r wide, r its largest radius
//! sort the splats by class, then by cell (z, y, x)          → ranks
//! for every splat, in parallel, for its class and each above:
//!     for the 3 × 3 rows of cells about it: the run of ranks with x − 1 … x + 1
//!         for each splat of the run that is not before it in its own class: the pair is looked at, once
//! ```
//! A run's start is sought from where the last one was: neighbours in rank are neighbours in space, so that is a step or two.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::DVec3;

use super::Relax;
use crate::par;
use crate::structure::{Flat, octahedral};

/// Splats beside a splat that are looked at; an even sampling has some fifty in its cells. More are heaps, or a splat as
/// wide as the cloud.
pub const MOST_CANDIDATES: usize = 4096;

/// Cells along an axis: 21 bits of a 64-bit key each.
const CELLS: f64 = (1u64 << 21) as f64 - 4.0;

/// Splats a task.
const BLOCK: usize = 4096;

/// The splats that take part, by rank.
pub struct Splats {
    /// Centre and radius.
    geometry: Vec<[f32; 4]>,
    /// Only where a relaxation asks: the normal, 0 for none, and the colour.
    looks: Vec<(DVec3, Option<[u8; 3]>)>,
    index: Vec<u32>,
    keys: Vec<u64>,
    classes: Vec<Class>,
    /// c, which cells are as wide as.
    factor: f64,
}

/// Splats of similar radii: a run of ranks.
struct Class {
    first: usize,
    end: usize,
    /// Corner of the grid and width of a cell, for c = 1.
    low: [f64; 3],
    radius: f64,
    extent: f64,
}

impl Class {
    /// The cell of a place in each axis, from 1 on so that neighbours never wrap.
    fn cell(&self, p: &[f32; 4], width: f64) -> [u64; 3] {
        [0, 1, 2].map(|a| 1 + (((p[a] as f64 - self.low[a]) / width).floor().clamp(-1.0, CELLS) + 1.0) as u64)
    }

    /// Of a cell's width for a factor: as wide as two splats of the class may be apart, but no more cells than the key holds.
    fn width(&self, factor: f64) -> f64 {
        (2.0 * factor * self.radius).max(self.extent / (CELLS - 2.0)).max(f64::MIN_POSITIVE)
    }
}

fn key([x, y, z]: [u64; 3]) -> u64 {
    z << 42 | y << 21 | x
}

impl Splats {
    /// Those of a cloud that `takes_part` and can be drawn, with radii that need not be the cloud's.
    pub fn new(
        flat: &Flat,
        relax: &Relax,
        radius: impl Fn(usize) -> f32,
        takes_part: impl Fn(usize) -> bool,
    ) -> Splats {
        let drawn = |p: &[f32; 4]| p.iter().all(|v| v.abs() < 1e30) && p[3] > 0.0;
        let mut all: Vec<([f32; 4], u32)> = Vec::with_capacity(flat.len());
        for i in (0..flat.len()).filter(|i| takes_part(*i)) {
            let [x, y, z, _] = flat.point(i as u32);
            let p = [x, y, z, radius(i)];
            all.extend(drawn(&p).then_some((p, i as u32)));
        }
        // The exponent of the radius; stable, so points of a class stay in order.
        let class_of = |p: &[f32; 4]| p[3].to_bits() >> 23;
        all.sort_by_key(|(p, _)| class_of(p));
        let factor = relax.factor as f64;
        let mut classes = Vec::new();
        let mut keyed: Vec<(u64, [f32; 4], u32)> = Vec::with_capacity(all.len());
        for run in all.chunk_by(|(a, _), (b, _)| class_of(a) == class_of(b)) {
            let fold =
                |f: fn(f64, f64) -> f64, start: f64, a: usize| run.iter().map(|(p, _)| p[a] as f64).fold(start, f);
            let low = [0, 1, 2].map(|a| fold(f64::min, f64::INFINITY, a));
            let high = [0, 1, 2].map(|a| fold(f64::max, f64::NEG_INFINITY, a));
            let extent = (0..3).map(|a| high[a] - low[a]).fold(0.0, f64::max);
            let class =
                Class { first: keyed.len(), end: keyed.len() + run.len(), low, radius: fold(f64::max, 0.0, 3), extent };
            let width = class.width(factor);
            keyed.extend(run.iter().map(|&(p, i)| (key(class.cell(&p, width)), p, i)));
            keyed[class.first..].sort_unstable_by_key(|&(key, _, i)| (key, i));
            classes.push(class);
        }
        let looks = |i: u32| {
            let normal = octahedral::decode(flat.normal(i)).unwrap_or(DVec3::ZERO);
            (normal, flat.color(i))
        };
        let asked = relax.coplanar || relax.opposing;
        Splats {
            looks: if asked { keyed.iter().map(|&(_, _, i)| looks(i)).collect() } else { Vec::new() },
            geometry: keyed.iter().map(|&(_, p, _)| p).collect(),
            index: keyed.iter().map(|&(_, _, i)| i).collect(),
            keys: keyed.iter().map(|&(key, _, _)| key).collect(),
            classes,
            factor,
        }
    }

    pub fn len(&self) -> usize {
        self.index.len()
    }

    /// The point of a rank.
    pub fn index(&self, rank: u32) -> u32 {
        self.index[rank as usize]
    }

    /// Whether two splats nearer than c (r_i + r_j) may not share a group.
    pub fn conflict(&self, a: u32, b: u32, relax: &Relax) -> bool {
        if !(relax.coplanar || relax.opposing) {
            return true;
        }
        let ((n, color), (m, other)) = (self.looks[a as usize], self.looks[b as usize]);
        let cosine = n.dot(m);
        if relax.opposing && cosine < 0.0 {
            return false;
        }
        // cos 4°
        if !(relax.coplanar && color == other && cosine > 0.997_564) {
            return true;
        }
        let (p, q) = (self.geometry[a as usize], self.geometry[b as usize]);
        let between = DVec3::from([0, 1, 2].map(|k| q[k] as f64 - p[k] as f64));
        let apart = between.dot(n).abs().max(between.dot(m).abs());
        apart > p[3].min(q[3]) as f64 / 16.0
    }

    /// Calls `pair` for every two splats of ranks in `block` and elsewhere that are nearer than c times the sum of
    /// their radii: once in all blocks together, until it returns false. Returns for how many of the block there were too
    /// many to look at.
    fn pairs(&self, block: std::ops::Range<usize>, mut pair: impl FnMut(u32, u32) -> bool) -> u64 {
        let factor = self.factor;
        let mut truncated = 0;
        // Where the runs began for the splat before, by class and row.
        let mut hints: Vec<[usize; 9]> = self.classes.iter().map(|class| [class.first; 9]).collect();
        for a in block {
            let p = &self.geometry[a];
            let own = self.classes.partition_point(|class| class.end <= a);
            let mut looked = 0;
            'beside: for (class, hints) in self.classes.iter().zip(&mut hints).skip(own) {
                let [x, y, z] = class.cell(p, class.width(factor));
                for (row, hint) in (0..9u64).zip(hints) {
                    let (y, z) = (y + row % 3 - 1, z + row / 3 - 1);
                    let keys = &self.keys[..class.end];
                    *hint = seek(keys, *hint, class.first, key([x - 1, y, z]));
                    let last = key([x + 1, y, z]);
                    // Pairs of one class are looked at from the first of the two.
                    let from = (*hint).max(a + 1).min(class.end);
                    for (b, _) in (from..).zip(&keys[from..]).take_while(|(_, key)| **key <= last) {
                        looked += 1;
                        if looked > MOST_CANDIDATES {
                            truncated += 1;
                            break 'beside;
                        }
                        let q = &self.geometry[b];
                        let reach = factor * (p[3] as f64 + q[3] as f64);
                        let d = |k: usize| p[k] as f64 - q[k] as f64;
                        if d(0) * d(0) + d(1) * d(1) + d(2) * d(2) < reach * reach && !pair(a as u32, b as u32) {
                            return truncated;
                        }
                    }
                }
            }
        }
        truncated
    }

    fn blocks(&self) -> Vec<std::ops::Range<usize>> {
        (0..self.len()).step_by(BLOCK).map(|at| at..(at + BLOCK).min(self.len())).collect()
    }
}

/// The first rank from `first` on whose key is at least `wanted`, sought from `hint` outward.
fn seek(keys: &[u64], hint: usize, first: usize, wanted: u64) -> usize {
    let (mut low, mut high) = (first, keys.len());
    let mut step = 1;
    if hint < high && keys[hint] < wanted {
        low = hint + 1;
        while low + step < high && keys[low + step] < wanted {
            low += step;
            step *= 2;
        }
        high = high.min(low + step + 1);
    } else {
        high = hint;
        while high - first > step && keys[high - step] >= wanted {
            high -= step;
            step *= 2;
        }
        low = low.max(high.saturating_sub(step));
    }
    low + keys[low..high].partition_point(|k| *k < wanted)
}

/// Whether there is a pair nearer than c times the sum of radii that `is`.
pub fn any_pair(splats: &Splats, is: impl Fn(u32, u32) -> bool + Sync + Send) -> bool {
    let found = AtomicBool::new(false);
    par::map(&splats.blocks(), |block| {
        if !found.load(Ordering::Relaxed) {
            splats.pairs(block.clone(), |a, b| {
                if is(a, b) {
                    found.store(true, Ordering::Relaxed);
                }
                !found.load(Ordering::Relaxed)
            });
        }
    });
    found.into_inner()
}

/// Neighbours of every rank.
pub struct Graph {
    starts: Vec<usize>,
    neighbours: Vec<u32>,
    /// Splats with more beside them than were looked at.
    pub truncated: u64,
}

impl Graph {
    /// With an edge for every pair nearer than c times the sum of radii that `counts`.
    pub fn new(splats: &Splats, counts: impl Fn(u32, u32) -> bool + Sync + Send) -> Graph {
        let found = par::map(&splats.blocks(), |block| {
            let mut edges = Vec::new();
            let truncated = splats.pairs(block.clone(), |a, b| {
                edges.extend(counts(a, b).then_some((a, b)));
                true
            });
            (edges, truncated)
        });
        let mut starts = vec![0usize; splats.len() + 1];
        for &(a, b) in found.iter().flat_map(|(edges, _)| edges) {
            starts[a as usize + 1] += 1;
            starts[b as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        let mut neighbours = vec![0u32; starts[splats.len()]];
        for &(a, b) in found.iter().flat_map(|(edges, _)| edges) {
            for (from, to) in [(a, b), (b, a)] {
                neighbours[next[from as usize]] = to;
                next[from as usize] += 1;
            }
        }
        Graph { starts, neighbours, truncated: found.iter().map(|(_, truncated)| truncated).sum() }
    }

    pub fn neighbours(&self, rank: u32) -> &[u32] {
        &self.neighbours[self.starts[rank as usize]..self.starts[rank as usize + 1]]
    }

    pub fn degree(&self, rank: u32) -> u32 {
        self.neighbours(rank).len() as u32
    }

    pub fn max_degree(&self) -> u32 {
        (0..self.starts.len() as u32 - 1).map(|rank| self.degree(rank)).max().unwrap_or(0)
    }

    pub fn edges(&self) -> u64 {
        self.neighbours.len() as u64 / 2
    }
}
