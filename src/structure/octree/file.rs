//! Octrees in a file, so that they are made once. The layout is in docs/FORMAT.md.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Write};
use std::path::Path;

use glam::{DVec3, Vec3};

use super::{Block, Cell, Octree, Options, Preset, Run};
use crate::error::{Error, Place, Result};
use crate::structure::file::{Input, Output, save};
use crate::structure::flat::blocks;
use crate::structure::morton::LEVELS;
use crate::structure::nodes::NONE;
use crate::structure::{Flat, Packing};

const MAGIC: &[u8; 8] = b"surfelOC";
const VERSION: u32 = 1;
/// Bytes before the cells.
const HEADER: usize = 96;
/// Words of a cell.
const CELL: usize = 11;
/// Words of a block.
const BLOCK: usize = 8;

/// In the flags.
const NORMALS: u32 = 1;
const COLORS: u32 = 2;
const CLOSED: u32 = 4;

impl Cell {
    fn words(&self) -> [u32; CELL] {
        let ([a, b, c], [d, e, f]) = (self.min.to_array(), self.max.to_array());
        let [a, b, c, d, e, f, reach] = [a, b, c, d, e, f, self.reach].map(f32::to_bits);
        [a, b, c, d, e, f, reach, self.level as u32, self.skip, self.represented_by, self.block]
    }

    fn from_words(words: &[u32; CELL]) -> Cell {
        let v = |i: usize| Vec3::from_array([0, 1, 2].map(|k| f32::from_bits(words[i + k])));
        let [.., reach, level, skip, represented_by, block] = *words;
        Cell { min: v(0), max: v(3), reach: f32::from_bits(reach), level: level as u8, skip, represented_by, block }
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
    /// The header: little-endian, in this order.
    fn header(&self) -> Vec<u8> {
        let (flat, Options { preset, block, r }) = (&self.flat, self.options);
        let flags = [(flat.has_normals(), NORMALS), (flat.has_colors(), COLORS), (flat.closed, CLOSED)];
        let flags = flags.iter().filter(|f| f.0).map(|f| f.1).sum::<u32>();
        let counts = [self.cells.len(), self.blocks.len(), self.ends.len(), self.sides.len(), flat.len()];
        let finest = flat.finest.unwrap_or(f32::INFINITY);
        let mut header = Vec::with_capacity(HEADER);
        header.extend(MAGIC);
        let words = [VERSION, flags, preset as u32, block, r, self.points, self.loose];
        let words = words.into_iter().chain([self.moved.to_bits(), finest.to_bits()]);
        for word in words.chain(counts.map(|n| n as u32)) {
            header.extend(word.to_le_bytes());
        }
        for number in flat.origin.to_array().map(f64::to_bits).into_iter().chain([self.cloud]) {
            header.extend(number.to_le_bytes());
        }
        header
    }

    /// Writes it, as built: what is packed is refused, since it is not what [`is_of`](Self::is_of) would compare.
    pub fn write(&self, to: &mut impl Write) -> std::io::Result<()> {
        if self.flat.packing() != Packing::Full {
            return Err(std::io::Error::new(ErrorKind::InvalidInput, "a packed octree: pack what was loaded instead"));
        }
        let mut out = Output::new(to);
        out.add(&self.header())?;
        for cell in &self.cells {
            out.add(&cell.words())?;
        }
        for block in &self.blocks {
            out.add(&[block.points.words(), block.averages.words()])?;
        }
        out.add(&self.ends)?;
        out.add(&self.sides)?;
        out.add(&self.flat.geometry)?;
        for stream in [&self.flat.normals, &self.flat.colors].into_iter().flatten() {
            out.add(stream)?;
        }
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
        let mut header = [0; HEADER];
        input.fill(&mut header)?;
        let word = |i: usize| u32::from_le_bytes(std::array::from_fn(|k| header[8 + 4 * i + k]));
        let number = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| header[64 + 8 * i + k]));
        if &header[..8] != MAGIC {
            return Err(bad(0, "not a file of an octree"));
        }
        if word(0) != VERSION {
            return Err(bad(8, &format!("version {}: this program reads {VERSION}", word(0))));
        }
        let (flags, n) = (word(1), word(13) as u64);
        let cells: Vec<[u32; CELL]> = input.items(word(9) as u64)?;
        let runs_at = input.at();
        let runs: Vec<[u32; BLOCK]> = input.items(word(10) as u64)?;
        let ends: Vec<u32> = input.items(word(11) as u64)?;
        let sides: Vec<f32> = input.items(word(12) as u64)?;
        let geometry: Vec<[f32; 4]> = input.items(n)?;
        let mut stream = |flag: u32| if flags & flag != 0 { input.items(n).map(Some) } else { Ok(None) };
        let (normals, colors) = (stream(NORMALS)?, stream(COLORS)?);
        input.finish()?;

