//! E57: all scans of a file in one cloud, each moved by its pose.
//!
//! The crate `e57` reads the description (XML), within bounds that are checked before; points are read here
//! ([`packets`]). Reading in full is reading in pieces and keeping them, so both give the same points.
//!
//! The description says where a scan's points begin and how many there are, but not where in the middle. A first walk over
//! the heads of the packets sees that all points are there and takes a sample, which decides the origin.

mod describe;
mod grid;
mod packets;
mod pages;
#[cfg(feature = "layered")]
mod pieces;
mod points;
mod xml;

use std::io::{Read, Seek};
use std::path::Path;

use glam::{DVec3, Vec3};

use super::{Options, PointCloud, Report, Source, clean};
use crate::error::{Error, Place, Result};
use describe::{Limits, Scan};
use grid::Grid;
use packets::{Columns, Cursor};
use pages::Pages;
#[cfg(feature = "layered")]
pub(super) use pieces::pieces;
use points::Plan;

/// Points of one piece.
const PIECE: u64 = 1 << 16;
/// Places of the file that the sample is taken from.
const PLACES: u64 = 16;
/// Points of a scan whose neighbours in its grid are looked at, about.
const LOOKED_AT: u64 = 1 << 22;

pub(super) fn read(file: &Path, source: &mut dyn Source, options: &Options) -> Result<PointCloud> {
    let (mut scans, mut cloud) = Scans::open(file, source, u64::MAX)?;
    let total = cloud.report.points_in_file;
    options.report(0, total);
    while let Some(mut piece) = scans.next(&mut cloud.report, true)? {
        cloud.positions.append(&mut piece.positions);
        append(&mut cloud.normals, piece.normals);
        append(&mut cloud.colors, piece.colors);
        append(&mut cloud.intensity, piece.intensity);
        options.report(scans.done, total);
    }
    cloud.angular_step = grid::agreed(&scans.steps).map(|step| step as f32);
    options.report(total, total);
    super::finish(cloud, file)
}

fn append<T>(to: &mut Option<Vec<T>>, from: Option<Vec<T>>) {
    if let Some(mut from) = from {
        to.get_or_insert_default().append(&mut from);
    }
}

/// The scans of a file, read one after the other.
struct Scans<S> {
    pages: Pages<S>,
    scans: Vec<Scan>,
    plan: Plan,
    /// The scan that is being read.
    at: usize,
    cursor: Option<Cursor>,
    /// Points that were read, of all scans.
    done: u64,
    backlog: u64,
    grid: Grid,
    /// Angular steps \[rad\] of the scans that were read in full.
    steps: Vec<Option<f64>>,
}

impl<S: Read + Seek> Scans<S> {
    /// Reads the description and takes a sample. The cloud has no points yet, but all that is known before them.
    fn open(file: &Path, source: S, backlog: u64) -> Result<(Scans<S>, PointCloud)> {
        let (header, mut pages) = Pages::open(file, source)?;
        let (scans, said) = describe::scans(&header, &mut pages)?;
        if scans.is_empty() {
            return Err(Error::data(file, Place::File, "no point left: 0 in the file"));
        }
        let total = scans.iter().map(|s| s.points).sum();
        let mut cloud = PointCloud { up: Some(Vec3::Z), ..Default::default() };
        let report = &mut cloud.report;
        report.format = if scans.len() == 1 { "E57".into() } else { format!("E57, {} scans", scans.len()) };
        report.points_in_file = total;
        said.into_iter().for_each(|line| report.assume(line));
        let plan = plan(&mut pages, &scans, total, report)?;
        cloud.origin = plan.origin;
        cloud.viewpoint = viewpoint(&scans, report);
        let (grid, steps) = (Grid::default(), Vec::new());
        let scans = Scans { pages, scans, plan, at: 0, cursor: None, done: 0, backlog, grid, steps };
        Ok((scans, cloud))
    }

