//! Every good file of the test data, with the counts and boxes that independent readers found (data/README.md).

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec3, Vec3, dvec3};
use surfel::load::{self, Bounds, Options, PointCloud};

use crate::common::data;

fn open(name: &str) -> PointCloud {
    let cloud = load::open(&data(name), &Options::default()).unwrap();
    check_promises(&cloud);
    cloud
}

/// What the documentation of `PointCloud` says of every cloud.
pub fn check_promises(cloud: &PointCloud) {
    let n = cloud.len();
    assert!(n > 0 && cloud.origin.is_finite());
    assert!(cloud.positions.iter().all(|p| p.is_finite()));
    if let Some(list) = &cloud.normals {
        assert_eq!(list.len(), n);
        // A unit vector rounded to f32: three components off by 2^-25 each, relative to at most 1.
        assert!(list.iter().all(|v| *v == Vec3::ZERO || (v.as_dvec3().length() - 1.0).abs() < 3e-7));
    }
    if let Some(list) = &cloud.radii {
        assert_eq!(list.len(), n);
        assert!(list.iter().all(|r| r.is_finite() && *r > 0.0));
    }
    if let Some(list) = &cloud.opacity {
        assert_eq!(list.len(), n);
        assert!(list.iter().all(|a| (0.0..=1.0).contains(a)));
    }
    assert!(cloud.colors.as_ref().is_none_or(|l| l.len() == n));
    assert!(cloud.classes.as_ref().is_none_or(|l| l.len() == n));
    assert!(cloud.intensity.as_ref().is_none_or(|l| l.len() == n && l.iter().all(|v| v.is_finite())));
    if let Some(mesh) = &cloud.mesh {
        assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n));
        assert!(mesh.triangles.iter().all(|t| t[0] != t[1] && t[1] != t[2] && t[0] != t[2]));
    }
    let dropped: u64 = cloud.report.dropped.iter().map(|(_, n)| n).sum();
    assert!(cloud.report.points_in_file <= n as u64 + dropped);
}

fn faces(cloud: &PointCloud) -> usize {
    cloud.mesh.as_ref().map_or(0, |m| m.triangles.len())
}

/// `digits` is the step of the last digit that the README gives.
#[track_caller]
fn assert_box(cloud: &PointCloud, min: [f64; 3], max: [f64; 3], digit: f64) {
    let b = Bounds::of(cloud).unwrap();
    for (found, told) in [(b.min, min), (b.max, max)] {
        let off = (found - DVec3::from_array(told)).abs().max_element();
        // Half a digit for its rounding, and the f32 rounding of an offset.
        let bound = 0.5001 * digit + (b.max - b.min).max_element() * 2f64.powi(-24);
        assert!(off <= bound, "{found} is not {told:?}: off by {off}, allowed {bound}");
    }
}

#[test]
fn with_data_ply_meshes_have_all_points_and_faces() {
    let dragon = open("stanford_dragon.ply");
    assert_eq!((dragon.len(), faces(&dragon)), (437_645, 871_414));
    assert_eq!(dragon.report.format, "PLY binary little-endian");
    let armadillo = open("armadillo.ply");
    assert_eq!((armadillo.len(), faces(&armadillo)), (43_243, 86_482));
    assert_box(&armadillo, [-0.435275, -0.573402, -0.379481], [0.403342, 0.426549, 0.38333], 1e-6);
    let bunny = open("stanford_bunny_ascii.ply");
    assert_eq!((bunny.len(), faces(&bunny)), (35_947, 69_451));
    assert_box(&bunny, [-0.0946899, 0.0329874, -0.0618736], [0.0610091, 0.187321, 0.0587997], 1e-6);
    assert_eq!(bunny.report.format, "PLY ascii");
    assert!(bunny.intensity.is_some() && bunny.colors.is_none());
    assert_eq!(bunny.report.assumed, ["properties not used: confidence"]);
    let rocker = open("rocker_arm_big_endian.ply");
    assert_eq!((rocker.len(), faces(&rocker)), (40_177, 80_354));
    assert_box(&rocker, [-0.020198, -0.011908, -0.039232], [0.020198, 0.011908, 0.039232], 1e-6);
    assert_eq!(rocker.report.format, "PLY binary big-endian");
    assert!(rocker.colors.is_some());
}

#[test]
fn with_data_ply_points_with_normals_and_diffuse_colours() {
    let pond = open("pond_mvs_normals.ply");
    assert_eq!((pond.len(), faces(&pond)), (70_051, 0));
    assert_box(&pond, [-1.50206, 0.571367, -2.63168], [1.97647, 1.09156, 0.509945], 1e-5);
    assert!(pond.normals.is_some() && pond.colors.is_some() && pond.radii.is_none());
    assert!(pond.report.assumed.iter().any(|l| l.contains("psz")), "{:?}", pond.report);
}

#[test]
fn with_data_gaussian_splats_become_disks() {
    let guitar = open("splat_guitar.ply");
    assert_eq!(guitar.report.points_in_file, 90_854);
    let dropped: u64 = guitar.report.dropped.iter().map(|(_, n)| n).sum();
    assert_eq!(guitar.len() as u64 + dropped, 90_854);
    assert!(guitar.len() > 85_000, "{:?}", guitar.report);
    assert_eq!(guitar.up, Some(Vec3::NEG_Y));
    for list in [&guitar.radii, &guitar.opacity] {
        assert!(list.is_some());
    }
    assert!(guitar.normals.is_some() && guitar.colors.is_some());
    let train = open("splat_train_1000.ply");
    assert_eq!(train.report.points_in_file, 1000);
    assert!(train.report.assumed.iter().any(|l| l.starts_with("45 coefficients")), "{:?}", train.report);
    // Its stored normals are all zero: ours come from the shapes.
    assert!(train.normals.as_ref().unwrap().iter().all(|n| *n != Vec3::ZERO));
}

