//! PLY written by the tests: every encoding, every type, every cut, and lies.

use std::path::Path;

use glam::{DVec3, Vec3, dvec3, vec3};
use proptest::prelude::*;
use surfel::load::{self, Options, PointCloud};
use surfel::{Error, Place, Result};

use crate::common::data;
use crate::load_files::check_promises;

fn read(bytes: &[u8]) -> Result<PointCloud> {
    let cloud = load::read(Path::new("test.ply"), bytes, &Options::default());
    if let Ok(cloud) = &cloud {
        check_promises(cloud);
    }
    cloud
}

#[track_caller]
fn refused(bytes: &[u8], place: Place, words: &str) {
    match read(bytes) {
        Err(Error::Data { place: found, why, .. }) => {
            assert!(why.contains(words), "{why}");
            assert_eq!(found, place, "{why}");
        }
        other => panic!("{other:?}"),
    }
}

const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];
const TYPES: [[&str; 2]; 8] = [
    ["char", "int8"],
    ["uchar", "uint8"],
    ["short", "int16"],
    ["ushort", "uint16"],
    ["int", "int32"],
    ["uint", "uint32"],
    ["float", "float32"],
    ["double", "float64"],
];

/// Appends `v` as type number `ty` in format number `format`.
fn put(out: &mut Vec<u8>, v: f64, ty: usize, format: usize) {
    if format == 0 {
        let text = match ty {
            6 => (v as f32).to_string(),
            7 => v.to_string(),
            _ => (v as i64).to_string(),
        };
        out.extend(text.bytes());
        out.push(b' ');
        return;
    }
    let mut bytes = match ty {
        0 => (v as i8).to_le_bytes().to_vec(),
        1 => (v as u8).to_le_bytes().to_vec(),
        2 => (v as i16).to_le_bytes().to_vec(),
        3 => (v as u16).to_le_bytes().to_vec(),
        4 => (v as i32).to_le_bytes().to_vec(),
        5 => (v as u32).to_le_bytes().to_vec(),
        6 => (v as f32).to_le_bytes().to_vec(),
        _ => v.to_le_bytes().to_vec(),
    };
    if format == 2 {
        bytes.reverse();
    }
    out.extend(bytes);
}

fn end_row(out: &mut Vec<u8>, format: usize) {
    if format == 0 {
        out.push(b'\n');
    }
}

/// A value that type `ty` holds exactly.
fn fit(v: f64, ty: usize) -> f64 {
    match ty {
        0 => f64::from(v as i8),
        1 => f64::from(v as u8),
        2 => f64::from(v as i16),
        3 => f64::from(v as u16),
        4 => f64::from(v as i32),
        5 => f64::from(v as u32),
        6 => f64::from(v as f32),
        _ => v,
    }
}

