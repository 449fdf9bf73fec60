//! E57: what is written comes back, where the specification says.

use std::f64::consts::{PI, TAU};

use e57::{RecordDataType, RecordName, RecordValue};
use glam::{DQuat, DVec3, Vec3, dvec3};
use proptest::prelude::*;
use surfel::load::{self, Options, Pieces, PointCloud};

use crate::common::data;
use crate::e57_files::*;
use crate::folder::Folder;

/// Far from zero, as surveys are.
const FAR: DVec3 = DVec3::new(515_368.25, 4_918_340.5, 2322.125);

fn turned(axis: DVec3, angle: f64) -> DQuat {
    DQuat::from_axis_angle(axis.normalize(), angle)
}

/// The rotation as the standard writes it out, without the library of the reader.
fn rotate(q: DQuat, v: DVec3) -> DVec3 {
    let u = dvec3(q.x, q.y, q.z);
    2.0 * u.dot(v) * u + (q.w * q.w - u.dot(u)) * v + 2.0 * q.w * u.cross(v)
}

/// Every point is where it was told, up to the rounding of an offset to f32 and of f64 near the place.
#[track_caller]
fn assert_places(cloud: &PointCloud, told: &[DVec3]) {
    assert_eq!(cloud.len(), told.len());
    for (i, told) in told.iter().enumerate() {
        let offset = (*told - cloud.origin).abs();
        // Half a step of f32 at the offset; the sums of rotation, translation and origin in f64, ten roundings at most.
        let bound = offset * 2f64.powi(-24) + (told.abs().max_element() + offset.max_element()) * 10.0 * f64::EPSILON;
        let off = (cloud.world(i) - *told).abs();
        assert!(off.cmple(bound).all(), "point {i} is off by {off}, allowed {bound}");
    }
}

