//! A patch as bytes: attributes in planes of bytes, delta coded along the order of storage, then `zstd`.
//!
//! Deltas are split into planes of bytes, not packed into bits: the entropy stage codes bytes, and a plane of low bytes or
//! of high bytes has a distribution of its own, which packed bits would smear. See docs/FORMAT.md for the layout.

use std::io::Write;
use std::slice::ChunksExact;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

use super::{Index, MAX_SAMPLES, Patch};
use crate::error::{Error, Place, Result};
use crate::structure::file::Fnv;
use crate::structure::octahedral;

/// Bytes before the compressed planes.
const HEAD: usize = 32;
/// Effort of the entropy stage. On scans, 9 saves 1 % more and takes four times as long.
const LEVEL: i32 = 3;

/// Least ratio of two radii that follow each other in the table: off by half of it, 2 %, a radius looks the same, and finer
/// steps cost 1.6 bits a sample (the Stanford dragon).
const RATIO: f32 = 1.04;

/// One sample as the builder keeps it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Sample {
    /// Relative to the model's origin.
    pub position: [f32; 3],
    /// Covering radius; 0: none is known.
    pub radius: f32,
    /// [`octahedral`] code.
    pub normal: u32,
    /// As in [`Flat`](crate::structure::Flat).
    pub color: u32,
}

/// What the samples of a model have.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Content {
    pub normals: bool,
    pub colors: bool,
    pub exact: bool,
    pub lattice: Option<DVec3>,
    /// Number of groups.
    pub groups: Option<u32>,
}

impl Content {
    pub fn of(index: &Index) -> Content {
        let Index { normals, colors, exact, lattice, groups, .. } = *index;
        Content { normals, colors, exact, lattice, groups }
    }

    /// Planes of everything but positions.
    fn planes(&self) -> usize {
        let [radius, normal] = if self.exact { [4, 4] } else { [1, 2] };
        radius
            + if self.normals { normal } else { 0 }
            + if self.colors { 3 } else { 0 }
            + self.groups.is_some() as usize
    }
}

/// How the integers of a patch become coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Grid {
    /// base + step · i, in f64.
    Steps { base: [f32; 3], step: f32 },
    /// Integers are the bits of floats, in their order; from base on.
    Bits { base: [u32; 3] },
    /// (base + i) · lattice, in f64.
    Lattice { base: [i32; 3], lattice: DVec3 },
}

/// Bits of a float as an integer that orders as floats do.
fn ordered(v: f32) -> u32 {
    let bits = v.to_bits();
    if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
}

fn from_ordered(v: u32) -> f32 {
    f32::from_bits(if v >> 31 == 1 { v & !(1 << 31) } else { !v })
}

impl Grid {
    /// The grid of some samples: of at most this error along the diagonal of a cell, or exact where `error` is 0.
    pub fn round(samples: &[Sample], error: f32, lattice: Option<DVec3>) -> Grid {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for s in samples {
            low = low.min(s.position.into());
            high = high.max(s.position.into());
        }
        if error > 0.0 {
            // A cell's half diagonal is √3/2 of its side, and a coordinate of f32 may round once more.
            let rounding = low.abs().max(high.abs()).max_element() * f32::EPSILON;
            let step = (2.0 / 3.0f32.sqrt()) * (error - rounding);
            // Below 2⁻²⁴ of the extent floats are as fine.
            if step > (high - low).max_element() * (1.0 / (1 << 24) as f32) && step >= f32::MIN_POSITIVE {
                return Grid::Steps { base: low.into(), step };
            }
        }
        if let Some(lattice) = lattice
            && let Some(grid) = Grid::on(samples, low, high, lattice)
        {
            return grid;
        }
        let base = [0, 1, 2].map(|a| samples.iter().map(|s| ordered(s.position[a])).min().unwrap_or(0));
        Grid::Bits { base }
    }

    /// The lattice, if every sample lies on it to the bit.
    fn on(samples: &[Sample], low: Vec3, high: Vec3, lattice: DVec3) -> Option<Grid> {
        // Of negative steps the highest coordinate has the lowest number.
        let ends = [low, high].map(|p| (p.as_dvec3() / lattice).round());
        let base = ends[0].min(ends[1]);
        // Beyond 2²³ a float no longer tells neighbours on the lattice apart.
        let most = (1 << 23) as f64;
        if !(ends[0].abs().max_element() < most && ends[1].abs().max_element() < most) {
            return None;
        }
        let grid = Grid::Lattice { base: base.as_ivec3().to_array(), lattice };
        let kept = |s: &Sample| grid.place(grid.numbers(s.position)).map(f32::to_bits) == s.position.map(f32::to_bits);
        samples.iter().all(kept).then_some(grid)
    }

