//! E57 files that tests write with the crate `e57`, whose reader is not the one that is tested.

use std::io::Cursor;
use std::path::Path;

use e57::{
    ColorLimits, E57Writer, Extension, IntensityLimits, Quaternion, RawValues, Record, RecordDataType, RecordName,
    RecordValue, Transform, Translation,
};
use glam::{DQuat, DVec3};
use surfel::Error;
use surfel::load::{self, Options, PointCloud};

use crate::load_files::check_promises;

pub const DOUBLE: RecordDataType = RecordDataType::F64;

/// What one scan of a file is made of.
#[derive(Clone, Default)]
pub struct Scan {
    pub fields: Vec<Record>,
    pub points: Vec<RawValues>,
    pub pose: Option<(DQuat, DVec3)>,
    pub color_limits: Option<[i64; 2]>,
    pub intensity_limits: Option<[f64; 2]>,
    /// Azimuth of the first and the last column, elevation of the first and the last row, columns, rows.
    pub bounds: Option<([f64; 2], [f64; 2], [i64; 2])>,
}

pub fn field(name: RecordName, data_type: RecordDataType) -> Record {
    Record { name, data_type }
}

pub fn extension(name: &str) -> RecordName {
    RecordName::Unknown { namespace: "nor".into(), name: name.into() }
}

/// Cartesian coordinates.
pub fn xyz(ty: &RecordDataType) -> Vec<Record> {
    [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ].map(|n| field(n, ty.clone())).into()
}

/// Range, azimuth, elevation.
pub fn spherical(ty: &RecordDataType) -> Vec<Record> {
    [RecordName::SphericalRange, RecordName::SphericalAzimuth, RecordName::SphericalElevation]
        .map(|n| field(n, ty.clone()))
        .into()
}

pub fn integers(min: i64, max: i64) -> RecordDataType {
    RecordDataType::Integer { min, max }
}

pub fn doubles(v: [f64; 3]) -> RawValues {
    v.map(RecordValue::Double).into()
}

/// Points at these places, nothing else.
pub fn bare(points: &[DVec3]) -> Scan {
    let points = points.iter().map(|p| doubles(p.to_array())).collect();
    Scan { fields: xyz(&DOUBLE), points, ..Default::default() }
}

pub fn file(scans: &[Scan]) -> Vec<u8> {
    edited(scans, |xml| xml)
}

/// A file whose description is changed before it is written; its checksums are right.
pub fn edited(scans: &[Scan], edit: impl Fn(String) -> String) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "file").unwrap();
    writer.register_extension(Extension::new("nor", "http://www.libe57.org/E57_NOR_surface_normals.txt")).unwrap();
    for scan in scans {
        let mut cloud = writer.add_pointcloud("scan", scan.fields.clone()).unwrap();
        cloud.set_transform(scan.pose.map(|(q, t)| Transform {
            rotation: Quaternion { w: q.w, x: q.x, y: q.y, z: q.z },
            translation: Translation { x: t.x, y: t.y, z: t.z },
        }));
        let integer = |v| Some(RecordValue::Integer(v));
        cloud.set_color_limits(scan.color_limits.map(|[min, max]| ColorLimits {
            red_min: integer(min),
            red_max: integer(max),
            green_min: integer(min),
            green_max: integer(max),
            blue_min: integer(min),
            blue_max: integer(max),
        }));
        let double = |v| Some(RecordValue::Double(v));
        cloud.set_intensity_limits(
            scan.intensity_limits
                .map(|[min, max]| IntensityLimits { intensity_min: double(min), intensity_max: double(max) }),
        );
        for point in &scan.points {
            cloud.add_point(point.clone()).unwrap();
        }
        if let Some((azimuth, elevation, [columns, rows])) = scan.bounds {
            cloud.set_spherical_bounds(Some(e57::SphericalBounds {
                azimuth_start: Some(azimuth[0]),
                azimuth_end: Some(azimuth[1]),
                elevation_min: Some(elevation[0]),
                elevation_max: Some(elevation[1]),
                ..Default::default()
            }));
            cloud.set_index_bounds(Some(e57::IndexBounds {
                column_min: Some(0),
                column_max: Some(columns - 1),
                row_min: Some(0),
                row_max: Some(rows - 1),
                ..Default::default()
            }));
        }
        cloud.finalize().unwrap();
    }
    writer.finalize_customized_xml(|xml| Ok(edit(xml))).unwrap();
    drop(writer);
    bytes.into_inner()
}

pub fn read(bytes: &[u8]) -> Result<PointCloud, Error> {
    let cloud = load::read(Path::new("test.e57"), bytes, &Options::default());
    if let Ok(cloud) = &cloud {
        check_promises(cloud);
    }
    cloud
}

/// Makes the checksums of all pages right.
pub fn sign(bytes: &mut [u8]) {
    for page in bytes.chunks_exact_mut(1024) {
        let (content, sum) = page.split_at_mut(1020);
        let mut crc = !0u32;
        for byte in content {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = if crc & 1 == 1 { crc >> 1 ^ 0x82f6_3b78 } else { crc >> 1 };
            }
        }
        sum.copy_from_slice(&(!crc).to_be_bytes());
    }
}
