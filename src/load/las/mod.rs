//! LAS and LAZ, COPC included: a COPC file is LAZ with an index beside it, and is read from front to back like any other.
//!
//! The crate `las` reads the header and `laz` decodes the points, but neither is trusted with a count: their readers
//! follow the number of variable-length records for minutes if it is garbage and reserve what a header claims. So the
//! records are walked here within their bounds, chunks are found here, and memory grows as points come out.

mod header;
mod laszip;
mod points;

use std::io::SeekFrom;
use std::path::Path;

use glam::{DVec3, Vec3};

use super::{Options, PointCloud, Source, clean};
use crate::error::{Error, Place, Result};
use crate::par;
use header::Header;
use points::Points;

/// Records decoded as one task.
const BLOCK: u64 = 1 << 16;

pub(super) fn read(file: &Path, source: &mut dyn Source, options: &Options) -> Result<PointCloud> {
    let header = header::read(file, source)?;
    options.report(0, header.points);
    let mut points = Points::default();
    let compressed = match header.is_compressed {
        true => Some(laszip::read(file, source, &header, &mut points, options)?),
        false => {
            plain(file, source, &header, &mut points, options)?;
            None
        }
    };
    let mut cloud = cloud(file, &header, points)?;
    let kind = if compressed.is_some() { "LAZ" } else { "LAS" };
    cloud.report.format = format!("{kind} {}.{} format {}", header.version.0, header.version.1, header.format);
    options.report(header.points, header.points);
    super::finish(cloud, file)
}

/// Uncompressed records, a few blocks at a time.
fn plain(file: &Path, source: &mut dyn Source, header: &Header, out: &mut Points, options: &Options) -> Result<()> {
    let length = u64::from(header.layout.length);
    let whole = (header.file_bytes - header.first_point) / length;
    if whole < header.points {
        let why = format!("the file ends here; the header promises {}", header.points);
        return Err(Error::data(file, Place::Element("point", whole), why));
    }
    source.seek(SeekFrom::Start(header.first_point)).map_err(|e| Error::io(file, e))?;
    out.reserve(header.points);
    let mut buffer = Vec::new();
    let mut done = 0;
    while done < header.points {
        let n = (header.points - done).min(BLOCK * par::width() as u64);
        buffer.resize((n * length) as usize, 0);
        source.read_exact(&mut buffer).map_err(|e| Error::io(file, e))?;
        let blocks: Vec<&[u8]> = buffer.chunks((BLOCK * length) as usize).collect();
        for block in par::map(&blocks, |bytes| points::decode(bytes, &header.layout)) {
            out.push(block);
        }
        done += n;
        options.report(done, header.points);
    }
    Ok(())
}

/// Integers become offsets: the origin is an integer place too, so the difference is exact before the only rounding.
fn cloud(file: &Path, header: &Header, points: Points) -> Result<PointCloud> {
    let mut cloud = PointCloud { up: Some(Vec3::Z), ..Default::default() };
    let report = &mut cloud.report;
    report.points_in_file = header.points;
    report.drop("points flagged as withheld", points.withheld);
    if points.synthetic > 0 {
        report.assume(format!("{} points flagged as synthetic are kept", points.synthetic));
    }
    let scale = DVec3::from_array(header.scale);
    let middle = [0, 1, 2].map(|axis| {
        let mut values: Vec<i64> = clean::sample(points.xyz.len()).map(|i| points.xyz[i][axis].into()).collect();
        clean::core_range(&mut values, i64::cmp).map_or(0, |(low, high)| (low + high) / 2)
    });
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