    pub fn numbers(&self, p: [f32; 3]) -> [u32; 3] {
        match *self {
            Grid::Steps { base, step } => {
                std::array::from_fn(|a| ((p[a] as f64 - base[a] as f64) / step as f64).round() as u32)
            }
            Grid::Bits { base } => std::array::from_fn(|a| ordered(p[a]) - base[a]),
            Grid::Lattice { base, lattice } => {
                std::array::from_fn(|a| ((p[a] as f64 / lattice[a]).round() - base[a] as f64) as u32)
            }
        }
    }

    pub fn place(&self, n: [u32; 3]) -> [f32; 3] {
        match *self {
            Grid::Steps { base, step } => std::array::from_fn(|a| (base[a] as f64 + step as f64 * n[a] as f64) as f32),
            Grid::Bits { base } => std::array::from_fn(|a| from_ordered(base[a].wrapping_add(n[a]))),
            Grid::Lattice { base, lattice } => {
                std::array::from_fn(|a| ((base[a] as f64 + n[a] as f64) * lattice[a]) as f32)
            }
        }
    }

    /// How far a sample moves at most \[world units\].
    pub fn error(&self, reach: f32) -> f32 {
        match *self {
            Grid::Steps { step, .. } => 0.8661 * step + reach * f32::EPSILON,
            _ => 0.0,
        }
    }
}

/// Radii in bytes: low · ratio^code, made by products so that every machine makes the same.
fn radius_table(low: f32, ratio: f32) -> [f32; 256] {
    let mut value = low as f64;
    std::array::from_fn(|_| {
        let this = value.min(f32::MAX as f64) as f32;
        value *= ratio as f64;
        this
    })
}

/// Low, ratio and table for these radii.
fn radius_code(samples: &[Sample]) -> (f32, f32, [f32; 256]) {
    let low = samples.iter().map(|s| s.radius).fold(f32::MAX, f32::min).max(f32::MIN_POSITIVE);
    let high = samples.iter().map(|s| s.radius).fold(low, f32::max);
    // Up by a rounding, so that the highest is reached.
    let root = (high as f64 / low as f64).powf(1.0 / 255.0);
    let ratio = if high > low { (root as f32).next_up().max(RATIO) } else { 1.0 };
    (low, ratio, radius_table(low, ratio))
}

/// The number of the nearest entry, the lower of two.
fn nearest(table: &[f32; 256], r: f32) -> u8 {
    let above = table.partition_point(|t| *t < r).min(255);
    if above > 0 && r - table[above - 1] <= table[above] - r { above as u8 - 1 } else { above as u8 }
}

/// 16 bits an axis to 8: −127 to 127, −128 for none.
fn narrow(code: u32) -> [u8; 2] {
    if code == octahedral::NONE {
        return [0x80; 2];
    }
    let byte = |bits: u32| ((bits as u16 as i16 as f32 / 32767.0).max(-1.0) * 127.0).round() as i8 as u8;
    [byte(code), byte(code >> 16)]
}

fn widen([x, y]: [u8; 2]) -> u32 {
    if [x, y].contains(&0x80) {
        return octahedral::NONE;
    }
    let wide = |b: u8| (b as i8 as f32 / 127.0 * 32767.0).round() as i16 as u16 as u32;
    wide(x) | wide(y) << 16
}

