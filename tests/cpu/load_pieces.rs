//! Inputs in pieces: the same points as in full.

use std::path::Path;

use glam::DVec3;
use surfel::load::{Options, Pieces, PointCloud, merge, open, synthetic};

use crate::common::data;

fn joined(path: &Path) -> (PointCloud, usize) {
    all(Pieces::open(path, &Options::default()).expect("a file"))
}

fn all(mut pieces: Pieces) -> (PointCloud, usize) {
    let mut all = Vec::new();
    while let Some(piece) = pieces.piece().expect("points") {
        assert_eq!(piece.origin, pieces.origin());
        all.push(piece);
    }
    let count = all.len();
    (merge(all), count)
}

fn same(name: &str, several: bool) {
    let path = data(name);
    let whole = open(&path, &Options::default()).expect("a file");
    let (joined, pieces) = joined(&path);
    assert_eq!(pieces > 1, several, "{name}: {pieces} pieces");
    assert_eq!(joined.len(), whole.len(), "{name}");
    // The origin is that of a sample; offsets round once to f32.
    let far = whole.positions.iter().chain(&joined.positions).map(|p| p.abs().max_element()).fold(0.0, f32::max);
    let most = 2.0 * far as f64 * f32::EPSILON as f64;
    let moved = (0..whole.len()).map(|i| (whole.world(i) - joined.world(i)).abs().max_element());
    assert!(moved.fold(0.0, f64::max) <= most, "{name}");
    assert!(joined.normals == whole.normals && joined.colors == whole.colors && joined.radii == whole.radii, "{name}");
}

#[test]
fn with_data_scans_in_pieces_are_the_scans() {
    same("lone_star_utm.copc.laz", true);
    same("certainty3d_color_feet.las", false);
    same("pond_mvs_normals.ply", true);
}

#[test]
fn with_data_faces_give_normals_in_full() {
    let (cloud, pieces) = joined(&data("rocker_arm_big_endian.ply"));
    assert!(pieces == 1 && cloud.normals.is_some() && cloud.radii.is_some());
}

#[test]
fn scenes_in_pieces_are_the_scenes() {
    // One that is made as it is read, whatever runs it, and one that is not.
    for (name, points, several) in [("deep", 600_001, true), ("deep", 1, false), ("torus", 1000, false)] {
        let whole = synthetic::scene(name, points, 5).expect("a scene");
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let pieces = Pieces::scene(name, points as u64, 5).expect("a scene");
            assert_eq!((pieces.points(), pieces.up(), pieces.viewpoint()), (points as u64, whole.up, whole.viewpoint));
            assert_eq!(pieces.report(), &whole.report);
            let (joined, count) = pool.install(|| all(pieces));
            assert_eq!(count > 1, several, "{name}: {count} pieces");
            assert!(joined.positions == whole.positions && joined.normals == whole.normals, "{name}");
            assert!(joined.radii == whole.radii && joined.colors == whole.colors, "{name}");
        }
    }
    assert!(Pieces::scene("deep", 0, 1).is_err() && Pieces::scene("nothing", 9, 1).is_err());
}

#[test]
fn rows_that_are_missing_are_told_before_any_is_read() {
    let folder = crate::folder::Folder::new("pieces");
    let path = folder.path("a.ply");
    let head = "ply\nformat binary_little_endian 1.0\nelement vertex 99\nproperty double x\nproperty double y\n\
        property double z\nend_header\n";
    std::fs::write(&path, [head.as_bytes(), &[0; 24 * 7]].concat()).expect("a file");
    let error = Pieces::open(Path::new(&path), &Options::default()).expect_err("cut short").to_string();
    assert!(error.contains("in vertex 7"), "{error}");
    std::fs::write(&path, [head.as_bytes(), &[0; 24 * 99]].concat()).expect("a file");
    let (cloud, _) = joined(Path::new(&path));
    assert_eq!((cloud.len(), cloud.world(98)), (99, DVec3::ZERO));
}
