//! Odd and broken files: the odd ones load with what they hold, the broken ones end in an error that says where and why.

use glam::dvec3;
use surfel::load::{self, Options, PointCloud};
use surfel::{Error, Place};

use crate::common::data;
use crate::load_files::check_promises;

fn open(name: &str) -> PointCloud {
    let cloud = load::open(&data(&format!("bad/{name}")), &Options::default()).unwrap_or_else(|e| panic!("{e}"));
    check_promises(&cloud);
    cloud
}

fn faces(cloud: &PointCloud) -> usize {
    cloud.mesh.as_ref().map_or(0, |m| m.triangles.len())
}

#[track_caller]
fn refused(name: &str, place: Place, words: &str) {
    match load::open(&data(name), &Options::default()) {
        Err(Error::Data { file, place: found, why }) => {
            assert!(file.ends_with(name));
            assert!(why.contains(words), "{name}: {why}");
            assert_eq!(found, place, "{name}: {why}");
        }
        other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn with_data_broken_files_say_where_and_why() {
    refused("bad/ply_zero_bytes.ply", Place::File, "the file is empty");
    refused("bad/ply_crash_fuzz.ply", Place::Line(7), "inside the header");
    refused("bad/ply_issue623.ply", Place::Line(14), "line of vertex 0");
    refused("bad/ply_playcanvas_compressed_splat.ply", Place::File, "compressed splat");
    refused("bad/obj_zero_bytes.obj", Place::File, "the file is empty");
}

#[test]
fn with_data_formats_that_are_not_read_are_named() {
    for name in ["obj_malformed.obj", "obj_malformed2.obj"] {
        refused(&format!("bad/{name}"), Place::File, "OBJ is not read yet; surfel reads PLY, LAS, LAZ and E57");
    }
    refused("bad/pcd_missing_header.pcd", Place::File, "PCD is not read yet");
    refused("statue_textured.glb", Place::File, "glTF is not read yet");
}

#[test]
fn with_data_no_file_and_no_regular_file() {
    let folder = data("README.md").parent().unwrap().to_owned();
    assert!(matches!(load::open(&folder.join("none.ply"), &Options::default()), Err(Error::Io { .. })));
    let error = load::open(&folder, &Options::default()).unwrap_err().to_string();
    assert!(error.contains("this is a directory"), "{error}");
    let error = load::open(&folder.join("README.md"), &Options::default()).unwrap_err().to_string();
    assert!(error.contains("the format is not known"), "{error}");
}

#[test]
fn with_data_odd_ply_files_load() {
    let cloud = open("ply_float_color.ply");
    assert_eq!((cloud.len(), faces(&cloud)), (3, 1));
    assert_eq!(cloud.colors.as_deref(), Some(&[[0, 0, 255]; 3][..]));
    assert_eq!(cloud.opacity, None, "alpha is 1: nothing is transparent");
    for name in ["ply_crlf_header_binary.ply", "ply_binary_body_starts_with_newline.ply"] {
        let cloud = open(name);
        assert_eq!((cloud.len(), faces(&cloud)), (8, 12), "{name}");
    }
    for name in ["ply_extra_whitespace.ply", "ply_more_datatypes.ply"] {
        let cloud = open(name);
        assert_eq!((cloud.len(), faces(&cloud)), (3, 1));
        assert_eq!(cloud.colors.as_deref(), Some(&[[209, 0, 122], [77, 0, 205], [0, 0, 255]][..]), "{name}");
    }
    let cloud = open("ply_issue_2421.ply");
    assert_eq!((cloud.len(), cloud.world(0)), (1, dvec3(1.23457, 12345.6789, 1234567890.12345)));
    let cloud = open("ply_big_endian_polygons.ply");
    assert_eq!((cloud.len(), cloud.report.dropped.len()), (50, 0));
    let cloud = open("ply_features_multi.ply");
    assert_eq!(cloud.mesh.as_ref().unwrap().triangles, [[0, 1, 2], [0, 2, 3]]);
    let cloud = open("ply_range_grid_ascii.ply");
    assert_eq!((cloud.len(), faces(&cloud)), (44_329, 0));
}

#[test]
fn with_data_odd_las_files_load() {
    for (name, points) in [
        ("las_bad_vlr_count.las", 10),
        ("las_bad_geotiff_keys.las", 10),
        ("las_empty_geotiff_vlrs.las", 43),
        ("las_gps_time_nan.las", 1),
        ("las_spurious.las", 1065),
        ("las_unregistered_extra_bytes.las", 4),
    ] {
        let cloud = open(name);
        assert_eq!(cloud.report.points_in_file, points, "{name}");
        assert_eq!(cloud.len() as u64, points, "{name}: {:?}", cloud.report);
    }
}

#[test]
fn with_data_withheld_points_are_left_out_and_counted() {
    // Random flags: 895 of the 1000 points carry the bit.
    let cloud = open("las_wont_compress.las");
    assert_eq!(cloud.report.dropped, [("points flagged as withheld".to_owned(), 895)]);
    assert_eq!((cloud.len(), cloud.report.points_in_file), (105, 1000));
}

#[test]
fn with_data_a_garbage_count_of_records_costs_nothing() {
    // The header claims more than three thousand million variable-length records, which nobody walks through; what is
    // wrong in earnest is that the last record is cut.
    let place = Place::Element("point", 718);
    refused("bad/las_garbage_vlr_count.las", place, "the file ends here; the header promises 719");
}