/// Samples in the order of storage, as bytes; `samples` become what decoding gives.
pub(super) fn encode(samples: &mut [Sample], content: &Content, grid: &Grid) -> std::io::Result<Vec<u8>> {
    let n = samples.len();
    let mut head = [0u8; HEAD];
    let mut raw: Vec<u8> = Vec::with_capacity(n * (6 + content.planes()));
    let numbers: Vec<[u32; 3]> = samples.iter().map(|s| grid.numbers(s.position)).collect();
    let mut deltas = vec![0u32; n];
    for axis in 0..3 {
        let mut before = 0;
        let mut all = 0;
        for (d, v) in deltas.iter_mut().zip(&numbers) {
            let delta = v[axis].wrapping_sub(before) as i32;
            before = v[axis];
            *d = ((delta << 1) ^ (delta >> 31)) as u32;
            all |= *d;
        }
        let planes = 4 - all.leading_zeros() as usize / 8;
        head[1 + axis] = planes as u8;
        (0..planes).for_each(|plane| raw.extend(deltas.iter().map(|d| (d >> (8 * plane)) as u8)));
    }
    let (kind, base, step) = match *grid {
        Grid::Steps { base, step } => (0, base.map(f32::to_bits), step),
        Grid::Bits { base } => (1, base, 0.0),
        Grid::Lattice { base, .. } => (2, base.map(|v| v as u32), 0.0),
    };
    let (low, ratio, table) = radius_code(samples);
    head[0] = kind;
    let words = [base[0], base[1], base[2], step.to_bits(), low.to_bits(), ratio.to_bits(), n as u32];
    head[4..].copy_from_slice(&words.map(u32::to_le_bytes).concat());
    for (s, v) in samples.iter_mut().zip(&numbers) {
        s.position = grid.place(*v);
    }
    if content.exact {
        words_planes(&mut raw, samples.iter().map(|s| s.radius.to_bits()));
    } else {
        let codes: Vec<u8> = samples.iter().map(|s| nearest(&table, s.radius)).collect();
        samples.iter_mut().zip(&codes).for_each(|(s, c)| s.radius = table[*c as usize]);
        bytes_plane(&mut raw, codes.into_iter());
    }
    if content.normals && content.exact {
        words_planes(&mut raw, samples.iter().map(|s| s.normal));
    } else if content.normals {
        bytes_plane(&mut raw, samples.iter().map(|s| narrow(s.normal)[0]));
        bytes_plane(&mut raw, samples.iter().map(|s| narrow(s.normal)[1]));
        samples.iter_mut().for_each(|s| s.normal = widen(narrow(s.normal)));
    }
    if content.colors {
        let rgb = |s: &Sample| s.color.to_le_bytes();
        bytes_plane(&mut raw, samples.iter().map(|s| rgb(s)[1]));
        for c in [0, 2] {
            bytes_plane(&mut raw, samples.iter().map(|s| rgb(s)[c].wrapping_sub(rgb(s)[1])));
        }
    }
    let mut bytes = head.to_vec();
    compress(&raw, n, &mut bytes)?;
    Ok(bytes)
}

/// The groups of a patch's samples: a frame behind that of [`encode`], since they are found once all patches are there.
pub(super) fn encode_groups(of: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    compress(of, of.len(), &mut bytes).map(|()| bytes)
}

/// One frame. A block ends with every plane: a block has one table of codes, and what is frequent in one plane is rare in
/// the next.
fn compress(raw: &[u8], plane: usize, to: &mut Vec<u8>) -> std::io::Result<()> {
    let mut frame = zstd::stream::write::Encoder::new(to, LEVEL)?;
    frame.set_pledged_src_size(Some(raw.len() as u64))?;
    for plane in raw.chunks(plane.max(1)) {
        frame.write_all(plane)?;
        frame.flush()?;
    }
    frame.finish().map(|_| ())
}

fn bytes_plane(raw: &mut Vec<u8>, values: impl Iterator<Item = u8>) {
    let mut before = 0u8;
    raw.extend(values.map(|v| {
        let delta = v.wrapping_sub(before);
        before = v;
        delta
    }));
}

/// The four bytes of every word, lowest first, a plane each; lossless, hardly smaller.
fn words_planes(raw: &mut Vec<u8>, words: impl Iterator<Item = u32> + Clone) {
    (0..4).for_each(|plane| bytes_plane(raw, words.clone().map(|w| (w >> (8 * plane)) as u8)));
}

