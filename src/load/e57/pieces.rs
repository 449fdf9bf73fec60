//! E57 in pieces.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::Scans;
use crate::error::Result;
use crate::load::pieces::{Reader, Start};
use crate::load::{PointCloud, Report};

/// Most bytes that wait for others of their points: beyond every writer's habit.
const BACKLOG: u64 = 64 << 20;

/// All files are read in pieces.
pub(in crate::load) fn pieces(file: &Path, source: BufReader<File>) -> Result<Option<(Start, Box<dyn Reader>)>> {
    let (scans, cloud) = Scans::open(file, source, BACKLOG)?;
    let PointCloud { origin, up, viewpoint, report, .. } = cloud;
    let Report { format, points_in_file: points, assumed, .. } = report;
    let start = Start { origin, lattice: None, points, up, viewpoint, format, assumed };
    Ok(Some((start, Box::new(scans))))
}

impl Reader for Scans<BufReader<File>> {
    fn next(&mut self, report: &mut Report) -> Result<Option<PointCloud>> {
        Scans::next(self, report, false)
    }
}