fn noted(cloud: &PointCloud, words: &str) -> bool {
    cloud.report.assumed.iter().any(|l| l.contains(words))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn poses_are_applied_before_anything_is_rounded(
        scans in prop::collection::vec(
            (prop::collection::vec(prop::array::uniform3(-30.0..30.0f64), 1..400), prop::array::uniform3(-1.0..1.0f64), 0.1..3.0f64, prop::array::uniform3(-80.0..80.0f64)), 1..4),
    ) {
        let mut written = Vec::new();
        let mut told = Vec::new();
        for (points, axis, angle, shift) in &scans {
            let points: Vec<DVec3> = points.iter().map(|p| DVec3::from_array(*p)).collect();
            let (q, t) = (turned(DVec3::from_array(*axis) + DVec3::Z * 1.5, *angle), FAR + DVec3::from_array(*shift));
            told.extend(points.iter().map(|p| rotate(q, *p) + t));
            written.push(Scan { pose: Some((q, t)), ..bare(&points) });
        }
        let cloud = read(&file(&written)).unwrap();
        assert_places(&cloud, &told);
        prop_assert_eq!(cloud.up, Some(Vec3::Z));
        let here = (scans.len() == 1).then(|| FAR + DVec3::from_array(scans[0].3));
        prop_assert_eq!(cloud.viewpoint, here);
        prop_assert_eq!(noted(&cloud, "different places"), scans.len() > 1);
        // The origin is among the points: no bits are lost on the way to them.
        prop_assert!(cloud.origin.distance(FAR) < 300.0);
    }

    /// All widths of bits, whole bytes or not, over packets of 64 KiB.
    #[test]
    fn integers_of_any_width_come_back(width in 1u32..41, low in -1000i64..1000, scale in 0.001..0.1f64, n in 1usize..3000) {
        let max = low + (1i64 << width) - 1;
        let ty = RecordDataType::ScaledInteger { min: low, max, scale, offset: 0.25 };
        let raw = |i: usize, axis: u64| {
            let mixed = (i as u64 * 3 + axis + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            low + (mixed >> (64 - width)) as i64
        };
        let points = (0..n).map(|i| [0, 1, 2].map(|a| RecordValue::ScaledInteger(raw(i, a))).into()).collect();
        let told: Vec<DVec3> = (0..n).map(|i| DVec3::from_array([0, 1, 2].map(|a| raw(i, a) as f64 * scale + 0.25))).collect();
        let cloud = read(&file(&[Scan { fields: xyz(&ty), points, ..Default::default() }])).unwrap();
        assert_places(&cloud, &told);
        prop_assert_eq!(cloud.viewpoint, None, "nothing says that a scanner stood at zero");
    }
}

#[test]
fn singles_near_zero_stay_bit_for_bit() {
    let values: Vec<[f32; 3]> = (0..5000).map(|i| [i as f32 * 0.1, 1.0 / (1 + i) as f32, -0.3 * i as f32]).collect();
    let points = values.iter().map(|v| v.map(RecordValue::Single).into()).collect();
    let cloud = read(&file(&[Scan { fields: xyz(&RecordDataType::F32), points, ..Default::default() }])).unwrap();
    assert_eq!(cloud.origin, DVec3::ZERO);
    assert!(cloud.positions.iter().zip(&values).all(|(p, v)| p.to_array() == *v));
}

#[test]
fn spherical_coordinates_are_azimuth_about_z_and_elevation_above_the_plane() {
    let told: [([f64; 3], DVec3); 4] = [
        ([2.0, 0.0, 0.0], dvec3(2.0, 0.0, 0.0)),
        ([3.0, PI / 2.0, 0.0], dvec3(0.0, 3.0, 0.0)),
        ([4.0, 1.0, PI / 2.0], dvec3(0.0, 0.0, 4.0)),
        ([2.0, -3.0 * PI / 4.0, -PI / 4.0], dvec3(-1.0, -1.0, -2f64.sqrt())),
    ];
    let points = told.iter().map(|(v, _)| doubles(*v)).collect();
    let cloud = read(&file(&[Scan { fields: spherical(&DOUBLE), points, ..Default::default() }])).unwrap();
    for (i, (_, p)) in told.iter().enumerate() {
        // Sines of π are good to 2e-16; offsets are f32.
        assert!(cloud.world(i).distance(*p) < 4.0 * 2f64.powi(-24) * 2.0, "{} is not {p}", cloud.world(i));
    }
    assert_eq!(cloud.viewpoint, Some(DVec3::ZERO), "ranges are measured from a scanner");
}

#[test]
fn colours_and_intensities_are_scaled_from_their_limits() {
    let mut fields = xyz(&DOUBLE);
    fields.extend([
        field(RecordName::ColorRed, integers(0, 2047)),
        field(RecordName::ColorGreen, integers(0, 2047)),
        field(RecordName::ColorBlue, integers(0, 2047)),
        field(RecordName::IsColorInvalid, integers(0, 1)),
        field(RecordName::Intensity, DOUBLE),
        field(RecordName::IsIntensityInvalid, integers(0, 1)),
    ]);
    let point = |rgb: [i64; 3], hidden: i64, strength: f64, lost: i64| {
        let mut values = doubles([1.0, 2.0, 3.0]);
        values.extend(rgb.map(RecordValue::Integer));
        values.extend([RecordValue::Integer(hidden), RecordValue::Double(strength), RecordValue::Integer(lost)]);
        values
    };
    let points = vec![
        point([100, 1123, 356], 0, -40.0, 0),
        point([612, 0, 2000], 0, 60.0, 0),
        point([100, 100, 100], 1, 10.0, 1),
        point([1123, 1123, 1123], 0, f64::NAN, 0),
    ];
    let told = Scan {
        fields: fields.clone(),
        points,
        color_limits: Some([100, 1123]),
        intensity_limits: Some([-40.0, 60.0]),
        ..Default::default()
    };
    let cloud = read(&file(std::slice::from_ref(&told))).unwrap();
    // (356 − 100) / 1023 · 255 = 63.8, (612 − 100) / 1023 · 255 = 127.6; beyond the limits is at them.
    let grey = [190; 3];
    assert_eq!(cloud.colors.as_deref(), Some(&[[0, 255, 64], [128, 0, 255], grey, [255; 3]][..]));
    assert_eq!(cloud.intensity.as_deref(), Some(&[0.0, 1.0, 0.0, 0.0][..]));
    let repaired: Vec<&str> = cloud.report.repaired.iter().map(|(why, _)| why.as_str()).collect();
    assert_eq!(
        repaired,
        ["colours marked as invalid: grey", "intensities marked as invalid: 0", "intensities that were not finite"]
    );
    // Without limits: the type's range, and strengths as they are.
    let untold = Scan { color_limits: None, intensity_limits: None, ..told.clone() };
    let cloud = read(&file(&[untold])).unwrap();
    assert_eq!(cloud.colors.as_ref().unwrap()[..2], [[12, 140, 44], [76, 0, 249]]);
    assert_eq!(cloud.intensity.as_ref().unwrap()[..2], [-40.0, 60.0]);
    // Eleven bits that all hold eight.
    let mut narrow = told;
    narrow.color_limits = None;
    let low =
        |v: &mut RecordValue| *v = RecordValue::Integer(if let RecordValue::Integer(i) = v { *i % 256 } else { 0 });
    narrow.points.iter_mut().for_each(|p| p[3..6].iter_mut().for_each(low));
    let cloud = read(&file(&[narrow])).unwrap();
    assert_eq!(cloud.colors.as_ref().unwrap()[..2], [[100, 99, 100], [100, 0, 208]]);
    assert!(noted(&cloud, "taken as 8 bits"));
}

#[test]
fn colours_of_fractions_without_limits_are_up_to_one() {
    let mut fields = xyz(&DOUBLE);
    let names = [RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue];
    fields.extend(names.map(|n| field(n, RecordDataType::F32)));
    let point = |rgb: [f32; 3]| [doubles([0.0; 3]), rgb.map(RecordValue::Single).into()].concat();
    let scan = |factor: f32| Scan {
        fields: fields.clone(),
        points: vec![point([0.0, 0.5 * factor, factor]), point([0.2 * factor; 3])],
        ..Default::default()
    };
    for factor in [1.0, 255.0] {
        let cloud = read(&file(&[scan(factor)])).unwrap();
        assert_eq!(cloud.colors.as_deref(), Some(&[[0, 128, 255], [51; 3]][..]));
        assert!(noted(&cloud, &format!("taken as 0 to {factor}")), "{:?}", cloud.report);
    }
}

#[test]
fn points_that_are_nowhere_are_left_out_and_counted() {
    let mut fields = xyz(&DOUBLE);
    fields.push(field(RecordName::CartesianInvalidState, integers(0, 2)));
    let point = |x: f64, state: i64| [doubles([x, 0.0, 0.0]), vec![RecordValue::Integer(state)]].concat();
    let points = vec![point(1.0, 0), point(2.0, 1), point(3.0, 2), point(4.0, 0), point(f64::NAN, 0), point(1e300, 0)];
    let cloud = read(&file(&[Scan { fields: fields.clone(), points, ..Default::default() }])).unwrap();
    assert_eq!((0..cloud.len()).map(|i| cloud.world(i).x).collect::<Vec<_>>(), [1.0, 4.0]);
    let dropped: Vec<(&str, u64)> = cloud.report.dropped.iter().map(|(why, n)| (why.as_str(), *n)).collect();
    assert_eq!(
        dropped,
        [
            ("points marked as invalid", 1),
            ("points of which only the direction is known", 1),
            ("non-finite coordinates", 1),
            ("coordinates too far from the rest for 32-bit floats", 1)
        ]
    );
    assert_eq!(cloud.report.points_in_file, 6);
    // Where cartesian coordinates are invalid, spherical ones may do.
    fields.extend(spherical(&DOUBLE));
    let both = [point(9.0, 2), doubles([5.0, 0.0, 0.0])].concat();
    let cloud = read(&file(&[Scan { fields, points: vec![both], ..Default::default() }])).unwrap();
    assert_eq!(cloud.world(0), dvec3(5.0, 0.0, 0.0));
    // None left.
    let mut fields = xyz(&DOUBLE);
    fields.push(field(RecordName::CartesianInvalidState, integers(0, 2)));
    let error = read(&file(&[Scan { fields, points: vec![point(1.0, 2)], ..Default::default() }])).unwrap_err();
    assert!(error.to_string().contains("no point left: 1 in the file, 1 dropped"), "{error}");
}

#[test]
fn normals_turn_with_their_scan_and_what_only_some_scans_have_is_filled() {
    let mut fields = xyz(&DOUBLE);
    fields.extend(["normalX", "normalY", "normalZ"].map(|n| field(extension(n), RecordDataType::F32)));
    let point = |n: [f32; 3]| [doubles([0.0; 3]), n.map(RecordValue::Single).into()].concat();
    let q = turned(dvec3(1.0, 2.0, -0.5), 1.2);
    let normals = [[1.0, 0.0, 0.0], [0.0, 3.0, 4.0], [0.0; 3]];
    let points = normals.iter().map(|n| point(*n)).collect();
    let with = Scan { fields, points, pose: Some((q, FAR)), ..Default::default() };
    let without = Scan { pose: Some((q, FAR)), ..bare(&[DVec3::X, DVec3::Y]) };
    let cloud = read(&file(&[with, without])).unwrap();
    let found = cloud.normals.as_ref().unwrap();
    for (n, told) in found.iter().zip(normals) {
        let told = rotate(q, DVec3::from_array(told.map(f64::from))).normalize_or_zero();
        assert!(n.as_dvec3().distance(told) < 2e-7, "{n} is not {told}");
    }
    assert_eq!(found[3..], [Vec3::ZERO; 2]);
    assert_eq!(cloud.report.repaired, [("normals without a direction".to_owned(), 1)]);
    assert!(noted(&cloud, "only some scans have normals"), "{:?}", cloud.report);
    assert_eq!(cloud.viewpoint, Some(FAR), "both stood there");
}

/// A scanner's grid: range differs from point to point, some are missing.
fn grid(rows: i64, columns: i64, step: [f64; 2], by_rows: bool) -> Scan {
    let mut fields = xyz(&DOUBLE);
    fields
        .extend([field(RecordName::RowIndex, integers(0, rows)), field(RecordName::ColumnIndex, integers(0, columns))]);
    let mut cells: Vec<(i64, i64)> = (0..columns).flat_map(|c| (0..rows).map(move |r| (r, c))).collect();
    if by_rows {
        cells.sort();
    }
    let point = |(row, column): (i64, i64)| {
        let (azimuth, elevation) = (step[1] * column as f64, step[0] * (row as f64 - 0.5 * (rows - 1) as f64));
        let range = 2.0 + ((row * 7 + column * 13) % 11) as f64;
        let p = range * dvec3(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
        [doubles(p.to_array()), vec![RecordValue::Integer(row), RecordValue::Integer(column)]].concat()
    };
    let there = cells.into_iter().filter(|(r, c)| (r * 31 + c * 17) % 5 != 0);
    Scan { fields, points: there.map(point).collect(), ..Default::default() }
}

#[test]
fn the_angular_step_is_that_of_the_grid_in_any_order() {
    for by_rows in [false, true] {
        // Rows are 0.002 apart; columns 0.005 about the axis, at elevations within 0.04: 0.1 % less at most.
        let cloud = read(&file(&[grid(41, 70, [0.002, 0.005], by_rows)])).unwrap();
        let step = f64::from(cloud.angular_step.unwrap());
        assert!((0.005 * 0.999..=0.005 * (1.0 + 1e-6)).contains(&step), "{step}");
        assert_eq!(cloud.viewpoint, Some(DVec3::ZERO), "a grid is a scanner's");
        let cloud = read(&file(&[grid(41, 70, [0.006, 0.005], by_rows)])).unwrap();
        assert!((f64::from(cloud.angular_step.unwrap()) - 0.006).abs() < 1e-8);
    }
    // A pose does not matter: it is the scan's own origin that angles are measured from.
    let moved = Scan { pose: Some((turned(DVec3::ONE, 2.0), FAR)), ..grid(41, 70, [0.006, 0.005], false) };
    let cloud = read(&file(&[moved])).unwrap();
    assert!((f64::from(cloud.angular_step.unwrap()) - 0.006).abs() < 1e-8);
}

#[test]
fn scans_agree_on_a_step_or_there_is_none() {
    let alike = [grid(41, 70, [0.006, 0.005], false), grid(30, 60, [0.0062, 0.005], true)];
    assert!((f64::from(read(&file(&alike)).unwrap().angular_step.unwrap()) - 0.0062).abs() < 1e-8);
    let unlike = [grid(41, 70, [0.006, 0.005], false), grid(30, 60, [0.009, 0.005], true)];
    assert_eq!(read(&file(&unlike)).unwrap().angular_step, None);
    let silent = [grid(41, 70, [0.006, 0.005], false), bare(&[DVec3::X])];
    assert_eq!(read(&file(&silent)).unwrap().angular_step, None);
    // Too few neighbours to believe.
    assert_eq!(read(&file(&[grid(3, 3, [0.006, 0.005], false)])).unwrap().angular_step, None);
}

#[test]
fn without_a_grid_the_field_of_view_tells_the_step() {
    let bounds = |azimuth| Some((azimuth, [-0.2, 0.6], [101, 401]));
    let scan = |azimuth| Scan { bounds: bounds(azimuth), ..bare(&[DVec3::X, DVec3::Y]) };
    let step = |azimuth| read(&file(&[scan(azimuth)])).unwrap().angular_step.map(f64::from);
    assert!((step([0.5, 1.5]).unwrap() - 0.01).abs() < 1e-8);
    // Through ±π.
    assert!((step([3.0, 3.5 - TAU]).unwrap() - 0.005).abs() < 1e-8);
    assert!((step([0.5, 0.5]).is_none()));
}

fn in_pieces(path: &std::path::Path) -> (Vec<PointCloud>, Pieces) {
    let mut pieces = Pieces::open(path, &Options::default()).unwrap();
    let mut all = Vec::new();
    while let Some(piece) = pieces.piece().unwrap() {
        all.push(piece);
    }
    (all, pieces)
}

#[track_caller]
fn assert_same_in_pieces(path: &std::path::Path, count: usize) {
    let whole = load::open(path, &Options::default()).unwrap();
    let (all, pieces) = in_pieces(path);
    assert_eq!(all.len(), count);
    assert!(all.iter().all(|p| p.origin == whole.origin && p.len() <= 1 << 16));
    assert_eq!(pieces.origin(), whole.origin);
    assert_eq!((pieces.up(), pieces.viewpoint()), (whole.up, whole.viewpoint));
    assert_eq!(pieces.report(), &whole.report);
    let bits = |p: &Vec3| p.to_array().map(f32::to_bits);
    assert!(all.iter().flat_map(|p| &p.positions).map(bits).eq(whole.positions.iter().map(bits)));
    macro_rules! same {
        ($list:ident) => {
            assert!(all.iter().all(|p| p.$list.is_some() == whole.$list.is_some()));
            assert!(all.iter().flat_map(|p| p.$list.iter().flatten()).eq(whole.$list.iter().flatten()));
        };
    }
    same!(normals);
    same!(colors);
    same!(intensity);
}

#[test]
fn pieces_are_the_cloud_bit_for_bit() {
    let folder = Folder::new("e57-pieces");
    let path = folder.0.join("a.e57");
    let far: Vec<DVec3> = (0..150_000).map(|i| dvec3(i as f64 * 0.001, (i % 977) as f64 * 0.01, 2.0)).collect();
    let mut fields = xyz(&RecordDataType::ScaledInteger { min: 0, max: 999, scale: 0.1, offset: 0.0 });
    fields.extend([
        field(RecordName::CartesianInvalidState, integers(0, 2)),
        field(RecordName::ColorRed, integers(0, 255)),
        field(RecordName::ColorGreen, integers(0, 255)),
        field(RecordName::ColorBlue, integers(0, 255)),
        field(RecordName::Intensity, integers(7, 7)),
    ]);
    let point = |i: i64| {
        let mut values: Vec<RecordValue> = [i % 1000, i / 7 % 1000, i / 100].map(RecordValue::ScaledInteger).into();
        values.extend([i % 3, i % 256, 1, 2, 7].map(RecordValue::Integer));
        values
    };
    let small = Scan { fields, points: (0..70_000).map(point).collect(), ..Default::default() };
    let pose = Some((turned(DVec3::X, 0.3), FAR));
    std::fs::write(&path, file(&[Scan { pose, ..bare(&far) }, Scan { pose, ..small }])).unwrap();
    assert_same_in_pieces(&path, 3 + 2);
}

#[test]
fn with_data_pump_room_is_all_there() {
    let path = data("pump_room.e57");
    let cloud = load::open(&path, &Options::default()).unwrap();
    crate::load_files::check_promises(&cloud);
    assert_eq!((cloud.len(), cloud.report.format.as_str()), (155_201, "E57"));
    assert_eq!((cloud.viewpoint, cloud.up), (Some(DVec3::ZERO), Some(Vec3::Z)));
    // Columns 1.4996 rad / 344 apart about the axis, less away from the horizon; rows 1.266 rad / 1073.
    let step = f64::from(cloud.angular_step.unwrap());
    assert!((0.0036..0.0044).contains(&step), "{step}");
    // Point by point against the crate's own reader.
    let mut reader = e57::E57Reader::from_file(&path).unwrap();
    let scan = reader.pointclouds().remove(0);
    let mut told = Vec::new();
    for (i, point) in reader.pointcloud_simple(&scan).unwrap().enumerate() {
        let point = point.unwrap();
        let e57::CartesianCoordinate::Valid { x, y, z } = point.cartesian else { panic!("all are valid") };
        told.push(dvec3(x, y, z));
        let color = point.color.unwrap();
        let color = [color.red, color.green, color.blue].map(|c| (255.0 * c).round() as u8);
        assert_eq!(cloud.colors.as_ref().unwrap()[i], color);
        assert!((cloud.intensity.as_ref().unwrap()[i] - point.intensity.unwrap()).abs() < 1e-6);
    }
    assert_places(&cloud, &told);
    assert_same_in_pieces(&path, 3);
}