impl Patch {
    /// Decodes the bytes of a node's patch. `node` is less than the number of nodes.
    ///
    /// The checksum comes first, so that what is decoded is what was written; even so nothing is trusted: at most
    /// [`MAX_SAMPLES`] samples of 24 bytes are decompressed.
    ///
    /// # Errors
    /// [`Error::Data`] with the file's name and the byte in it, where the bytes are not the patch that the index means.
    pub fn decode(index: &Index, node: u32, bytes: &[u8]) -> Result<Patch> {
        let node = &index.nodes[node as usize];
        let fail = |at: usize, why: &str| Error::data(&index.name, Place::Byte(node.at + at as u64), why);
        if bytes.len() != node.bytes as usize || bytes.len() < HEAD {
            return Err(fail(0, &format!("{} bytes of a patch of {}", bytes.len(), node.bytes)));
        }
        let mut hash = Fnv::NEW;
        hash.add(bytes);
        if hash.0 != node.checksum {
            return Err(fail(0, "the patch's checksum differs: it was altered, or is another model's"));
        }
        let n = node.samples as usize;
        let word = |i: usize| u32::from_le_bytes([bytes[4 * i], bytes[4 * i + 1], bytes[4 * i + 2], bytes[4 * i + 3]]);
        let float = |i: usize| f32::from_bits(word(i));
        if word(7) != node.samples || node.samples > MAX_SAMPLES {
            return Err(fail(28, "the patch has another number of samples than the index says"));
        }
        let grid = match (bytes[0], index.lattice) {
            (0, _) => Grid::Steps { base: [float(1), float(2), float(3)], step: float(4) },
            (1, _) => Grid::Bits { base: [word(1), word(2), word(3)] },
            (2, Some(lattice)) => Grid::Lattice { base: [word(1), word(2), word(3)].map(|v| v as i32), lattice },
            _ => return Err(fail(0, "the kind of coordinates is not known")),
        };
        let content = Content::of(index);
        let positions = &bytes[1..4];
        if positions.iter().any(|p| *p > 4) {
            return Err(fail(1, "a coordinate of more than four bytes"));
        }
        let planes = positions.iter().map(|p| *p as usize).sum::<usize>() + content.planes();
        let mut raw = vec![0; n * planes];
        // One frame, or two with groups: what comes out follows each other.
        match zstd::bulk::decompress_to_buffer(&bytes[HEAD..], &mut raw) {
            Ok(size) if size == raw.len() => {}
            Ok(_) => return Err(fail(HEAD, "the patch holds less than its header says")),
            Err(e) => return Err(fail(HEAD, &format!("the patch cannot be decompressed: {e}"))),
        }
        let mut planes = raw.chunks_exact(n.max(1));
        let mut numbers = vec![[0u32; 3]; n];
        for axis in 0..3 {
            for plane in 0..positions[axis] {
                for (v, b) in numbers.iter_mut().zip(planes.next().unwrap_or_default()) {
                    v[axis] |= (*b as u32) << (8 * plane);
                }
            }
            let mut before = 0u32;
            for v in &mut numbers {
                before = before.wrapping_add((v[axis] >> 1) ^ (v[axis] & 1).wrapping_neg());
                v[axis] = before;
            }
        }
        let positions: Vec<[f32; 3]> = numbers.into_iter().map(|v| grid.place(v)).collect();
        let radii: Vec<f32> = if content.exact {
            undo_words(&mut planes, n).into_iter().map(f32::from_bits).collect()
        } else {
            let table = radius_table(float(5), float(6));
            undo_bytes(&mut planes).map(|c| table[c as usize]).collect()
        };
        if radii.iter().any(|r| !(*r > 0.0 && r.is_finite())) || positions.iter().flatten().any(|v| !v.is_finite()) {
            return Err(fail(HEAD, "a sample of the patch is no number, or has no size"));
        }
        let normals = content.normals.then(|| match content.exact {
            true => undo_words(&mut planes, n),
            false => {
                let x: Vec<u8> = undo_bytes(&mut planes).collect();
                x.into_iter().zip(undo_bytes(&mut planes)).map(|(x, y)| widen([x, y])).collect()
            }
        });
        let colors = content.colors.then(|| {
            let green: Vec<u8> = undo_bytes(&mut planes).collect();
            let red: Vec<u8> = undo_bytes(&mut planes).collect();
            let rest = green.iter().zip(red).zip(undo_bytes(&mut planes));
            rest.map(|((g, r), b)| u32::from_le_bytes([r.wrapping_add(*g), *g, b.wrapping_add(*g), 255])).collect()
        });
        let groups = content.groups.map(|_| planes.next().unwrap_or_default().to_vec());
        if groups.iter().flatten().any(|group| u32::from(*group) >= content.groups.unwrap_or(0)) {
            return Err(fail(HEAD, "a sample is in a group that the model does not have"));
        }
        Ok(Patch { positions, radii, normals, colors, groups })
    }
}

fn undo_bytes<'a>(planes: &mut ChunksExact<'a, u8>) -> impl Iterator<Item = u8> + use<'a> {
    let plane = planes.next().unwrap_or_default();
    plane.iter().scan(0u8, |before, d| {
        *before = before.wrapping_add(*d);
        Some(*before)
    })
}

fn undo_words(planes: &mut ChunksExact<u8>, n: usize) -> Vec<u32> {
    let mut words = vec![0u32; n];
    for plane in 0..4 {
        words.iter_mut().zip(undo_bytes(planes)).for_each(|(w, b)| *w |= (b as u32) << (8 * plane));
    }
    words
}
