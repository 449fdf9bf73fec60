//! What a file says of its scans: the crate `e57` reads the description, and here it is checked and put in order.

use std::io::{Read, Seek};
use std::path::Path;

use e57::{E57Reader, PointCloud, RecordDataType, RecordName, RecordValue};
use glam::{DQuat, DVec3};

use super::packets::{Field, Kind};
use super::pages::{Header, Pages};
use super::xml;
use crate::error::{Error, Place, Result};

/// Points that are believed of scans all of whose fields are constant, so that no byte of the file stands for them.
const ANYWAY: u64 = 1 << 20;

/// Least and greatest value of a scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    pub(super) min: f64,
    pub(super) max: f64,
}

impl Range {
    fn new(min: f64, max: f64) -> Option<Range> {
        // Beyond that the limits are those of the type, written for want of better ones.
        (min.is_finite() && max > min && max - min < 1e12).then_some(Range { min, max })
    }

    /// 0 at the least value, 1 at the greatest.
    pub(super) fn share(&self, v: f64) -> f64 {
        (v - self.min) / (self.max - self.min)
    }
}

/// Where the limits of colours are from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Limits {
    /// The scan says so, for each channel.
    Told([Range; 3]),
    /// From the type of the fields, which may be wider than what was written.
    Type([Range; 3]),
    /// There are none.
    Unknown,
}

/// One scan of a file. Places are indices into `fields`.
pub(super) struct Scan {
    pub(super) points: u64,
    /// Physical offset of its binary section.
    pub(super) section: u64,
    pub(super) fields: Vec<Field>,
    pub(super) cartesian: Option<[usize; 3]>,
    pub(super) cartesian_state: Option<usize>,
    /// Range, azimuth, elevation.
    pub(super) spherical: Option<[usize; 3]>,
    pub(super) spherical_state: Option<usize>,
    pub(super) normal: Option<[usize; 3]>,
    pub(super) color: Option<[usize; 3]>,
    pub(super) color_state: Option<usize>,
    pub(super) color_limits: Limits,
    pub(super) intensity: Option<usize>,
    pub(super) intensity_state: Option<usize>,
    pub(super) intensity_limits: Option<Range>,
    /// Row and column.
    pub(super) grid: Option<[usize; 2]>,
    /// From the scan's own frame to the file's: rotation, then translation.
    pub(super) rotation: DQuat,
    pub(super) translation: DVec3,
    /// Whether the scan's own origin is a scanner's place: it has a pose, a grid or spherical coordinates.
    pub(super) has_scanner: bool,
    /// Angular step \[rad\] by its bounds and the number of rows and columns.
    pub(super) step_of_bounds: Option<f64>,
    /// Coordinates are f32 that no pose moves.
    pub(super) narrow: bool,
}

impl Scan {
    /// Whether anything is made of a field.
    pub(super) fn wants(&self, field: usize) -> bool {
        let three = [self.cartesian, self.spherical, self.normal, self.color];
        let states = [self.cartesian_state, self.spherical_state, self.color_state, self.intensity_state];
        three.iter().flatten().any(|t| t.contains(&field))
            || states.iter().chain([&self.intensity]).flatten().any(|i| *i == field)
            || self.grid.is_some_and(|g| g.contains(&field))
    }
}

/// All scans that have points, and sentences for the report.
pub(super) fn scans<S: Read + Seek>(header: &Header, pages: &mut Pages<S>) -> Result<(Vec<Scan>, Vec<String>)> {
    let file = pages.file().to_owned();
    let (offset, length) = header.xml;
    pages.seek_physical(offset, "the description (XML)")?;
    let fail = |why: String| Error::data(&file, Place::Byte(offset), format!("the description (XML) {why}"));
    if length > pages.len() - pages.at() {
        return Err(fail(format!("is said to have {length} bytes, which are not there")));
    }
    let mut text = vec![0; length as usize];
    pages.read(&mut text)?;
    xml::check(&text).map_err(|why| fail(why.into()))?;
    drop(text);
    let io = |e| Error::io(&file, e);
    pages.source().rewind().map_err(io)?;
    let reader = E57Reader::new(pages.source()).map_err(|e| fail(format!("is not understood: {}", chain(&e))))?;
    let described = reader.pointclouds();
    if described.is_empty() {
        return Err(Error::data(&file, Place::File, "there is no scan in the file"));
    }
    drop(reader);
    let mut said = Vec::new();
    let mut scans = Vec::new();
    for (number, described) in described.iter().enumerate().filter(|(_, d)| d.records > 0) {
        let scan =
            scan(described, &mut said).map_err(|why| Error::data(&file, Place::Element("scan", number as u64), why));
        scans.push(scan?);
    }
    room(&file, &scans, pages.len())?;
    Ok((scans, said))
}

