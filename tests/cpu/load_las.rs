//! LAS and LAZ written by the tests: every point format, both kinds of chunks, every cut, and headers that lie.

use std::io::{Cursor, Write};
use std::path::Path;

use glam::{DVec3, Vec3};
use laz::{LasZipCompressor, LazVlr, LazVlrBuilder};
use proptest::prelude::*;
use surfel::load::{self, Options, PointCloud};
use surfel::{Error, Place, Result};

use crate::common::data;
use crate::load_files::check_promises;

const SCALE: [f64; 3] = [0.01, 0.001, 0.25];
const OFFSET: [f64; 3] = [5e5, 4.9e6, -10.0];
/// Bytes of a record of each format without extra ones.
const LENGTHS: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

#[derive(Debug, Clone, Copy, PartialEq)]
struct Point {
    xyz: [i32; 3],
    intensity: u16,
    class: u8,
    rgb: [u16; 3],
    withheld: bool,
}

fn color_at(format: u8) -> Option<usize> {
    [None, None, Some(20), Some(28), None, Some(28), None, Some(30), Some(30), None, Some(30)][usize::from(format)]
}

fn record(p: &Point, format: u8, extra: u16) -> Vec<u8> {
    let mut r = vec![0; usize::from(LENGTHS[usize::from(format)] + extra)];
    (0..3).for_each(|i| r[4 * i..4 * i + 4].copy_from_slice(&p.xyz[i].to_le_bytes()));
    r[12..14].copy_from_slice(&p.intensity.to_le_bytes());
    r[14] = 0x11;
    if format < 6 {
        r[15] = (p.class & 31) | u8::from(p.withheld) << 7;
    } else {
        r[15] = u8::from(p.withheld) << 2;
        r[16] = p.class;
    }
    if let Some(at) = color_at(format) {
        (0..3).for_each(|i| r[at + 2 * i..at + 2 * i + 2].copy_from_slice(&p.rgb[i].to_le_bytes()));
    }
    r
}

/// A header of LAS 1.4 for formats from 6, of 1.2 for the others, and the points; `chunk` compresses them.
fn file(points: &[Point], format: u8, extra: u16, chunk: Option<u32>) -> Vec<u8> {
    let minor = if format < 6 { 2 } else { 4 };
    let size: u16 = if minor == 4 { 375 } else { 227 };
    let mut head = vec![0; usize::from(size)];
    head[..4].copy_from_slice(b"LASF");
    head[24..26].copy_from_slice(&[1, minor]);
    head[94..96].copy_from_slice(&size.to_le_bytes());
    head[104] = format | if chunk.is_some() { 0x80 } else { 0 };
    head[105..107].copy_from_slice(&(LENGTHS[usize::from(format)] + extra).to_le_bytes());
    let count = points.len() as u64;
    if minor == 4 {
        head[247..255].copy_from_slice(&count.to_le_bytes());
    } else {
        head[107..111].copy_from_slice(&(count as u32).to_le_bytes());
    }
    for i in 0..3 {
        head[131 + 8 * i..139 + 8 * i].copy_from_slice(&SCALE[i].to_le_bytes());
        head[155 + 8 * i..163 + 8 * i].copy_from_slice(&OFFSET[i].to_le_bytes());
    }
    let records: Vec<u8> = points.iter().flat_map(|p| record(p, format, extra)).collect();
    let Some(chunk) = chunk else {
        head[96..100].copy_from_slice(&u32::from(size).to_le_bytes());
        return [head, records].concat();
    };
    let vlr: LazVlr =
        LazVlrBuilder::default().with_point_format(format, extra).unwrap().with_fixed_chunk_size(chunk).build();
    let mut content = Vec::new();
    vlr.write_to(&mut content).unwrap();
    let mut vlr_head = vec![0; 54];
    vlr_head[2..16].copy_from_slice(b"laszip encoded");
    vlr_head[18..20].copy_from_slice(&22204u16.to_le_bytes());
    vlr_head[20..22].copy_from_slice(&(content.len() as u16).to_le_bytes());
    head[100..104].copy_from_slice(&1u32.to_le_bytes());
    let start = u32::from(size) + 54 + content.len() as u32;
    head[96..100].copy_from_slice(&start.to_le_bytes());
    let mut out = Cursor::new(Vec::new());
    out.write_all(&[head, vlr_head, content].concat()).unwrap();
    let mut compressor = LasZipCompressor::new(out, vlr).unwrap();
    compressor.compress_many(&records).unwrap();
    compressor.done().unwrap();
    compressor.into_inner().into_inner()
}

