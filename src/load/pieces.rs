//! Points in pieces: inputs that are larger than memory.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use glam::{DVec3, Vec3};

#[cfg(any(feature = "las", feature = "ply", feature = "e57"))]
use super::Kind;
use super::attributes;
use super::synthetic::{self, Deep};
use super::{MAGIC_BYTES, Options, PointCloud, Report, open, recognise};
use crate::error::{Error, Result};

/// What delivers the pieces of one kind of file.
pub(super) trait Reader: Send {
    /// The next points, about a million at most; `None` at the end. All with the same origin.
    fn next(&mut self, report: &mut Report) -> Result<Option<PointCloud>>;
}

/// One input, read piece by piece.
///
/// In bounded memory, a few tens of MiB: LAS, LAZ in chunks (all but those of the oldest kind, which are one stream), E57,
/// and binary PLY whose vertices have positions of numbers, and normals where the file has faces. Everything else is read in
/// full first, as [`open`] does, and its faces then give normals and radii.
///
/// Two things that [`open`] finds in all points are found here in a sample of them, at sixteen places of the file: the
/// origin, and whether 16-bit colours hold 8 bits. Of E57 both take the sample, and give the same points bit for bit.
pub struct Pieces {
    origin: DVec3,
    lattice: Option<DVec3>,
    points: u64,
    up: Option<Vec3>,
    viewpoint: Option<DVec3>,
    closed: bool,
    report: Report,
    reader: Box<dyn Reader>,
}

impl std::fmt::Debug for Pieces {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pieces").field("format", &self.report.format).field("points", &self.points).finish()
    }
}

/// What is known before the first piece.
#[derive(Default)]
pub(super) struct Start {
    pub origin: DVec3,
    pub lattice: Option<DVec3>,
    pub points: u64,
    pub up: Option<Vec3>,
    pub viewpoint: Option<DVec3>,
    pub format: String,
    pub assumed: Vec<String>,
}

/// A cloud that is there already.
struct Whole(Option<PointCloud>);

impl Reader for Whole {
    fn next(&mut self, _: &mut Report) -> Result<Option<PointCloud>> {
        Ok(self.0.take().filter(|cloud| !cloud.is_empty()))
    }
}

/// A scene that is made as it is read.
struct Made {
    town: Deep,
    at: u64,
    points: u64,
}

impl Reader for Made {
    fn next(&mut self, _: &mut Report) -> Result<Option<PointCloud>> {
        const PIECE: u64 = 1 << 16;
        let first = self.at;
        self.at = self.points.min(first + PIECE);
        Ok((first < self.at).then(|| self.town.points(first..self.at)))
    }
}

impl Pieces {
    /// A synthetic scene: the points of [`synthetic::scene`] in its order. `deep` is made piece by piece, whatever its size,
    /// the others at once.
    ///
    /// # Errors
    /// As [`synthetic::scene`].
    pub fn scene(name: &str, points: u64, seed: u64) -> Result<Pieces> {
        if name != "deep" || points == 0 {
            return Ok(Pieces::of(synthetic::scene(name, points as usize, seed)?));
        }
        let format = synthetic::format(name, seed);
        let viewpoint = Some(synthetic::EYE);
        let start = Start { points, up: Some(Vec3::Z), viewpoint, format, ..Start::default() };
        Ok(Pieces::new(start, Box::new(Made { town: Deep::new(points, seed), at: 0, points })))
    }

    /// Opens a file for reading in pieces. The content decides what it is, not the name.
    ///
    /// # Errors
    /// As [`open`]; what is wrong with points comes with the piece that they are in.
    pub fn open(path: &Path, options: &Options) -> Result<Pieces> {
        let mut file = BufReader::with_capacity(1 << 16, File::open(path).map_err(|e| Error::io(path, e))?);
        let regular = file.get_ref().metadata().is_ok_and(|m| m.is_file());
        let mut magic = Vec::new();
        if regular {
            let start = (&mut file).take(MAGIC_BYTES).read_to_end(&mut magic).and_then(|_| file.rewind());
            start.map_err(|e| Error::io(path, e))?;
            let parts = match recognise(path, &magic)? {
                #[cfg(feature = "las")]
                Kind::Las => super::las::pieces(path, file)?,
                #[cfg(feature = "ply")]
                Kind::Ply => super::ply::pieces(path, file)?,
                #[cfg(feature = "e57")]
                Kind::E57 => super::e57::pieces(path, file)?,
                #[cfg(not(all(feature = "las", feature = "ply", feature = "e57")))]
                _ => None,
            };
            if let Some((start, reader)) = parts {
                return Ok(Pieces::new(start, reader));
            }
        }
        let mut cloud = open(path, options)?;
        if cloud.mesh.is_some() {
            attributes::complete(&mut cloud, &attributes::Options::default());
        }
        Ok(Pieces::of(cloud))
    }

    fn new(start: Start, reader: Box<dyn Reader>) -> Pieces {
        let Start { origin, lattice, points, up, viewpoint, format, assumed } = start;
        let report = Report { format, points_in_file: points, assumed, ..Report::default() };
        Pieces { origin, lattice, points, up, viewpoint, closed: false, report, reader }
    }

    /// A cloud in memory as one piece.
    pub fn of(mut cloud: PointCloud) -> Pieces {
        cloud.mesh = None;
        Pieces {
            origin: cloud.origin,
            lattice: None,
            points: cloud.len() as u64,
            up: cloud.up,
            viewpoint: cloud.viewpoint,
            closed: cloud.closed,
            report: std::mem::take(&mut cloud.report),
            reader: Box::new(Whole(Some(cloud))),
        }
    }

    /// World position that all pieces are relative to.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Steps that offsets are whole multiples of along each axis, for formats of integers \[world units\].
    pub fn lattice(&self) -> Option<DVec3> {
        self.lattice
    }

    /// Points that the file says it holds.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// See [`PointCloud::up`].
    pub fn up(&self) -> Option<Vec3> {
        self.up
    }

    /// See [`PointCloud::viewpoint`].
    pub fn viewpoint(&self) -> Option<DVec3> {
        self.viewpoint
    }

    /// See [`PointCloud::closed`].
    pub fn closed(&self) -> bool {
        self.closed
    }

    /// What was dropped, repaired and assumed so far.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// The next points; `None` at the end. An attribute that a piece lacks is absent or zero in all of its points.
    ///
    /// # Errors
    /// As [`open`].
    pub fn piece(&mut self) -> Result<Option<PointCloud>> {
        self.reader.next(&mut self.report)
    }
}
