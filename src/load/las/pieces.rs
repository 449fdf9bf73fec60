//! LAS and LAZ in pieces.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};

use super::header::Header;
use super::laszip::Chunks;
use super::points::{Block, Points};
use super::{BLOCK, cloud, complete, header, middle, records};
use crate::error::{Error, Place, Result};
use crate::load::pieces::{Reader, Start};
use crate::load::{PointCloud, Report};
use crate::par;

/// Places of the file that origin and colours are found at.
const PLACES: u64 = 16;
/// Coordinates that are looked at in each.
const LOOKED_AT: usize = 256;

struct Las {
    file: PathBuf,
    source: BufReader<File>,
    header: Header,
    /// `None`: uncompressed.
    chunks: Option<Chunks>,
    /// Chunks, or records, that were read.
    at: u64,
    middle: [i64; 3],
    /// What the sample says of colours; no points.
    sample: Points,
}

/// `None` for points in one chunk, which cannot be read in pieces.
pub(in crate::load) fn pieces(file: &Path, mut source: BufReader<File>) -> Result<Option<(Start, Box<dyn Reader>)>> {
    let header = header::read(file, &mut source)?;
    let chunks = match header.is_compressed {
        true => Some(Chunks::open(file, &mut source, &header)?),
        false => None,
    };
    if chunks.as_ref().is_some_and(|c| c.is_one) {
        return Ok(None);
    }
    if chunks.is_none() {
        complete(file, &header)?;
    }
    let sample = Points::default();
    let mut las = Las { file: file.to_owned(), source, header, chunks, at: 0, middle: [0; 3], sample };
    las.look()?;
    let scale = DVec3::from_array(las.header.scale);
    let start = Start {
        origin: DVec3::from_array(las.header.offset) + scale * DVec3::from_array(las.middle.map(|m| m as f64)),
        lattice: Some(scale),
        points: las.header.points,
        up: Some(Vec3::Z),
        format: las.header.kind(),
        ..Start::default()
    };
    Ok(Some((start, Box::new(las))))
}

impl Las {
    fn blocks(&mut self, first: u64, n: u64) -> Result<Vec<Block>> {
        match &self.chunks {
            Some(chunks) => {
                let which = first as usize..(first + n) as usize;
                chunks.decode(&self.file, &mut self.source, &self.header.layout, which)
            }
            None => records(&self.file, &mut self.source, &self.header, first, n),
        }
    }

    /// Chunks or records in all, and how many of them are one step.
    fn steps(&self) -> (u64, u64) {
        let width = par::width() as u64;
        match &self.chunks {
            Some(chunks) => (chunks.len() as u64, 2 * width),
            None => (self.header.points, BLOCK * width),
        }
    }

    /// Looks at a few places for what must be known before the first piece.
    fn look(&mut self) -> Result<()> {
        let (all, _) = self.steps();
        let one = if self.chunks.is_some() { 1 } else { 4096 };
        let mut looked: Vec<[i32; 3]> = Vec::new();
        for i in 0..PLACES.min(all.div_ceil(one)) {
            // The first and the last are among them.
            let first = (all.saturating_sub(one) as f64 * i as f64 / (PLACES - 1) as f64) as u64;
            let mut points = Points::like(&self.sample);
            self.blocks(first, one.min(all))?.into_iter().for_each(|block| points.push(block));
            let step = points.xyz.len().div_ceil(LOOKED_AT).max(1);
            looked.extend(points.xyz.iter().step_by(step));
            self.sample = Points::like(&points);
        }
        self.middle = middle(&looked);
        Ok(())
    }
}

impl Reader for Las {
    fn next(&mut self, report: &mut Report) -> Result<Option<PointCloud>> {
        let (all, step) = self.steps();
        let n = step.min(all - self.at);
        if n == 0 {
            return Ok(None);
        }
        let blocks = self.blocks(self.at, n)?;
        self.at += n;
        let mut points = Points::like(&self.sample);
        blocks.into_iter().for_each(|block| points.push(block));
        if points.wide_color && !self.sample.wide_color && self.sample.any_color {
            let why = "colours are of 8 bits in all samples of the file, but of 16 elsewhere: read it in full";
            return Err(Error::data(&self.file, Place::File, why));
        }
        let cloud = cloud(&self.file, &self.header, points, self.middle)?;
        cloud.report.dropped.iter().for_each(|(why, n)| report.drop(why, *n));
        Ok(Some(cloud))
    }
}