/// The points that are claimed must fit the file, all scans' together: several may not claim the same bytes.
fn room(file: &Path, scans: &[Scan], bytes: u64) -> Result<()> {
    let bits = |s: &Scan| u128::from(s.points) * s.fields.iter().map(|f| u128::from(f.bits)).sum::<u128>();
    let free: u64 = scans.iter().filter(|s| bits(s) == 0).map(|s| s.points).fold(0, u64::saturating_add);
    if scans.iter().map(bits).sum::<u128>() > u128::from(bytes) * 8 || free > ANYWAY {
        let points = scans.iter().map(|s| s.points).fold(0, u64::saturating_add);
        return Err(Error::data(file, Place::File, format!("{points} points cannot be in {bytes} bytes")));
    }
    Ok(())
}

/// An error and what it stands for, in one line.
fn chain(error: &e57::Error) -> String {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(e) = cause {
        text += &format!(": {e}");
        cause = e.source();
    }
    text
}

fn scan(described: &PointCloud, said: &mut Vec<String>) -> Result<Scan, String> {
    let prototype = &described.prototype;
    let find = |name: RecordName| prototype.iter().position(|r| r.name == name);
    let extension = |wanted: &str| {
        prototype.iter().position(|r| matches!(&r.name, RecordName::Unknown { name, .. } if name == wanted))
    };
    let three = |names: [Option<usize>; 3]| match names {
        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
        _ => None,
    };
    use RecordName as N;
    let cartesian = three([find(N::CartesianX), find(N::CartesianY), find(N::CartesianZ)]);
    let spherical = three([find(N::SphericalRange), find(N::SphericalAzimuth), find(N::SphericalElevation)]);
    if cartesian.is_none() && spherical.is_none() {
        return Err("the points have neither cartesian nor spherical coordinates".into());
    }
    let color = three([find(N::ColorRed), find(N::ColorGreen), find(N::ColorBlue)]);
    let intensity = find(N::Intensity);
    let grid = find(N::RowIndex).zip(find(N::ColumnIndex)).map(|(r, c)| [r, c]);
    let normal = three([extension("normalX"), extension("normalY"), extension("normalZ")]);
    let unused: Vec<&str> = prototype
        .iter()
        .filter_map(|r| match &r.name {
            N::Unknown { name, .. } => Some(name.as_str()).filter(|n| normal.is_none() || !n.starts_with("normal")),
            N::ReturnCount => Some("returnCount"),
            N::ReturnIndex => Some("returnIndex"),
            N::TimeStamp => Some("timeStamp"),
            _ => None,
        })
        .take(12)
        .collect();
    if !unused.is_empty() {
        said.push(format!("fields not used: {}", unused.join(", ")));
    }
    let (rotation, translation) = pose(described, said)?;
    let moved = rotation != DQuat::IDENTITY || translation != DVec3::ZERO;
    let is_single = |i: &usize| matches!(prototype[*i].data_type, RecordDataType::Single { .. });
    Ok(Scan {
        points: described.records,
        section: described.file_offset,
        fields: prototype.iter().map(|r| field(&r.data_type)).collect::<Result<_, _>>()?,
        cartesian,
        cartesian_state: find(N::CartesianInvalidState),
        spherical,
        spherical_state: find(N::SphericalInvalidState),
        normal,
        color,
        color_state: find(N::IsColorInvalid),
        color_limits: color.map_or(Limits::Unknown, |c| color_limits(described, c)),
        intensity,
        intensity_state: find(N::IsIntensityInvalid),
        intensity_limits: intensity.and_then(|i| intensity_limits(described, &prototype[i].data_type)),
        grid,
        rotation,
        translation,
        has_scanner: moved || grid.is_some() || spherical.is_some(),
        step_of_bounds: step_of_bounds(described),
        narrow: !moved && cartesian.is_some_and(|c| c.iter().all(is_single)),
    })
}