/// A file of `points`, all coordinates of type `ty`, with a list in each vertex if `listed`, and one face.
fn file(points: &[DVec3], ty: usize, name: usize, format: usize, listed: bool) -> Vec<u8> {
    let t = TYPES[ty][name];
    let list = if listed { "property list uchar short extra\n" } else { "" };
    let mut out = format!(
        "ply\nformat {} 1.0\ncomment c\nelement vertex {}\nproperty {t} x\n{list}property {t} y\nproperty {t} z\n\
         element face 1\nproperty uchar flags\nproperty list {t} {t} vertex_index\nend_header\n",
        FORMATS[format],
        points.len()
    )
    .replace("list float ", "list int ")
    .replace("list float32 ", "list int ")
    .replace("list double ", "list int ")
    .replace("list float64 ", "list int ")
    .into_bytes();
    for (i, p) in points.iter().enumerate() {
        put(&mut out, p.x, ty, format);
        if listed {
            put(&mut out, (i % 3) as f64, 1, format);
            (0..i % 3).for_each(|k| put(&mut out, k as f64 - 7.0, 2, format));
        }
        put(&mut out, p.y, ty, format);
        put(&mut out, p.z, ty, format);
        end_row(&mut out, format);
    }
    put(&mut out, 1.0, 1, format);
    put(&mut out, 3.0, if ty >= 6 { 4 } else { ty }, format);
    [0.0, 1.0, 2.0].iter().for_each(|v| put(&mut out, *v, ty, format));
    end_row(&mut out, format);
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn what_is_written_comes_back(
        raw in prop::collection::vec(prop::array::uniform3(-2e5..2e5f64), 3..40),
        ty in 0usize..8, name in 0usize..2, format in 0usize..3, listed: bool,
    ) {
        let points: Vec<DVec3> = raw.iter().map(|p| DVec3::from_array(p.map(|v| fit(v, ty)))).collect();
        let cloud = read(&file(&points, ty, name, format, listed)).unwrap();
        prop_assert_eq!(cloud.len(), points.len());
        for (i, p) in points.iter().enumerate() {
            // Types that f32 holds come back exactly. The others lose the f32 rounding of an offset: at most the whole
            // extent of 4e5 (6.5e5 for the wrapped integers), and an f64 rounding of the sum.
            let bound = if ty < 4 || ty == 6 { 0.0 } else { 6.5e5 * 2f64.powi(-24) + 1e-9 };
            let off = (cloud.world(i) - *p).abs().max_element();
            prop_assert!(off <= bound, "{} off by {}", p, off);
        }
        prop_assert_eq!(&cloud.mesh.as_ref().unwrap().triangles, &vec![[0, 1, 2]]);
    }

    #[test]
    fn no_bytes_make_it_panic(
        seed in 0usize..9, edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12), cut in 0usize..60,
    ) {
        let points = [dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.0, 0.0), dvec3(0.0, 1.0, 0.0)];
        let mut bytes = file(&points, [1, 6, 7][seed / 3], 0, seed % 3, seed % 2 == 1);
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        bytes.truncate(bytes.len().saturating_sub(cut / 2));
        let _ = read(&bytes);
    }
}

#[test]
fn every_cut_of_a_file_is_an_error_in_the_right_element() {
    let points = [dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.0, 0.0), dvec3(0.0, 1.0, 0.0), dvec3(5.0, 5.0, 5.0)];
    for format in 0..3 {
        for listed in [false, true] {
            let whole = file(&points, 6, 0, format, listed);
            assert!(read(&whole).is_ok());
            for length in 0..whole.len() {
                // Text may lose the last blank and line end, or digits of the last number, without a trace.
                if format == 0 && length + 3 > whole.len() {
                    continue;
                }
                match read(&whole[..length]) {
                    Err(Error::Data { place, why, .. }) => {
                        let body = whole.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
                        let fits = match place {
                            Place::File => length < 3,
                            Place::Line(_) => length < body || format == 0,
                            Place::Element(..) => length >= body && why.contains("the file ends here"),
                            _ => false,
                        };
                        assert!(fits, "{length} of {} bytes: {place:?} {why}", whole.len());
                    }
                    // A number cut to its first digits is a number.
                    Ok(_) if format == 0 => {}
                    other => panic!("{length} of {} bytes: {other:?}", whole.len()),
                }
            }
        }
    }
}

#[test]
fn cuts_name_the_first_vertex_that_is_not_whole() {
    let points: Vec<DVec3> = (0..5000).map(|i| DVec3::splat(f64::from(i))).collect();
    let whole = file(&points, 6, 0, 1, false);
    let body = whole.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let place = Place::Element("vertex", 1234);
    refused(&whole[..body + 1234 * 12 + 11], place.clone(), "the file ends here; the header promises 5000");
    refused(&whole[..body + 1234 * 12], place, "the file ends here; the header promises 5000");
}

fn header(lines: &str) -> Vec<u8> {
    format!("ply\n{lines}\nend_header\n").into_bytes()
}

