//! Structures for unprocessed scans: blocks of points in an octree, cut by whole cells and levels (sequential point trees in
//! a view-frustum-culled octree, 2006). One array of points, a small hierarchy on the processor, and no work a point there.
//!
//! A cell of side s may be one point where s ≤ τ · distance: projected spacing against the threshold. Cells that hold more
//! than a block's points are *inner*; the others are *blocks*, drawn at one level each, the coarsest that suffices for
//! their nearest point. What is drawn at a level gets at least its side as radius: a point a cell lies that far apart. An average is
//! also as large as the largest of its points: where cells are smaller than the spacing, two that lie near each other still reach to
//! the next.
//!
//! | preset | a block holds | drawn at level L |
//! |---|---|---|
//! | VBOsR (4.1) | the points | all |
//! | ESPTs (4.3) | averages by level, and the points by the level from which on their cell holds no other | the averages of L, the points up to L |
//! | MOSPTs (4.4) | the points alone: the one nearest a cell's centre stands for it | the points up to L |
//! | r-grid (3.2) | as ESPTs, with r³ children a cell and every point at its cell's centre | as ESPTs |
//! | Poisson (ours) | the points alone, by their distance from those before them in farthest-first order | the points up to L |
//!
//! *Half octaves* (ESPTs). Halving cells alone, those of the coarsest level that suffices are between τ d / 2 and τ d long, which is
//! 3 / ln 4 = 2.16 times the points on a surface that cells of τ d would take. So between two of the octree's levels, k and k + 1
//! below a block, lies a grid of round(2ᵏ √2) cells along the block's edge, 3, 6, 11, 23 …: 1 / ln 2 = 1.44 times. Such cells do not nest: a
//! point may be alone in one and not in a finer one. Its level is the first from which on it is alone for good, so that what is drawn
//! up to a level is a prefix; until then an average stands for it, if need be of it alone. At every level each point is thus
//! drawn or averaged once. Where few points share cells there is no such grid: it would save less than it takes.
//!
//! *Poisson-disk samples* (ours). Where one point stands for a cell, a surface meets 1.5 cells a square of the cell's side, and
//! their points lie as far apart as chance has it. In farthest-first order (Gonzalez 1985) those whose distance to all before them is at
//! least s are s apart, and every other point lies within s of one of them: some 0.6 points a square of s, at which s itself can be what the
//! threshold asks for, in levels of an eighth octave. That is about a third of the points that ESPTs take. Samples whose radii shrink are
//! McCool's and Fiume's (Hierarchical Poisson disk sampling distributions, 1992); here they are points of the scan. What is drawn gets
//! at least the radius √(2 s² + min(r, s)² / 2), r the median of its block: gaps are s wide and not s / √2 as in a grid, for which radii are
//! made, and what is left out reaches some way into a gap of the scan. A point with a radius of 2 s and more stays, however near others are: its
//! disc is far larger than those that could stand for it. Inner cells hold points, too: those of the first levels, drawn along with their children's
//! where those are needed, so that what is seen from afar is few runs.
//!
//! OneVBO is the flat array; OneSPT and SPTsR (3.3, 4.2) are tested point by point, see [`super::sequential`].

mod average;
mod build;
mod color;
mod farthest;
mod file;
mod levels;
mod samples;

use glam::Vec3;

use super::file::fingerprint;
use super::nodes::NONE;
use super::{Flat, Packing};
use crate::select::{DrawList, Sight, Span};
use crate::technique::names;

/// What a block holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Preset {
    /// The points as they are.
    VboR,
    /// Averages and points, each by level.
    Espt,
    /// The points by level: each stands for a cell until its neighbours are drawn.
    Mospt,
    /// Averages and points at the centres of cells, by level.
    RGrid,
    /// The points by level: at each a Poisson-disk sample of them all.
    Poisson,
}

names!(Preset { VboR = "vbo-r", Espt = "espt", Mospt = "mospt", RGrid = "r-grid", Poisson = "poisson" });

/// How an octree is built.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// What blocks hold.
    pub preset: Preset,
    /// Most points a block, at least 1.
    pub block: u32,
    /// For [`Preset::RGrid`]: children along an edge of a cell, 2, 4 or 8.
    pub r: u32,
}

impl Options {
    /// At most 10,000 points a block, as published, and 4³ children in an r-grid. 4000 for Poisson-disk samples, whose
    /// blocks are not what is drawn from afar.
    pub fn new(preset: Preset) -> Options {
        Options { preset, block: if preset == Preset::Poisson { 4000 } else { 10_000 }, r: 4 }
    }
}