#[test]
fn with_data_autzen_stadium_is_all_there_with_its_eight_bit_colours() {
    let calls = AtomicU64::new(0);
    let last = AtomicU64::new(0);
    let progress = |done: u64, total: u64| {
        assert!(done >= last.swap(done, Ordering::Relaxed) && done <= total && total == 10_653_336);
        calls.fetch_add(1, Ordering::Relaxed);
    };
    let options = Options { progress: Some(&progress) };
    let cloud = load::open(&data("autzen_stadium.laz"), &options).unwrap();
    check_promises(&cloud);
    assert!(calls.load(Ordering::Relaxed) > 10 && last.load(Ordering::Relaxed) == 10_653_336);
    assert_eq!(cloud.len(), 10_653_336);
    assert_box(&cloud, [635577.79, 848882.15, 406.14], [639003.73, 853537.66, 615.26], 0.0);
    assert_eq!(cloud.up, Some(Vec3::Z));
    let colors = cloud.colors.as_ref().unwrap();
    assert!(colors.iter().flatten().any(|c| *c > 200), "read as 16 bits, the picture is black");
    assert!(cloud.report.assumed.iter().any(|l| l.contains("8 bits")));
    assert!(cloud.intensity.is_some());
}

#[test]
fn with_data_lion_has_sixteen_bit_colours() {
    let cloud = open("lion_takanawa.laz");
    assert_eq!(cloud.len(), 3_954_696);
    assert_box(&cloud, [-2.348, -4.915, 0.224], [4.051, 3.624, 9.519], 0.0);
    let colors = cloud.colors.as_ref().unwrap();
    assert!(colors.iter().flatten().any(|c| *c > 200) && colors.iter().flatten().any(|c| *c < 50));
    assert!(!cloud.report.assumed.iter().any(|l| l.contains("8 bits")));
}

#[test]
fn with_data_copc_is_read_in_full_and_utm_coordinates_stay_exact_to_their_scale() {
    let path = data("lone_star_utm.copc.laz");
    let cloud = open("lone_star_utm.copc.laz");
    assert_eq!(cloud.len(), 518_862);
    assert_eq!(cloud.report.format, "LAZ 1.4 format 6");
    assert_box(&cloud, [515368.60, 4918340.36, 2322.9], [515401.04, 4918381.12, 2338.58], 0.01);
    assert!(cloud.colors.is_none() && cloud.intensity.is_some());
    // Point by point against the sequential reader of the crate `laz` and the specification's formula.
    let bytes = std::fs::read(&path).unwrap();
    let number = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let (scale, offset) = ([131, 139, 147].map(number), [155, 163, 171].map(number));
    let bounds = Bounds::of(&cloud).unwrap();
    // An offset is at most the whole extent, rounded to f32; coordinates near 5e6 have an f64 spacing of 1e-9.
    let bound = (bounds.max - bounds.min).max_element() * 2f64.powi(-24) + 2e-9;
    assert!(bound < 0.5 * scale[0], "{bound} would not be exact to the scale {}", scale[0]);
    let mut reader = laz::las::file::SimpleReader::new(std::io::Cursor::new(&bytes)).unwrap();
    for i in 0..cloud.len() {
        let record = reader.read_next().unwrap().unwrap();
        let at = |axis: usize| {
            let raw = i32::from_le_bytes(record[4 * axis..4 * axis + 4].try_into().unwrap());
            f64::from(raw) * scale[axis] + offset[axis]
        };
        let off = (cloud.world(i) - dvec3(at(0), at(1), at(2))).abs().max_element();
        assert!(off <= bound, "point {i} is off by {off}");
        let intensity = u16::from_le_bytes([record[12], record[13]]);
        assert_eq!(cloud.intensity.as_ref().unwrap()[i], f32::from(intensity));
    }
}

#[test]
fn with_data_plain_las_with_odd_scales() {
    let cloud = open("certainty3d_color_feet.las");
    assert_eq!(cloud.len(), 10_126);
    assert_eq!(cloud.report.format, "LAS 1.2 format 3");
    assert_box(&cloud, [6326726.54, 2068062.39, 2700.53], [6330162.95, 2071932.24, 2975.71], 0.01);
    let points = las::Reader::from_path(data("certainty3d_color_feet.las")).unwrap().read_all().unwrap();
    for (i, (r, g, b)) in points.rgb().unwrap().enumerate() {
        let eight = [r, g, b].map(|v| (f64::from(v) / 257.0).round() as u8);
        assert_eq!(cloud.colors.as_ref().unwrap()[i], eight);
    }
    // 3900 feet of extent in f32, and f64 near 6e6.
    let bound = 3900.0 * 2f64.powi(-24) + 2e-9;
    for (i, ((x, y), z)) in points.x().zip(points.y()).zip(points.z()).enumerate() {
        assert!((cloud.world(i) - dvec3(x, y, z)).abs().max_element() <= bound);
    }
}

#[test]
fn with_data_two_reads_give_the_same_bytes() {
    for name in ["lone_star_utm.copc.laz", "pond_mvs_normals.ply", "splat_guitar.ply", "stanford_bunny_ascii.ply"] {
        let (a, b) = (open(name), open(name));
        assert_eq!((a.origin, &a.positions, &a.normals, &a.colors), (b.origin, &b.positions, &b.normals, &b.colors));
        assert_eq!((&a.radii, &a.opacity, &a.intensity, &a.report), (&b.radii, &b.opacity, &b.intensity, &b.report));
    }
}