#[test]
fn counts_that_lie_allocate_nothing() {
    let xyz = "property float x\nproperty float y\nproperty float z";
    for count in ["5", "4294967295", "1000000000000000000", "18446744073709551615"] {
        for format in FORMATS {
            let bytes = header(&format!("format {format} 1.0\nelement vertex {count}\n{xyz}"));
            refused(&bytes, Place::Element("vertex", 0), "the file ends here");
            let listed =
                header(&format!("format {format} 1.0\nelement vertex {count}\n{xyz}\nproperty list uint double l"));
            refused(&listed, Place::Element("vertex", 0), "the file ends here");
            let other = header(&format!("format {format} 1.0\nelement o {count}\n{xyz}\nelement vertex 1\n{xyz}"));
            refused(&other, Place::Element("element", 0), "the file ends here");
        }
    }
    for count in ["18446744073709551616", "99999999999999999999999999", "-1", "1e9", "0x10", ""] {
        let bytes = header(&format!("format ascii 1.0\nelement vertex {count}\n{xyz}"));
        assert!(matches!(read(&bytes), Err(Error::Data { place: Place::Line(3), .. })), "{count}");
    }
    // A list of four thousand million corners, and one of minus one.
    for (list, place) in [([255; 4], 0), ([0, 0, 0, 128], 0)] {
        for ty in ["int", "uint"] {
            let lines = format!(
                "format binary_little_endian 1.0\nelement vertex 0\n{xyz}\nelement face 1\nproperty list {ty} int vertex_index"
            );
            let mut bytes = header(&lines);
            bytes.extend(list);
            let words = if ty == "int" { "a list has -" } else { "the file ends here" };
            refused(&bytes, Place::Element("face", place), words);
        }
    }
}

#[test]
fn headers_within_limits_only() {
    let long_line = header(&format!("format ascii 1.0\ncomment {}\nelement vertex 0", "x".repeat(5000)));
    refused(&long_line, Place::Line(3), "longer than 4096");
    let long = header(&format!("format ascii 1.0\n{}element vertex 0", "comment x\n".repeat(7000)));
    assert!(matches!(read(&long), Err(Error::Data { why, .. }) if why.contains("longer than 65536")));
    for (lines, line, words) in [
        ("format ascii 1.1", 2, "version 1.1"),
        ("format text 1.0", 2, "format text"),
        ("format ascii 1.0\nformat ascii 1.0", 3, "second format"),
        ("element vertex 0", 3, "no format line"),
        ("format ascii 1.0\nproperty float x", 3, "before any element"),
        ("format ascii 1.0\nelement a 1\nelement a 2", 4, "second element a"),
        ("format ascii 1.0\nelement a 1\nproperty int x\nproperty float x", 5, "second property x"),
        ("format ascii 1.0\nelement a 1\nproperty real x", 4, "real is not a type"),
        ("format ascii 1.0\nelement a 1\nproperty list float int x", 4, "integer type"),
        ("format ascii 1.0\nelement a 1\nproperty list int x", 4, "not understood"),
        ("format ascii 1.0\nvertices 7", 3, "not understood"),
    ] {
        refused(&header(lines), Place::Line(line), words);
    }
    refused(&header("format ascii 1.0\nelement face 0"), Place::File, "no element vertex");
    let no_z = "format ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y";
    refused(&header(no_z), Place::File, "no property z");
    let empty = format!("{no_z}\nproperty float z");
    refused(&header(&empty), Place::File, "no point left: 0 in the file");
}

#[test]
fn lines_may_end_with_a_lone_carriage_return() {
    let text = "ply\rformat ascii 1.0\relement vertex 2\rproperty int x\rproperty int y\rproperty int z\rend_header\r1 2 3\r4 5 6\r";
    let cloud = read(text.as_bytes()).unwrap();
    assert_eq!((cloud.world(0), cloud.world(1)), (dvec3(1.0, 2.0, 3.0), dvec3(4.0, 5.0, 6.0)));
}

/// Text vertices with the given properties.
fn text(properties: &str, rows: &str) -> Vec<u8> {
    let lines: String = properties
        .split_whitespace()
        .collect::<Vec<_>>()
        .chunks(2)
        .fold(String::new(), |all, p| all + &format!("property {} {}\n", p[0], p[1]));
    let n = rows.lines().count();
    format!("ply\nformat ascii 1.0\nelement vertex {n}\n{lines}end_header\n{rows}\n").into_bytes()
}

const XYZ: &str = "float x float y float z";