fn read(bytes: &[u8]) -> Result<PointCloud> {
    let cloud = load::read(Path::new("test.las"), bytes, &Options::default());
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

fn points() -> impl Strategy<Value = Vec<Point>> {
    let point = (
        prop::array::uniform3(-100_000..100_000i32),
        any::<u16>(),
        0..32u8,
        prop::array::uniform3(any::<u16>()),
        0..10u8,
    );
    let point =
        point.prop_map(|(xyz, intensity, class, rgb, w)| Point { xyz, intensity, class, rgb, withheld: w == 0 });
    prop::collection::vec(point, 1..200)
}

/// What the specification says of each kept point.
fn check(cloud: &PointCloud, points: &[Point], format: u8) {
    let kept: Vec<&Point> = points.iter().filter(|p| !p.withheld).collect();
    assert_eq!(cloud.len(), kept.len());
    let withheld = cloud.report.dropped.iter().map(|d| d.1).sum::<u64>();
    assert_eq!(withheld as usize, points.len() - kept.len());
    let any = |f: fn(&Point) -> bool| kept.iter().any(|p| f(p));
    assert_eq!(cloud.intensity.is_some(), any(|p| p.intensity > 0));
    assert_eq!(cloud.classes.is_some(), any(|p| p.class > 0));
    assert_eq!(cloud.colors.is_some(), color_at(format).is_some() && any(|p| p.rgb != [0; 3]));
    let wide = any(|p| p.rgb.iter().any(|c| *c > 255));
    for (i, p) in kept.iter().enumerate() {
        let told = DVec3::from_array([0, 1, 2].map(|a| f64::from(p.xyz[a]) * SCALE[a] + OFFSET[a]));
        // Steps from the middle, at most 200 000, in f32; f64 near 4.9e6 three times.
        let bound = DVec3::from_array(SCALE) * 2e5 * 2f64.powi(-24) + 3e-9;
        assert!((cloud.world(i) - told).abs().cmple(bound).all(), "{} {told}", cloud.world(i));
        assert!(cloud.intensity.as_ref().is_none_or(|l| l[i] == f32::from(p.intensity)));
        assert!(cloud.classes.as_ref().is_none_or(|l| l[i] == p.class));
        let eight = p.rgb.map(|v| if wide { (f64::from(v) / 257.0).round() as u8 } else { v as u8 });
        assert!(cloud.colors.as_ref().is_none_or(|l| l[i] == eight));
    }
    assert_eq!(cloud.up, Some(Vec3::Z));
}

proptest! {
    // Compressing and decompressing unoptimised: 64 cases are about five seconds.
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_format_comes_back_plain_and_compressed(
        points in points(), format in 0u8..11, extra in 0u16..4, chunk in prop::option::of(prop::sample::select(vec![1u32, 7, 50, 1000])),
    ) {
        let kept = points.iter().any(|p| !p.withheld);
        match read(&file(&points, format, extra, chunk)) {
            Ok(cloud) => check(&cloud, &points, format),
            Err(e) => prop_assert!(!kept && e.to_string().contains("no point left"), "{}", e),
        }
    }

    #[test]
    fn no_bytes_make_it_panic(
        points in points(), format in 0u8..11, compressed: bool,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8), early: bool,
    ) {
        let mut bytes = file(&points, format, 1, compressed.then_some(50));
        let range = if early { bytes.len().min(500) } else { bytes.len() };
        for (at, value) in edits {
            bytes[at.index(range)] = value;
        }
        let _ = read(&bytes);
    }
}

fn some(n: i32) -> Vec<Point> {
    let point = |i: i32| Point {
        xyz: [i, -i, 2 * i],
        intensity: i as u16,
        class: 2,
        rgb: [i as u16 % 256; 3],
        withheld: false,
    };
    (0..n).map(point).collect()
}

#[test]
fn colours_of_eight_bits_in_sixteen_are_kept_until_a_wider_one_comes() {
    // More than one block of 65536 records: the first is taken for 8 bits, until the second shows that it was not.
    let mut points = some(70_000);
    let narrow = read(&file(&points, 2, 0, None)).unwrap();
    check(&narrow, &points, 2);
    assert!(narrow.report.assumed.iter().any(|l| l.contains("8 bits")));
    points[69_000].rgb = [65535, 0, 300];
    for chunk in [None, Some(5000)] {
        check(&read(&file(&points, 2, 0, chunk)).unwrap(), &points, 2);
    }
    points.iter_mut().for_each(|p| p.rgb = [0; 3]);
    let black = read(&file(&points, 2, 0, None)).unwrap();
    assert!(black.colors.is_none() && black.report.assumed == ["all colours in the file are zero: taken as absent"]);
}

#[test]
fn every_cut_is_an_error() {
    for (format, chunk) in [(0, None), (3, None), (7, None), (2, Some(20)), (6, Some(20)), (8, Some(1000))] {
        let whole = file(&some(70), format, 0, chunk);
        assert!(read(&whole).is_ok());
        for length in 0..whole.len() {
            match read(&whole[..length]) {
                Err(Error::Data { place, why, .. }) => {
                    let in_points =
                        chunk.is_none() && length >= whole.len() - 70 * usize::from(LENGTHS[usize::from(format)]);
                    let at_point = matches!(place, Place::Element("point", _));
                    assert!(at_point == in_points || chunk.is_some(), "{length}: {place:?} {why}");
                }
                // The table is the last thing in the file, and its coder may not need its own last bytes.
                Ok(cloud) => assert!(chunk.is_some() && length + 8 > whole.len() && cloud.len() == 70, "{length}"),
                Err(other) => panic!("{length} of {}: {other}", whole.len()),
            }
        }
    }
}

