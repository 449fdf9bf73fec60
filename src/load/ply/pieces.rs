//! Binary PLY in pieces.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::header::{self, Element, Encoding, Scalar};
use super::table::Table;
use super::{ascii, check_position, splat, vertices};
use crate::error::{Error, Result};
use crate::load::pieces::{Reader, Start};
use crate::load::{PointCloud, Report, clean};

/// Rows of one piece: a few MiB in all that is made of them.
const PIECE: u64 = 1 << 16;

struct Ply {
    file: PathBuf,
    source: BufReader<File>,
    vertex: Element,
    encoding: Encoding,
    stride: usize,
    /// Byte of the first row.
    start: u64,
    /// Rows that were read.
    at: u64,
    origin: DVec3,
}

/// `None` for what is not read in pieces: text, rows of different lengths, splats, values whose full scale all values
/// decide, and faces that normals come from.
pub(in crate::load) fn pieces(file: &Path, mut source: BufReader<File>) -> Result<Option<(Start, Box<dyn Reader>)>> {
    let io = |e| Error::io(file, e);
    let mut head = Vec::new();
    (&mut source).take(header::MAX_HEADER as u64 + 1).read_to_end(&mut head).map_err(io)?;
    let header = header::parse(file, &head)?;
    let number = header.elements.iter().position(|e| e.name == "vertex");
    let Some((before, [vertex, after @ ..])) = number.map(|n| header.elements.split_at(n)) else { return Ok(None) };
    check_position(file, &header, vertex)?;
    let has = |name: &str| vertex.properties.iter().any(|p| p.name == name);
    let faces = after.iter().any(|e| super::faces::corners_of(e).is_some());
    let skipped: Option<u64> = before.iter().map(|e| e.stride().map(|s| e.count.saturating_mul(s as u64))).sum();
    // Colours of other types mean what the largest of all says.
    let plain = |p: &header::Property| !vertices::is_color(&p.name) || p.ty == Scalar::U8;
    let splats = splat::NAMES.iter().all(|name| has(name));
    let plain = vertex.properties.iter().all(plain) && !splats && (!faces || ["nx", "ny", "nz"].iter().all(|n| has(n)));
    let (Some(stride), Some(skipped), true) = (vertex.stride(), skipped, plain && header.encoding != Encoding::Ascii)
    else {
        return Ok(None);
    };
    let start = (header.body as u64).saturating_add(skipped);
    let size = source.get_ref().metadata().map_err(io)?.len();
    let rows = size.saturating_sub(start) / stride as u64;
    if rows < vertex.count {
        return Err(ascii::truncated(file, vertex, rows));
    }
    let (vertex, encoding) = (vertex.clone(), header.encoding);
    let mut ply = Ply { file: file.to_owned(), source, vertex, encoding, stride, start, at: 0, origin: DVec3::ZERO };
    ply.origin = ply.look()?;
    let format = if encoding == Encoding::Big { "PLY binary big-endian" } else { "PLY binary little-endian" };
    let start = Start { origin: ply.origin, points: ply.vertex.count, format: format.into(), ..Start::default() };
    Ok(Some((start, Box::new(ply))))
}

impl Ply {
    fn rows(&mut self, first: u64, n: u64) -> Result<Vec<u8>> {
        let mut bytes = vec![0; n as usize * self.stride];
        let at = SeekFrom::Start(self.start + first * self.stride as u64);
        let read = self.source.seek(at).and_then(|_| self.source.read_exact(&mut bytes));
        read.map_err(|e| Error::io(&self.file, e))?;
        Ok(bytes)
    }

    /// The origin that reading in full would find.
    fn look(&mut self) -> Result<DVec3> {
        let mut sampled = Vec::new();
        let step = self.vertex.count.div_ceil(clean::SAMPLE as u64).max(1);
        for row in (0..self.vertex.count).step_by(step as usize) {
            sampled.extend(self.rows(row, 1)?);
        }
        let table = Table::in_place(&sampled, &self.vertex, self.encoding);
        let xyz = table.as_ref().and_then(|t| t.fields(["x", "y", "z"]));
        let (Some(table), Some(xyz)) = (table, xyz) else { return Ok(DVec3::ZERO) };
        let points: Vec<DVec3> =
            (0..table.rows()).map(|i| DVec3::from_array(xyz.map(|field| table.at(field, i)))).collect();
        Ok(vertices::origin_of(&points, xyz))
    }
}

impl Reader for Ply {
    fn next(&mut self, report: &mut Report) -> Result<Option<PointCloud>> {
        let n = PIECE.min(self.vertex.count - self.at);
        if n == 0 {
            return Ok(None);
        }
        let bytes = self.rows(self.at, n)?;
        self.at += n;
        let table = Table::in_place(&bytes, &self.vertex, self.encoding);
        let xyz = table.as_ref().and_then(|t| t.fields(["x", "y", "z"]));
        let (Some(table), Some(xyz)) = (table, xyz) else { return Ok(None) };
        let mut cloud = vertices::about(&table, xyz, self.origin)?;
        vertices::clean(&mut cloud);
        cloud.report.dropped.iter().for_each(|(why, n)| report.drop(why, *n));
        cloud.report.repaired.iter().for_each(|(why, n)| report.repair(why, *n));
        Ok(Some(cloud))
    }
}