fn field(ty: &RecordDataType) -> Result<Field, String> {
    let bits = |min: i64, max: i64| (i128::from(max) - i128::from(min)).checked_ilog2().map_or(0, |b| b + 1);
    Ok(match *ty {
        RecordDataType::Single { .. } => Field { bits: 32, kind: Kind::Single },
        RecordDataType::Double { .. } => Field { bits: 64, kind: Kind::Double },
        RecordDataType::Integer { min, max } => {
            Field { bits: bits(min, max), kind: Kind::Integer { min, scale: 1.0, offset: 0.0 } }
        }
        RecordDataType::ScaledInteger { min, max, scale, offset } => {
            if scale == 0.0 || !scale.is_finite() || !offset.is_finite() {
                return Err("a scale is zero, or a scale or an offset is not finite".into());
            }
            Field { bits: bits(min, max), kind: Kind::Integer { min, scale, offset } }
        }
    })
}

fn pose(described: &PointCloud, said: &mut Vec<String>) -> Result<(DQuat, DVec3), String> {
    let Some(pose) = &described.transform else { return Ok((DQuat::IDENTITY, DVec3::ZERO)) };
    let (q, t) = (&pose.rotation, &pose.translation);
    let (q, t) = (DQuat::from_xyzw(q.x, q.y, q.z, q.w), DVec3::new(t.x, t.y, t.z));
    let length = q.length();
    if !length.is_finite() || !t.is_finite() {
        return Err("its pose is not finite".into());
    }
    if length == 0.0 {
        said.push("a pose has a rotation of length zero: taken as none".into());
        return Ok((DQuat::IDENTITY, t));
    }
    // What is written as 1 0 0 0 stays that, bit for bit.
    Ok((if q == DQuat::IDENTITY { q } else { q / length }, t))
}

fn color_limits(described: &PointCloud, fields: [usize; 3]) -> Limits {
    let types = fields.map(|i| &described.prototype[i].data_type);
    let ranges = |r: [Option<Range>; 3]| match r {
        [Some(r), Some(g), Some(b)] => Some([r, g, b]),
        _ => None,
    };
    let told = described.color_limits.as_ref().and_then(|l| {
        ranges([
            limits(&l.red_min, &l.red_max, types[0]),
            limits(&l.green_min, &l.green_max, types[1]),
            limits(&l.blue_min, &l.blue_max, types[2]),
        ])
    });
    told.map_or_else(|| ranges(types.map(of_type)).map_or(Limits::Unknown, Limits::Type), Limits::Told)
}

fn intensity_limits(described: &PointCloud, ty: &RecordDataType) -> Option<Range> {
    let told = described.intensity_limits.as_ref();
    told.and_then(|l| limits(&l.intensity_min, &l.intensity_max, ty)).or_else(|| of_type(ty))
}

/// Limits that are told, in the unit of the field's values.
fn limits(min: &Option<RecordValue>, max: &Option<RecordValue>, ty: &RecordDataType) -> Option<Range> {
    let value = |v: &RecordValue| match (v, ty) {
        (RecordValue::ScaledInteger(i), RecordDataType::ScaledInteger { scale, offset, .. }) => {
            *i as f64 * scale + offset
        }
        (RecordValue::Integer(i) | RecordValue::ScaledInteger(i), _) => *i as f64,
        (RecordValue::Single(v), _) => f64::from(*v),
        (RecordValue::Double(v), _) => *v,
    };
    Range::new(value(min.as_ref()?), value(max.as_ref()?))
}

/// The values that a type can hold.
fn of_type(ty: &RecordDataType) -> Option<Range> {
    match *ty {
        RecordDataType::Single { min, max } => Range::new(min?.into(), max?.into()),
        RecordDataType::Double { min, max } => Range::new(min?, max?),
        RecordDataType::Integer { min, max } => Range::new(min as f64, max as f64),
        RecordDataType::ScaledInteger { min, max, scale, offset } => {
            Range::new(min as f64 * scale + offset, max as f64 * scale + offset)
        }
    }
}

/// The wider of the steps between columns and between rows, by what the scan says of its field of view.
fn step_of_bounds(described: &PointCloud) -> Option<f64> {
    let (angles, counts) = (described.spherical_bounds.as_ref()?, described.index_bounds.as_ref()?);
    let step = |from: Option<f64>, to: Option<f64>, first: Option<i64>, last: Option<i64>| {
        let (from, mut to, steps) = (from?, to?, last?.checked_sub(first?)?);
        if to < from {
            // The azimuth went through ±π.
            to += std::f64::consts::TAU;
        }
        Some((to - from) / steps as f64).filter(|s| steps > 0 && *s > 0.0)
    };
    let columns = step(angles.azimuth_start, angles.azimuth_end, counts.column_min, counts.column_max);
    let rows = step(angles.elevation_min, angles.elevation_max, counts.row_min, counts.row_max);
    Some(columns?.max(rows?))
}
