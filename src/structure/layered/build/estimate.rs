//! Normals and radii for samples that have none, in bounded memory: cells of the space one after the other, each with a
//! margin of its neighbours.
//!
//! What a cell finds differs from what the whole would find only where a point's neighbours reach beyond the margin, 32
//! median spacings; where density drops by more than a hundredfold from one cell to the next, that may happen. Which way
//! normals point is decided in each cell by itself, with the same rule: toward the scanner, upward or outward.

use std::sync::atomic::Ordering;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

use super::region::Region;
use super::select;
use super::spool::{BUFFER, Spool};
use super::tree::Maker;
use crate::error::Result;
use crate::load::PointCloud;
use crate::load::attributes;
use crate::structure::layered::patch::Sample;
use crate::structure::octahedral;

/// Bytes that a point takes while its cell is worked on: position, normal and radius, its number, and what
/// [`attributes::complete`] needs.
const WORKING: u64 = 176;
/// Width of the margin, in median spacings.
const MARGIN: f32 = 32.0;

/// A point and its number among the samples.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Numbered {
    position: [f32; 3],
    number: [u32; 2],
}

impl Numbered {
    fn number(&self) -> u64 {
        self.number[0] as u64 | (self.number[1] as u64) << 32
    }
}

/// What is found of a sample.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Found {
    normal: u32,
    radius: f32,
}

/// What orients normals.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Facing {
    pub up: Option<Vec3>,
    /// Relative to the model's origin.
    pub scanner: Option<DVec3>,
}

/// A cell: what is its own, and how far its points reach.
struct Cell {
    points: Spool<Numbered>,
    /// Half open: from `low` on, below `high`.
    own: Region,
    all: Region,
}

impl Maker<'_> {
    /// The same samples in the same order, with normals, and with radii where they had none.
    pub fn estimated(&self, samples: Spool<Sample>, region: Region, facing: &Facing) -> Result<Spool<Sample>> {
        let mut points = self.folder.writer::<Numbered>()?;
        let mut block = Vec::new();
        samples.each(|first, records| {
            block.clear();
            let numbered = (first..)
                .zip(records)
                .map(|(i, s)| Numbered { position: s.position, number: [i as u32, (i >> 32) as u32] });
            block.extend(numbered);
            points.push(&block)
        })?;
        let found = self.folder.writer::<Found>()?.finish()?;
        let own = Region { low: Vec3::NEG_INFINITY, high: Vec3::INFINITY };
        let margin = MARGIN * self.spacing(&samples, &region)?;
        self.cell(Cell { points: points.finish()?, own, all: region }, margin, facing, &found, 0)?;
        self.done.store(0, Ordering::Relaxed);
        let mut out = self.folder.writer::<Sample>()?;
        let (mut attributes, mut block) = (Vec::new(), Vec::new());
        samples.each(|first, records| {
            attributes.resize(records.len(), Found { normal: 0, radius: 0.0 });
            found.read(first, &mut attributes)?;
            block.clear();
            block.extend(records.iter().zip(&attributes).map(|(s, f)| Sample {
                normal: f.normal,
                radius: if s.radius > 0.0 { s.radius } else { f.radius },
                ..*s
            }));
            out.push(&block)
        })?;
        out.finish()
    }

    /// Median spacing: that of a thin subset, times what thinning made it larger by on a surface.
    fn spacing(&self, samples: &Spool<Sample>, region: &Region) -> Result<f32> {
        const SUBSET: u64 = 4096;
        let n = samples.count();
        let step = n.div_ceil(SUBSET).max(1);
        let mut one = [Sample::zeroed()];
        let mut points = Vec::new();
        for i in (0..n).step_by(step as usize) {
            samples.read(i, &mut one)?;
            points.push(region.unit(one[0].position));
        }
        Ok(select::density(&points, &points) * region.extent() / (step as f32).sqrt())
    }

    fn cell(&self, cell: Cell, margin: f32, facing: &Facing, found: &Spool<Found>, depth: u32) -> Result<()> {
        let n = cell.points.count();
        let room = self.options.memory.saturating_sub(16 * BUFFER as u64);
        let cut = cell.all.cut().filter(|_| n.saturating_mul(WORKING) > room && depth < 64);
        let Some(cut) = cut else { return self.complete_cell(&cell, facing, found) };
        let mut writers = [self.folder.writer()?, self.folder.writer()?];
        let mut regions = [Region::EMPTY; 2];
        let mut buffers: [Vec<Numbered>; 2] = Default::default();
        cell.points.each(|_, points| {
            for point in points {
                let off = point.position[cut.axis] - cut.plane;
                for (side, near) in [off < margin, off >= -margin].into_iter().enumerate() {
                    if near {
                        regions[side].add(point.position);
                        buffers[side].push(*point);
                    }
                }
            }
            for (writer, buffer) in writers.iter_mut().zip(&mut buffers) {
                writer.push(buffer)?;
                buffer.clear();
            }
            Ok(())
        })?;
        let (all, own) = (cell.all.extent(), cell.own);
        drop((cell, buffers));
        let [first, second] = writers;
        let parts = [first.finish()?, second.finish()?];
        for (side, points) in parts.into_iter().enumerate() {
            let mut own = own;
            let end = if side == 0 { &mut own.high } else { &mut own.low };
            end[cut.axis] = cut.plane;
            // A margin as wide as the cell would never end.
            let margin = margin.min(0.05 * all);
            self.cell(Cell { points, own, all: regions[side] }, margin, facing, found, depth + 1)?;
        }
        Ok(())
    }

    fn complete_cell(&self, cell: &Cell, facing: &Facing, found: &Spool<Found>) -> Result<()> {
        let points = cell.points.load()?;
        let mut cloud = PointCloud {
            positions: points.iter().map(|p| p.position.into()).collect(),
            up: facing.up,
            viewpoint: facing.scanner,
            ..PointCloud::default()
        };
        attributes::complete(&mut cloud, &attributes::Options::default());
        let (normals, radii) = (cloud.normals.unwrap_or_default(), cloud.radii.unwrap_or_default());
        let own = |p: [f32; 3]| {
            let p = Vec3::from(p);
            p.cmpge(cell.own.low).all() && p.cmplt(cell.own.high).all()
        };
        // Runs that follow each other in the input are put down together.
        let mut run: Vec<Found> = Vec::new();
        let mut first = 0;
        let mut done = 0;
        for (point, (normal, radius)) in points.iter().zip(normals.iter().zip(&radii)) {
            if !own(point.position) {
                continue;
            }
            if point.number() != first + run.len() as u64 || run.len() == BUFFER / size_of::<Found>() {
                found.put(first, &run)?;
                run.clear();
                first = point.number();
            }
            run.push(Found { normal: octahedral::encode(*normal), radius: *radius });
            done += 1;
        }
        found.put(first, &run)?;
        let done = self.done.fetch_add(done, Ordering::Relaxed) + done;
        self.options.report("normals and radii", done, self.total);
        Ok(())
    }
}