#[test]
fn colours_of_every_kind() {
    let colors = |ty: &str, rows: &str| {
        let properties = format!("{XYZ} {ty} red {ty} green {ty} blue");
        read(&text(&properties, rows)).unwrap()
    };
    let bytes = colors("uchar", "0 0 0 1 2 3\n0 0 1 255 0 9");
    assert_eq!(bytes.colors.unwrap(), [[1, 2, 3], [255, 0, 9]]);
    let wide = colors("ushort", "0 0 0 257 514 771\n0 0 1 65535 0 128");
    assert_eq!(wide.colors.unwrap(), [[1, 2, 3], [255, 0, 0]]);
    let narrow = colors("ushort", "0 0 0 1 2 3\n0 0 1 255 0 9");
    assert_eq!(narrow.colors.unwrap(), [[1, 2, 3], [255, 0, 9]]);
    assert!(narrow.report.assumed.iter().any(|l| l.contains("8 bits")));
    let float = colors("float", "0 0 0 0 0.5 1\n0 0 1 0.2 nan -3");
    assert_eq!(float.colors.unwrap(), [[0, 128, 255], [51, 0, 0]]);
    assert_eq!(float.report.repaired, [("colour values that were not finite".to_owned(), 1)]);
    let big_float = colors("double", "0 0 0 0 100 200\n0 0 1 255 1 2");
    assert_eq!(big_float.colors.unwrap(), [[0, 100, 200], [255, 1, 2]]);
    let int = colors("int", "0 0 0 0 100 200\n0 0 1 255 1 -2");
    assert_eq!(int.colors.unwrap(), [[0, 100, 200], [255, 1, 0]]);
    let alpha = read(&text(&format!("{XYZ} uchar alpha"), "0 0 0 255\n0 0 1 51")).unwrap();
    assert_eq!(alpha.opacity.unwrap(), [1.0, 0.2]);
}

#[test]
fn broken_values_are_dropped_or_repaired_and_counted() {
    let rows = "0 0 0 0 0 2 1\nnan 0 0 0 0 1 1\n1 -inf 0 0 0 1 1\n0 1 0 0 0 0 -1\n0 0 1 0 nan 1 3\n-1.#IND 0 0 1 0 0 1";
    let mut bytes = text(&format!("{XYZ} float nx float ny float nz float radius"), rows);
    let at = bytes.windows(10).position(|w| w == b"end_header").unwrap();
    bytes.splice(at..at, *b"element face 3\nproperty list uchar int vertex_indices\n");
    bytes.extend(b"3 0 3 4\n3 0 1 4\n4 0 3 4 9\n");
    let cloud = read(&bytes).unwrap();
    assert_eq!(cloud.positions, [Vec3::ZERO, Vec3::Y, Vec3::Z]);
    assert_eq!(cloud.normals.as_deref().unwrap(), [Vec3::Z, Vec3::ZERO, Vec3::ZERO]);
    assert_eq!(cloud.radii.as_deref().unwrap(), [1.0, 3.0, 3.0]);
    assert_eq!(cloud.mesh.unwrap().triangles, [[0, 1, 2]]);
    let counted = |list: &[(String, u64)]| list.iter().map(|(r, n)| format!("{r}: {n}")).collect::<Vec<_>>();
    assert_eq!(
        counted(&cloud.report.dropped),
        ["non-finite coordinates: 3", "faces with corners out of range: 1", "faces on dropped points: 1"]
    );
    assert_eq!(
        counted(&cloud.report.repaired),
        [
            "normals that were zero or not finite: 2",
            "normals that were not of unit length: 1",
            "radii that were not positive: 1"
        ]
    );
    refused(&text(XYZ, "nan 0 0\n0 inf 0"), Place::File, "no point left: 2 in the file, 2 dropped for non-finite");
    let far = read(&text("double x double y double z", "0 0 0\n1 1 1\n2 2 2\n1e300 0 0")).unwrap();
    assert_eq!((far.len(), far.report.dropped[0].1), (3, 1));
}