#[test]
fn headers_that_lie() {
    let good = file(&some(70), 0, 0, None);
    let with = |at: usize, bytes: &[u8]| {
        let mut lie = good.clone();
        lie[at..at + bytes.len()].copy_from_slice(bytes);
        lie
    };
    let more = with(107, &u32::MAX.to_le_bytes());
    refused(&more, Place::Element("point", 70), "the file ends here; the header promises 4294967295");
    assert_eq!(read(&with(107, &9u32.to_le_bytes())).unwrap().len(), 9);
    refused(&with(107, &[0; 4]), Place::File, "no point left: 0 in the file");
    refused(&with(25, &[9]), Place::File, "LAS version 1.9");
    refused(&with(104, &[11]), Place::File, "point format 11");
    refused(&with(105, &[19, 0]), Place::File, "too short for point format 0");
    refused(&with(96, &[0, 0, 0, 1]), Place::File, "the points are said to start at byte 16777216");
    refused(&with(96, &[3, 0, 0, 0]), Place::File, "the points are said to start at byte 3");
    refused(&with(131, &0f64.to_le_bytes()), Place::File, "scale factor is zero");
    refused(&with(139, &f64::NAN.to_le_bytes()), Place::File, "scale or offset is not finite");
    refused(&with(131, &1e307f64.to_le_bytes()), Place::File, "beyond every number");
    // Steps of 1e300 leave the one point that is the origin.
    assert_eq!(read(&with(131, &1e300f64.to_le_bytes())).unwrap().report.dropped[0].1, 69);
    refused(&with(104, &[0x80]), Place::File, "no LASzip record");
    assert_eq!(read(&with(100, &u32::MAX.to_le_bytes())).unwrap().len(), 70);
}

#[test]
fn compressed_files_that_lie() {
    let good = file(&some(70), 6, 0, Some(20));
    let with = |at: usize, bytes: &[u8]| {
        let mut lie = good.clone();
        lie[at..at + bytes.len()].copy_from_slice(bytes);
        lie
    };
    assert_eq!(read(&with(100, &u32::MAX.to_le_bytes())).unwrap().len(), 70, "the walk stops at the points");
    refused(&with(247, &(1u64 << 60).to_le_bytes()), Place::File, "points cannot be in");
    refused(&with(247, &81u64.to_le_bytes()), Place::Element("point", 80), "the header promises 81");
    refused(&with(247, &65u64.to_le_bytes()), Place::Element("point", 60), "another number of points");
    assert_eq!(read(&with(247, &60u64.to_le_bytes())).unwrap().len(), 60);
    let record = 375 + 54;
    refused(&with(record + 32, &[0, 0]), Place::File, "LASzip records of 0 bytes");
    refused(&with(record + 34, &[6, 0]), Place::File, "does not describe these points");
    refused(&with(record + 36, &[29, 0]), Place::File, "does not describe these points");
    refused(&with(record + 38, &[7, 0]), Place::File, "version 7");
    let start = record + 34 + 6;
    refused(&with(start, &[255; 8]), Place::File, "no chunk table");
    // A layer of four thousand million bytes: the sizes follow the first point (30 bytes) and the count.
    refused(&with(start + 8 + 34, &[255; 4]), Place::Element("point", 0), "shorter than its layers");
    // So many chunks that their table would fill the memory.
    let table = usize::try_from(u64::from_le_bytes(good[start..start + 8].try_into().unwrap())).unwrap();
    refused(&with(table + 4, &[255; 4]), Place::File, "more chunks than there is room for");
}

#[test]
fn with_data_every_cut_of_a_real_file_ends_well() {
    for name in ["las_bad_geotiff_keys.las", "las_bad_vlr_count.las", "las_unregistered_extra_bytes.las"] {
        let bytes = std::fs::read(data(&format!("bad/{name}"))).unwrap();
        for length in 0..bytes.len() {
            assert!(read(&bytes[..length]).is_err() || length > 500, "{name} {length}");
        }
    }
}

#[test]
fn with_data_damaged_streams_end_in_an_error_or_in_points_never_in_a_panic() {
    let bytes = std::fs::read(data("lone_star_utm.copc.laz")).unwrap();
    // The first chunks alone would do, but the table is at the end: damage bytes here and there.
    for k in 0..6 {
        let mut bad = bytes.clone();
        let step = 100_003 + 7919 * k;
        (20_000 + k..bad.len()).step_by(step).for_each(|at| bad[at] ^= 0x55);
        if let Err(e) = read(&bad) {
            assert!(matches!(e, Error::Data { .. }), "{e}");
        }
    }
}
