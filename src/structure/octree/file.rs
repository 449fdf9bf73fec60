//! Octrees in a file, so that they are made once. The layout is in docs/FORMAT.md.

use std::io::{Read, Write};
use std::path::Path;

use glam::Vec3;

use super::{Block, Cell, Octree, Options, Preset, Run, grids, levels_a_depth};
use crate::error::{Error, Place, Result};
use crate::structure::Flat;
use crate::structure::file::{Header, Input, Output, flags, load, save};
use crate::structure::morton::LEVELS;
use crate::structure::nodes::NONE;

const MAGIC: &[u8; 8] = b"surfelOC";
const VERSION: u32 = 2;
/// Words of the header.
const HEADER: usize = 14;
/// Words of a cell.
const CELL: usize = 11;
/// Words of a block.
const BLOCK: usize = 8;

impl Cell {
    fn words(&self) -> [u32; CELL] {
        let ([a, b, c], [d, e, f]) = (self.min.to_array(), self.max.to_array());
        let [a, b, c, d, e, f, reach] = [a, b, c, d, e, f, self.reach].map(f32::to_bits);
        [a, b, c, d, e, f, reach, self.level as u32, self.skip, self.represented_by, self.block]
    }

    fn from_words(words: &[u32; CELL]) -> Cell {
        let v = |i: usize| Vec3::from_array([0, 1, 2].map(|k| f32::from_bits(words[i + k])));
        let [.., reach, level, skip, represented_by, block] = *words;
        Cell {
            min: v(0),
            max: v(3),
            reach: f32::from_bits(reach),
            level: level as u8,
            finest: 0,
            skip,
            represented_by,
            block,
        }
    }
}

impl Run {
    fn words(&self) -> [u32; BLOCK / 2] {
        [self.first, self.base as u32, self.table, self.levels as u32]
    }

    fn from_words(words: [u32; BLOCK / 2]) -> Run {
        let [first, base, table, levels] = words;
        Run { first, base: base as u8, table, levels: levels as u8 }
    }
}

impl Octree {
    fn header(&self) -> Header<HEADER> {
        let (flat, Options { preset, block, r }) = (&self.flat, self.options);
        let finest = flat.finest.unwrap_or(f32::INFINITY);
        let lengths = [self.cells.len(), self.blocks.len(), self.ends.len(), self.sides.len(), flat.len()];
        let [cells, blocks, ends, sides, all] = lengths.map(|n| n as u32);
        let (preset, points, loose, moved) = (preset as u32, self.points, self.loose, self.moved.to_bits());
        let flags = flags(flat);
        let words =
            [VERSION, flags, preset, block, r, points, loose, moved, finest.to_bits(), cells, blocks, ends, sides, all];
        Header { words, origin: flat.origin, cloud: self.cloud }
    }

    /// Writes it, as built: what is packed is refused, since it is not what [`is_of`](Self::is_of) would compare.
    pub fn write(&self, to: &mut impl Write) -> std::io::Result<()> {
        let mut out = Output::new(to, &self.flat)?;
        out.header(MAGIC, &self.header())?;
        for cell in &self.cells {
            out.add(&cell.words())?;
        }
        for block in &self.blocks {
            out.add(&[block.points.words(), block.averages.words()])?;
        }
        out.add(&self.ends)?;
        out.add(&self.sides)?;
        out.points(&self.flat)?;
        out.finish()
    }