/// A cloud in blocks.
#[derive(Debug, Clone, PartialEq)]
pub struct Octree {
    /// All points that may be drawn: first those that are in no block (averages of inner cells, and what no cell can hold),
    /// then the averages of blocks, then the points, block by block.
    pub flat: Flat,
    /// What blocks hold.
    pub preset: Preset,
    /// How it was made.
    pub options: Options,
    /// Fingerprint of the cloud that it was made of.
    pub cloud: u64,
    /// Every cell before its descendants.
    pub cells: Vec<Cell>,
    /// Points of the input.
    pub points: u32,
    /// How far a point was moved at most \[cloud units\]; 0 but for r-grids.
    pub moved: f32,
    /// Points at the start of `flat` that lie in no cell.
    loose: u32,
    blocks: Vec<Block>,
    /// Ends of levels in the runs of blocks, counted from the run's start.
    ends: Vec<u32>,
    /// Side of the cells of each depth.
    sides: Vec<f32>,
    /// Cells along the edge of a block, by levels below its own.
    grids: Vec<f64>,
}

/// A cell with points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Corner of the box of all that may be drawn for it.
    pub min: Vec3,
    /// Opposite corner.
    pub max: Vec3,
    /// Largest radius.
    pub reach: f32,
    /// Depth, 0 for the root.
    pub level: u8,
    /// Of Poisson-disk samples, the last level of what is within.
    finest: u8,
    /// Index of the next cell that is no descendant.
    pub skip: u32,
    /// The point that may stand for all.
    pub represented_by: u32,
    /// Index of the block; [`NONE`]: an inner cell, or of Poisson-disk samples one that holds none of its own.
    block: u32,
}

/// Where the points of a cell without children lie.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Block {
    points: Run,
    averages: Run,
    /// Of Poisson-disk samples, the median radius of the points \[cloud units\].
    own: f32,
}

/// Levels from a cell to its children. The grid of a level in between is none of the octree's, and of a Poisson octree none at all.
fn levels_a_depth(preset: Preset) -> u8 {
    match preset {
        Preset::Espt => 2,
        Preset::Poisson => 8,
        Preset::VboR | Preset::Mospt | Preset::RGrid => 1,
    }
}

/// Whether what stands for a cell is one of its own points, drawn along with those of finer levels.
fn picks(preset: Preset) -> bool {
    matches!(preset, Preset::Mospt | Preset::Poisson)
}

/// Cells along the edge of a block, so many levels below its own.
fn along(options: &Options, levels: u8) -> f64 {
    match options.preset {
        Preset::Espt => (0.5 * levels as f64).exp2().round(),
        Preset::RGrid => ((options.r.clamp(2, 8).ilog2() * levels as u32) as f64).exp2(),
        Preset::Poisson => (levels as f64 / levels_a_depth(Preset::Poisson) as f64).exp2(),
        Preset::VboR | Preset::Mospt => (levels as f64).exp2(),
    }
}

/// For all levels that there may be.
fn grids(options: &Options, deepest: u8) -> Vec<f64> {
    (0..=levels_a_depth(options.preset) * deepest).map(|levels| along(options, levels)).collect()
}

/// Consecutive points sorted by level.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Run {
    /// First point.
    first: u32,
    /// Lowest level, and where in `ends` it ends.
    base: u8,
    table: u32,
    /// Number of levels.
    levels: u8,
}

impl Octree {
    /// Whether it is what [`build`](Self::build) makes of this cloud with these options: for what was
    /// [loaded](Self::load).
    pub fn is_of(&self, flat: &Flat, options: &Options) -> bool {
        self.options == *options && self.points as usize == flat.len() && self.cloud == fingerprint(flat)
    }

    /// Adds the spans that a view needs of one instance, by their least radii, in stored order where those are the same.
    pub fn select(&self, sight: &Sight, instance: u32, list: &mut DrawList) {
        let before = list.spans.len();
        let mut push = |first, count, least| list.push(Span { instance, first, count, least });
        push(0, self.loose, 0.0);
        if self.preset == Preset::Poisson {
            self.select_samples(sight, &mut push);
        } else {
            self.select_cells(sight, &mut push);
        }
        // Averages lie apart from points. What has a least radius and a buffer in common is drawn by one command.
        list.spans[before..].sort_unstable_by_key(|span| (span.least.to_bits(), span.first));
    }

    fn select_cells(&self, sight: &Sight, push: &mut impl FnMut(u32, u32, f32)) {
        let mut at = 0;
        while let Some(cell) = self.cells.get(at) {
            let distance = sight.distance(cell.min, cell.max);
            // What stands for others is as large as their spacing, which the farthest point may be given.
            let least = sight.tau * (distance + (cell.max - cell.min).length() as f64);
            let next = cell.skip as usize;
            if sight.misses(cell.min, cell.max, cell.reach.max(least as f32)) {
                at = next;
                continue;
            }
            let spacing = sight.tau * distance;
            let side = self.sides[cell.level as usize];
            if side as f64 <= spacing {
                push(cell.represented_by, 1, side);
            } else if cell.block == NONE {
                at += 1;
                continue;
            } else {
                self.block(&self.blocks[cell.block as usize], cell.level, spacing, push);
            }
            at = next;
        }
    }

