//! LAS and LAZ, COPC included: a COPC file is LAZ with an index beside it, and is read from front to back like any other.
//!
//! The crate `las` reads the header and `laz` decodes the points, but neither is trusted with a count: their readers
//! follow the number of variable-length records for minutes if it is garbage and reserve what a header claims. So the
//! records are walked here within their bounds, chunks are found here, and memory grows as points come out.

mod header;
mod laszip;
#[cfg(feature = "layered")]
mod pieces;
mod points;

use std::io::SeekFrom;
use std::path::Path;

use glam::{DVec3, Vec3};

use super::{Options, PointCloud, Source, clean};
use crate::error::{Error, Place, Result};
use crate::par;
use header::Header;
#[cfg(feature = "layered")]
pub(super) use pieces::pieces;
use points::{Block, Points};

/// Records decoded as one task.
const BLOCK: u64 = 1 << 16;

pub(super) fn read(file: &Path, source: &mut dyn Source, options: &Options) -> Result<PointCloud> {
    let header = header::read(file, source)?;
    options.report(0, header.points);
    let mut points = Points::default();
    match header.is_compressed {
        true => laszip::read(file, source, &header, &mut points, options)?,
        false => plain(file, source, &header, &mut points, options)?,
    }
    let samples: Vec<[i32; 3]> = clean::sample(points.xyz.len()).map(|i| points.xyz[i]).collect();
    let mut cloud = cloud(file, &header, points, middle(&samples))?;
    cloud.report.format = header.kind();
    options.report(header.points, header.points);
    super::finish(cloud, file)
}

/// Whether all uncompressed records are there.
fn complete(file: &Path, header: &Header) -> Result<()> {
    let whole = (header.file_bytes - header.first_point) / u64::from(header.layout.length);
    if whole < header.points {
        let why = format!("the file ends here; the header promises {}", header.points);
        return Err(Error::data(file, Place::Element("point", whole), why));
    }
    Ok(())
}

/// Uncompressed records, a few blocks at a time.
fn plain(file: &Path, source: &mut dyn Source, header: &Header, out: &mut Points, options: &Options) -> Result<()> {
    complete(file, header)?;
    out.reserve(header.points);
    let step = BLOCK * par::width() as u64;
    let mut done = 0;
    while done < header.points {
        let n = (header.points - done).min(step);
        records(file, source, header, done, n)?.into_iter().for_each(|block| out.push(block));
        done += n;
        options.report(done, header.points);
    }
    Ok(())
}

/// `n` uncompressed records from number `first` on.
fn records(file: &Path, source: &mut dyn Source, header: &Header, first: u64, n: u64) -> Result<Vec<Block>> {
    let length = u64::from(header.layout.length);
    let mut buffer = vec![0; (n * length) as usize];
    source.seek(SeekFrom::Start(header.first_point + first * length)).map_err(|e| Error::io(file, e))?;
    source.read_exact(&mut buffer).map_err(|e| Error::io(file, e))?;
    let blocks: Vec<&[u8]> = buffer.chunks((BLOCK * length) as usize).collect();
    Ok(par::map(&blocks, |bytes| points::decode(bytes, &header.layout)))
}

/// The middle of most of these.
fn middle(samples: &[[i32; 3]]) -> [i64; 3] {
    [0, 1, 2].map(|axis| {
        let mut values: Vec<i64> = samples.iter().map(|xyz| xyz[axis].into()).collect();
        clean::core_range(&mut values, i64::cmp).map_or(0, |(low, high)| (low + high) / 2)
    })
}

/// Integers become offsets: the origin, at `middle`, is an integer place too, so the difference is exact before the only
/// rounding.
fn cloud(file: &Path, header: &Header, points: Points, middle: [i64; 3]) -> Result<PointCloud> {
    let mut cloud = PointCloud { up: Some(Vec3::Z), ..Default::default() };
    let report = &mut cloud.report;
    report.points_in_file = header.points;
    report.drop("points flagged as withheld", points.withheld);
    if points.synthetic > 0 {
        report.assume(format!("{} points flagged as synthetic are kept", points.synthetic));
    }
    let scale = DVec3::from_array(header.scale);
    cloud.origin = DVec3::from_array(header.offset) + scale * DVec3::from_array(middle.map(|m| m as f64));
    if !cloud.origin.is_finite() {
        return Err(Error::data(
            file,
            Place::File,
            "the coordinates are beyond every number: scale or offset is wrong",
        ));
    }
    let offset = |xyz: [i32; 3]| {
        let steps = [0, 1, 2].map(|axis| (i64::from(xyz[axis]) - middle[axis]) as f64);
        (DVec3::from_array(steps) * scale).as_vec3()
    };
    // The same size and alignment: collected in place, without a second array.
    cloud.positions = points.xyz.into_iter().map(offset).collect();
    if points.any_color {
        if !points.wide_color {
            report.assume("colours have 16 bits but none is above 255: taken as 8 bits");
        }
        cloud.colors = Some(points.colors);
    } else if header.layout.color.is_some() {
        report.assume("all colours in the file are zero: taken as absent");
    } else {
        report.assume("the point format has no colours");
    }
    cloud.intensity = points.any_intensity.then_some(points.intensity);
    cloud.classes = points.any_class.then_some(points.classes);
    let keep: Vec<bool> = cloud.positions.iter().map(|p| p.is_finite()).collect();
    let far = keep.iter().filter(|k| !**k).count();
    if far > 0 {
        report.drop(clean::TOO_FAR, far as u64);
        clean::retain(&mut cloud, &keep);
    }
    Ok(cloud)
}