    /// The next piece; `None` at the end. `looks` says that the angular step is wanted.
    fn next(&mut self, report: &mut Report, looks: bool) -> Result<Option<PointCloud>> {
        while let Some(scan) = self.scans.get(self.at) {
            let cursor = match &mut self.cursor {
                Some(cursor) => cursor,
                none => none.insert(Cursor::new(&mut self.pages, scan, self.backlog)?),
            };
            let before = cursor.done();
            if let Some(columns) = cursor.next(&mut self.pages, scan, PIECE)? {
                self.done += cursor.done() - before;
                // Every so many pieces of a large scan.
                let looks = looks && (before / PIECE).is_multiple_of(scan.points.div_ceil(LOOKED_AT));
                let grid = looks.then_some(&mut self.grid);
                return Ok(Some(points::piece(scan, &columns, &self.plan, report, grid)));
            }
            let of_grid = std::mem::take(&mut self.grid).step();
            self.steps.push(of_grid.or_else(|| scan.step_of_bounds.and_then(grid::usable)));
            self.at += 1;
            self.cursor = None;
        }
        Ok(None)
    }
}

/// Walks over all scans for what must be known before the first piece.
fn plan<S: Read + Seek>(pages: &mut Pages<S>, scans: &[Scan], total: u64, report: &mut Report) -> Result<Plan> {
    // So many points that each place of the sample stands for, and that are taken there.
    let (every, many) = (total.div_ceil(PLACES), clean::SAMPLE as u64 / PLACES);
    let mut sample: Vec<DVec3> = Vec::new();
    let mut highest: f64 = 0.0;
    let mut before = 0;
    let mut look = |scan: &Scan, columns: &Columns| {
        sample.extend(points::places(scan, columns));
        if !matches!(scan.color_limits, Limits::Told(_)) {
            highest = highest.max(points::highest(scan, columns));
        }
    };
    let mut looked = false;
    for scan in scans {
        let wanted = |first: u64, end: u64| many * ((before + end).div_ceil(every) - (before + first).div_ceil(every));
        packets::survey(pages, scan, wanted, |columns| {
            look(scan, columns);
            looked = true;
        })?;
        before += scan.points;
    }
    // Of a few points some values may lie in a packet of their own: then no packet holds a whole point.
    for scan in scans.iter().take(if looked { 0 } else { PLACES as usize }) {
        if let Some(columns) = Cursor::new(pages, scan, u64::MAX)?.next(pages, scan, clean::SAMPLE as u64)? {
            look(scan, &columns);
        }
    }
    let narrow = scans.iter().all(|s| s.narrow);
    let origin = match sample.is_empty() {
        true => scans.first().map_or(DVec3::ZERO, |s| s.translation),
        false => clean::origin(&sample, narrow),
    };
    let share = |has: &dyn Fn(&Scan) -> bool| (scans.iter().any(has), scans.iter().all(has));
    let mut some = |(any, all): (bool, bool), what: &str| {
        if any && !all {
            report.assume(format!("only some scans have {what}"));
        }
        any
    };
    Ok(Plan {
        origin,
        normals: some(share(&|s| s.normal.is_some()), "normals: the others face the viewer"),
        colors: some(share(&|s| s.color.is_some()), "colours: the others are grey"),
        intensity: some(share(&|s| s.intensity.is_some()), "intensities: the others get 0"),
        full: full_scale(scans, highest, report),
    })
}

/// Full strength of colours whose limits are not told, by the greatest value in the sample; `None`: as their type says.
fn full_scale(scans: &[Scan], highest: f64, report: &mut Report) -> Option<f64> {
    let colored = scans.iter().filter(|s| s.color.is_some());
    let untold: Vec<Limits> = colored.map(|s| s.color_limits).filter(|l| !matches!(l, Limits::Told(_))).collect();
    let wide = |l: &Limits| matches!(l, Limits::Type(ranges) if ranges.iter().any(|r| r.max > 255.0));
    if untold.iter().any(wide) && highest > 0.0 && highest <= 255.0 {
        report.assume("colours have more than 8 bits but none in a sample is above 255: taken as 8 bits");
        return Some(255.0);
    }
    if untold.contains(&Limits::Unknown) {
        let full = if highest <= 1.0 { 1.0 } else { 255.0 };
        report.assume(format!("the limits of colours are not told: taken as 0 to {full}"));
        return Some(full);
    }
    None
}

/// Where the scanner stood, if that is one place.
fn viewpoint(scans: &[Scan], report: &mut Report) -> Option<DVec3> {
    let mut places = scans.iter().filter(|s| s.has_scanner).map(|s| s.translation);
    let first = places.next()?;
    if places.all(|p| p == first) {
        return Some(first);
    }
    report.assume("the scans were taken from different places: no viewpoint is kept");
    None
}