    /// Adds a block at a depth, at the coarsest level with that spacing.
    fn block(&self, block: &Block, depth: u8, spacing: f64, push: &mut impl FnMut(u32, u32, f32)) {
        let Run { first, base, levels, .. } = block.points;
        let (averages, deepest) = (&block.averages, base + levels - 1);
        let (side, own) = (self.sides[depth as usize] as f64, self.octave() * depth);
        let coarsest = self.grids.partition_point(|along| side > spacing * along);
        for (level, along) in (own + coarsest as u8..deepest).zip(&self.grids[coarsest..]) {
            let least = (side / along) as f32;
            if averages.levels > 0 {
                let before = level.checked_sub(1).map_or(0, |above| self.up_to(averages, above));
                let count = self.up_to(averages, level) - before;
                if count == 0 {
                    // No such grid: above the deepest level one has points that share cells.
                    continue;
                }
                push(averages.first + before, count, least);
            }
            push(first, self.up_to(&block.points, level), least);
            return;
        }
        push(first, self.up_to(&block.points, deepest), 0.0);
    }

    /// Levels from a cell to its children: 2 for ESPTs, whose levels are half octaves, 8 for Poisson-disk samples, else 1.
    pub fn octave(&self) -> u8 {
        levels_a_depth(self.preset)
    }

    /// Number of points of a run up to a level.
    fn up_to(&self, run: &Run, level: u8) -> u32 {
        match level.checked_sub(run.base) {
            Some(above) if run.levels > 0 => self.ends[run.table as usize + above.min(run.levels - 1) as usize],
            _ => 0,
        }
    }

    /// Level of each point; 0 where there is none. Cells of depth d are level [`octave`](Self::octave) · d.
    pub fn levels(&self) -> Vec<u8> {
        let mut levels = vec![0; self.flat.len()];
        if !picks(self.preset) {
            // Averages of whole cells. Else one of the block's own points stands for them.
            self.cells.iter().for_each(|cell| levels[cell.represented_by as usize] = self.octave() * cell.level);
        }
        for run in self.blocks.iter().flat_map(|block| [block.averages, block.points]) {
            for level in run.base..run.base + run.levels {
                let before = if level == run.base { 0 } else { self.up_to(&run, level - 1) };
                levels[(run.first + before) as usize..(run.first + self.up_to(&run, level)) as usize].fill(level);
            }
        }
        levels
    }

    /// The same cells over [packed](Flat::packed) points, in boxes that hold those.
    pub fn packed(mut self, packing: Packing) -> Octree {
        if packing != self.flat.packing() {
            self.flat = self.flat.packed(packing);
            self.enclose();
        }
        self
    }

    /// Grows the boxes of cells: of blocks round all that may be drawn of them, of inner cells round their children.
    fn enclose(&mut self) {
        for at in (0..self.cells.len()).rev() {
            let mut cell = self.cells[at];
            let mut hold = |[x, y, z, r]: [f32; 4], own: f32| {
                let p = Vec3::new(x, y, z);
                (cell.min, cell.max) = (cell.min.min(p), cell.max.max(p));
                cell.reach = cell.reach.max(r * own);
            };
            if let Some(block) = self.blocks.get(cell.block as usize) {
                // Averages are as large as their spacing, which selection allows for anyway, or as one of their points.
                for (run, own) in
                    [(&block.points, 1.0), (&block.averages, 0.0)].into_iter().filter(|(r, _)| r.levels > 0)
                {
                    let count = self.up_to(run, run.base + run.levels - 1);
                    (run.first..run.first + count).for_each(|i| hold(self.flat.point(i), own));
                }
            }
            if !picks(self.preset) {
                hold(self.flat.point(cell.represented_by), 0.0);
            }
            let mut child = at + 1;
            while child < cell.skip as usize {
                let below = &self.cells[child];
                (cell.min, cell.max) = (cell.min.min(below.min), cell.max.max(below.max));
                cell.reach = cell.reach.max(below.reach);
                child = below.skip as usize;
            }
            self.cells[at] = cell;
        }
    }

    /// Bytes that the arrays take; those of the points are on the device as well.
    pub fn bytes(&self) -> u64 {
        let cells = size_of_val(&self.cells[..]) + size_of_val(&self.blocks[..]) + size_of_val(&self.ends[..]);
        self.flat.bytes() + cells as u64
    }
}