    /// Reads what [`write`](Self::write) wrote. `name` is for errors. See [`is_of`](Self::is_of) for whose it is.
    ///
    /// # Errors
    /// [`Error::Data`] with the byte for anything that was not written so, [`Error::Io`] where it cannot be read. Never more
    /// memory than a few times what the file has.
    pub fn read(from: &mut impl Read, name: &Path) -> Result<Octree> {
        let mut input = Input::new(from, name);
        let bad = |at: u64, why: &str| Error::data(name, Place::Byte(at), why);
        let Header { words, origin, cloud } = input.header::<HEADER>(MAGIC, VERSION, "an octree")?;
        let [_, flags, preset, block, r, points, loose, moved, finest, cells, blocks, ends, sides, n] = words;
        let cells_at = input.at();
        let cells: Vec<[u32; CELL]> = input.items(cells as u64)?;
        let runs_at = input.at();
        let runs: Vec<[u32; BLOCK]> = input.items(blocks as u64)?;
        let ends: Vec<u32> = input.items(ends as u64)?;
        let sides: Vec<f32> = input.items(sides as u64)?;
        let n = n as u64;
        let flat = input.points(flags, origin, n)?;
        input.finish()?;

        // What carries its checksum may still be someone else's.
        let known = Preset::ALL.iter().map(|(_, known)| *known).find(|known| *known as u32 == preset);
        let preset = known.ok_or_else(|| bad(16, "no such preset"))?;
        if sides.len() > LEVELS as usize + 1 {
            return Err(bad(56, "more levels than a cell can be halved"));
        }
        let levels = levels_a_depth(preset) as u32 * sides.len() as u32;
        let halves = runs.iter().map(|&[a, b, c, d, e, f, g, h]| [[a, b, c, d], [e, f, g, h]]);
        if let Some(i) = halves.clone().flatten().position(|run| !fits(run, &ends, levels, n)) {
            return Err(bad(runs_at + 16 * i as u64, "a run of points or levels that are not there"));
        }
        // Every block draws points.
        if let Some(i) = halves.clone().position(|[points, _]| points[3] == 0) {
            return Err(bad(runs_at + 32 * i as u64, "a block without points"));
        }
        let mut inside = vec![cells.len() as u32];
        for (i, &[.., level, skip, represented_by, block]) in (0u32..).zip(&cells) {
            let at = cells_at + 4 * CELL as u64 * i as u64;
            while inside.last() == Some(&i) {
                inside.pop();
            }
            let parent = inside.last().copied().unwrap_or(0);
            if !(i < skip && skip <= parent) {
                return Err(bad(at + 32, "cells are not within each other"));
            }
            inside.push(skip);
            let known = block == NONE && skip > i + 1 || block < runs.len() as u32;
            if !(level < sides.len() as u32 && (represented_by as u64) < n && known) {
                return Err(bad(at, "a cell of a level, point or block that is not there"));
            }
        }
        let finest = f32::from_bits(finest);
        if loose as u64 > n {
            return Err(bad(32, "more points in no cell than there are"));
        }
        let options = Options { preset, block, r };
        let deepest = sides.len().saturating_sub(1) as u8;
        let mut octree = Octree {
            flat: Flat { finest: (finest < f32::INFINITY).then_some(finest), ..flat },
            preset,
            options,
            cloud,
            cells: cells.iter().map(Cell::from_words).collect(),
            points,
            moved: f32::from_bits(moved),
            loose,
            blocks: halves
                .map(|run| run.map(Run::from_words))
                .map(|[points, averages]| Block { points, averages, own: 0.0 })
                .collect(),
            ends,
            sides,
            grids: grids(&options, deepest),
        };
        octree.measure();
        Ok(octree)
    }

    /// Writes a file: whole under its name, or not at all.
    pub fn save(&self, path: &Path) -> Result<()> {
        save(path, |to| self.write(to))
    }

    /// Reads a file, as [`read`](Self::read).
    pub fn load(path: &Path) -> Result<Octree> {
        load(path, Octree::read)
    }
}

/// Whether a run's levels are in the table, grow, and end with points that there are.
fn fits([first, base, table, levels]: [u32; 4], ends: &[u32], most: u32, n: u64) -> bool {
    let Some(own) = ends.get(table as usize..).and_then(|ends| ends.get(..levels as usize)) else { return false };
    let end = own.last().copied().unwrap_or(0);
    base as u64 + levels as u64 <= most as u64 && own.is_sorted() && first as u64 + end as u64 <= n
}