#[test]
fn doubles_keep_their_precision_through_the_origin() {
    // 2 mm steps at UTM northings: f32 alone has half a metre there.
    let rows: Vec<String> = (0..500).map(|i| format!("515368.6{:03} 4918340.{:03} 2322.9", i, 2 * i % 1000)).collect();
    let cloud = read(&text("double x double y double z", &rows.join("\n"))).unwrap();
    for (i, row) in rows.iter().enumerate() {
        let told: Vec<f64> = row.split(' ').map(|w| w.parse().unwrap()).collect();
        // Offsets below 2 in f32, and the f64 spacing at 5e6.
        let off = (cloud.world(i) - dvec3(told[0], told[1], told[2])).abs().max_element();
        assert!(off <= 2.0 * 2f64.powi(-24) + 1e-9, "{off}");
    }
}

#[test]
fn polygons_become_fans_and_strips_are_unrolled() {
    let rows = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 2 0";
    let with = |element: &str, lines: &str| {
        let mut bytes = text(XYZ, rows);
        let at = bytes.windows(10).position(|w| w == b"end_header").unwrap();
        let n = lines.lines().count();
        bytes.splice(at..at, format!("element {element} {n}\nproperty list int int vertex_indices\n").into_bytes());
        bytes.extend(lines.bytes());
        read(&bytes).unwrap()
    };
    let fan = with("face", "5 0 1 2 4 3\n2 0 1\n3 0 1 1\n3 0 1 -1\n");
    assert_eq!(fan.mesh.unwrap().triangles, [[0, 1, 2], [0, 2, 4], [0, 4, 3]]);
    assert_eq!(fan.report.dropped.iter().map(|d| d.1).collect::<Vec<_>>(), [1, 1, 1]);
    let strip = with("tristrips", "9 0 1 3 2 -1 2 4 3 -1\n");
    assert_eq!(strip.mesh.unwrap().triangles, [[0, 1, 3], [3, 1, 2], [2, 4, 3]]);
}

#[test]
fn a_gaussian_has_the_disk_of_its_two_longer_axes() {
    let names = "f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties = names.split(' ').fold(XYZ.to_owned(), |all, n| all + " float " + n);
    // Shortest along y, turned by 90° about x (w = x = √½): y becomes z. Then one too faint to see, one without size.
    let h = std::f32::consts::FRAC_1_SQRT_2;
    let rows = format!(
        "0 0 0 0 1.7724539 -9 2 0 -3 0.6931472 {h} {h} 0 0\n1 0 0 0 0 0 -7 0 0 0 1 0 0 0\n2 0 0 0 0 0 0 999 999 0 1 0 0 0\n3 0 0 0 0 0 0 0 0 0 0 0 0 0"
    );
    let cloud = read(&text(&properties, &rows)).unwrap();
    assert_eq!(cloud.len(), 2);
    assert!(cloud.normals.as_ref().unwrap()[0].distance(vec3(0.0, 0.0, 1.0)) < 1e-6, "{:?}", cloud.normals);
    assert_eq!(cloud.normals.as_ref().unwrap()[1], Vec3::ZERO);
    // √(1 · 2) · 1.5; the logarithm is given to 7 digits, so 1e-7 relative, and f32 as much again.
    assert!((cloud.radii.as_ref().unwrap()[0] - 2.121_320_3).abs() < 1e-6, "{:?}", cloud.radii);
    // ½ + Y00 · √π = 1; a clamped negative.
    assert_eq!(cloud.colors.as_ref().unwrap()[0], [128, 255, 0]);
    assert!((cloud.opacity.as_ref().unwrap()[0] - 0.880_797).abs() < 1e-6);
    let counted: Vec<u64> = cloud.report.dropped.iter().map(|d| d.1).collect();
    assert_eq!((counted, cloud.report.repaired.len()), (vec![1, 1], 1));
}

#[test]
fn with_data_every_cut_of_a_real_file_ends_well() {
    for name in ["ply_crlf_header_binary.ply", "ply_big_endian_polygons.ply", "ply_float_color.ply", "ply_issue623.ply"]
    {
        let bytes = std::fs::read(data(&format!("bad/{name}"))).unwrap();
        for length in 0..bytes.len() {
            let _ = read(&bytes[..length]);
        }
    }
}