        // What carries its checksum may still be someone else's.
        let preset = Preset::ALL.iter().map(|(_, preset)| *preset).find(|preset| *preset as u32 == word(2));
        let preset = preset.ok_or_else(|| bad(16, "no such preset"))?;
        if sides.len() > LEVELS as usize + 1 {
            return Err(bad(56, "more levels than a cell can be halved"));
        }
        let halves = runs.iter().map(|&[a, b, c, d, e, f, g, h]| [[a, b, c, d], [e, f, g, h]]);
        if let Some(i) = halves.clone().flatten().position(|run| !fits(run, &ends, sides.len() as u32, n)) {
            return Err(bad(runs_at + 16 * i as u64, "a run of points or levels that are not there"));
        }
        // Every block draws points.
        if let Some(i) = halves.clone().position(|[points, _]| points[3] == 0) {
            return Err(bad(runs_at + 32 * i as u64, "a block without points"));
        }
        let mut inside = vec![cells.len() as u32];
        for (i, &[.., level, skip, represented_by, block]) in (0u32..).zip(&cells) {
            let at = HEADER as u64 + 4 * CELL as u64 * i as u64;
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
        let (loose, finest) = (word(6), f32::from_bits(word(8)));
        if loose as u64 > n {
            return Err(bad(32, "more points in no cell than there are"));
        }
        Ok(Octree {
            flat: Flat {
                origin: DVec3::from_array([0, 1, 2].map(|i| f64::from_bits(number(i)))),
                blocks: blocks(geometry.len(), |i| geometry[i]),
                geometry,
                normals,
                colors,
                closed: flags & CLOSED != 0,
                finest: (finest < f32::INFINITY).then_some(finest),
                ..Flat::default()
            },
            preset,
            options: Options { preset, block: word(3), r: word(4) },
            cloud: number(3),
            cells: cells.iter().map(Cell::from_words).collect(),
            points: word(5),
            moved: f32::from_bits(word(7)),
            loose,
            blocks: halves
                .map(|run| run.map(Run::from_words))
                .map(|[points, averages]| Block { points, averages })
                .collect(),
            ends,
            sides,
        })
    }

    /// Writes a file: whole under its name, or not at all.
    pub fn save(&self, path: &Path) -> Result<()> {
        save(path, |to| self.write(to))
    }

    /// Reads a file, as [`read`](Self::read).
    pub fn load(path: &Path) -> Result<Octree> {
        let file = File::open(path).map_err(|e| Error::io(path, e))?;
        Octree::read(&mut BufReader::new(file), path)
    }
}

/// Whether a run's levels are in the table, grow, and end with points that there are.
fn fits([first, base, table, levels]: [u32; 4], ends: &[u32], sides: u32, n: u64) -> bool {
    let Some(own) = ends.get(table as usize..).and_then(|ends| ends.get(..levels as usize)) else { return false };
    let end = own.last().copied().unwrap_or(0);
    base as u64 + levels as u64 <= sides as u64 && own.is_sorted() && first as u64 + end as u64 <= n
}
