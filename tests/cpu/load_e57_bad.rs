//! E57 that lies, is damaged or is odd.

use e57::{RecordName, RecordValue};
use glam::{DQuat, DVec3, dvec3};
use proptest::prelude::*;
use surfel::load::{self, Options, Pieces};
use surfel::{Error, Place};

use crate::common::data;
use crate::e57_files::*;
use crate::folder::Folder;
use crate::load_files::check_promises;
use crate::stream_http::within_a_minute;

#[track_caller]
fn refused(bytes: &[u8], place: Place, words: &str) {
    let bytes = bytes.to_vec();
    match within_a_minute(move || read(&bytes)) {
        Err(Error::Data { place: found, why, .. }) => {
            assert!(why.contains(words), "{why}");
            assert_eq!(found, place, "{why}");
        }
        other => panic!("{other:?}"),
    }
}

/// Three pages or so: two scans, one of them with colours.
fn small() -> Vec<u8> {
    let places: Vec<DVec3> = (0..40).map(|i| dvec3(i as f64, (i % 7) as f64, 0.5)).collect();
    let mut fields = xyz(&e57::RecordDataType::F32);
    let names = [RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue];
    fields.extend(names.map(|n| field(n, integers(0, 200))));
    fields.push(field(RecordName::CartesianInvalidState, integers(0, 2)));
    let point = |i: i64| {
        let mut values: Vec<RecordValue> = [i as f32, 1.0, -2.0].map(RecordValue::Single).into();
        values.extend([i, 2 * i, 100, i % 3].map(RecordValue::Integer));
        values
    };
    let pose = Some((DQuat::from_rotation_y(0.5), dvec3(5.0, 6.0, 7.0)));
    file(&[Scan { pose, ..bare(&places) }, Scan { fields, points: (0..60).map(point).collect(), ..Default::default() }])
}

#[test]
fn every_cut_is_an_error() {
    let whole = small();
    assert!(read(&whole).is_ok());
    for length in 0..whole.len() {
        match read(&whole[..length]) {
            Err(Error::Data { place, why, .. }) => {
                assert!(length < 8 || place == Place::Byte(length as u64), "{length}: {place:?} {why}");
            }
            other => panic!("{length}: {other:?}"),
        }
    }
}

#[test]
fn every_damaged_byte_is_found_with_its_page() {
    let whole = small();
    let good = read(&whole).unwrap();
    for at in 8..whole.len() {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x10;
        match read(&bytes) {
            // The header's own numbers are looked at before its page's checksum.
            Err(Error::Data { .. }) if at < 48 => {}
            Err(Error::Data { place, why, .. }) => {
                let page = at as u64 / 1024;
                assert_eq!(place, Place::Byte(page * 1024), "{at}: {why}");
                assert!(why.contains(&format!("checksum of page {page} ")), "{why}");
            }
            Ok(cloud) => panic!("{at}: {} points of {}", cloud.len(), good.len()),
            other => panic!("{at}: {other:?}"),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// With checksums that are right, so that all that lies behind them meets nonsense.
    #[test]
    fn no_bytes_make_it_panic(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        thread_local!(static WHOLE: Vec<u8> = small());
        let mut bytes = WHOLE.with(Clone::clone);
        for (at, value) in edits {
            let at = 48 + at.index(bytes.len() - 48);
            bytes[at] = value;
        }
        sign(&mut bytes);
        if let Ok(cloud) = within_a_minute(move || read(&bytes)) {
            prop_assert!(cloud.len() <= 100);
        }
    }
}

/// Where the header says that the description is.
fn xml_at(bytes: &[u8]) -> Place {
    Place::Byte(u64::from_le_bytes(bytes[24..32].try_into().unwrap()))
}

fn replaced(scans: &[Scan], from: &str, to: &str) -> Vec<u8> {
    edited(scans, |xml| {
        assert!(xml.contains(from), "{xml}");
        xml.replacen(from, to, 1)
    })
}

#[test]
fn counts_that_lie_cost_nothing() {
    let one = [bare(&[DVec3::X, DVec3::Y])];
    let claim = |n: &str| replaced(&one, "recordCount=\"2\"", &format!("recordCount=\"{n}\""));
    refused(&claim("18446744073709551615"), Place::File, "points cannot be in");
    // There is room for three of these in the pages, but no packet that holds the third.
    refused(&claim("3"), Place::Element("point", 2), "the description promises 3");
    let none = claim("-1");
    refused(&none, xml_at(&none), "recordCount");
}

#[test]
fn points_without_bits_are_believed_up_to_a_million() {
    let point = vec![RecordValue::Integer(3); 3];
    let scan = [Scan { fields: xyz(&integers(3, 4)), points: vec![point; 2], ..Default::default() }];
    // The writer has no word for it.
    let constant = |xml: String| xml.replace("maximum=\"4\"", "maximum=\"3\"");
    let cloud = read(&edited(&scan, constant)).unwrap();
    assert_eq!((cloud.len(), cloud.world(1)), (2, DVec3::splat(3.0)));
    let many = edited(&scan, |xml| constant(xml).replace("recordCount=\"2\"", "recordCount=\"4000000000\""));
    refused(&many, Place::File, "4000000000 points cannot be in");
}

#[test]
fn scans_may_not_claim_the_same_bytes_again_and_again() {
    let points: Vec<DVec3> = (0..80).map(|i| DVec3::splat(i as f64)).collect();
    let bytes = edited(&[bare(&points)], |xml| {
        let (start, end) = (xml.find("<vectorChild").unwrap(), xml.find("</vectorChild>").unwrap() + 14);
        format!("{}{}{}", &xml[..start], xml[start..end].repeat(10), &xml[end..])
    });
    refused(&bytes, Place::File, "800 points cannot be in");
}

#[test]
fn descriptions_that_would_take_long_are_refused() {
    let one = [bare(&[DVec3::X])];
    let root = "<e57Root ";
    let attributes: String = (0..300_000).map(|i| format!("a{i}=\"\" ")).collect();
    let bytes = replaced(&one, root, &format!("{root}{attributes}"));
    refused(&bytes, xml_at(&bytes), "has a tag of thousands of bytes");
    let nested: String = (0..60_000).map(|i| format!("<a xmlns:a{i}=\"b\">")).collect();
    let bytes = replaced(&one, "<data3D ", &format!("{nested}<data3D "));
    refused(&bytes, xml_at(&bytes), "too many namespaces");
    // Depth alone is no harm, and what looks like a tag in a text is none.
    let deep = format!("{}{}", "<a>".repeat(50_000), "</a>".repeat(50_000));
    let text = format!("<b><![CDATA[<{}]]></b><!--<{}-->", "x ".repeat(5000), "y ".repeat(5000));
    assert_eq!(read(&replaced(&one, "<data3D ", &format!("{deep}{text}<data3D "))).unwrap().len(), 1);
}

#[test]
fn wrong_descriptions_say_what_is_wrong() {
    let one = [Scan { pose: Some((DQuat::IDENTITY, DVec3::X)), ..bare(&[DVec3::X]) }];
    let bytes = replaced(&one, "</points>", "</point>");
    refused(&bytes, xml_at(&bytes), "is not understood");
    let scan = Place::Element("scan", 0);
    let elsewhere = edited(&one, |xml| xml.replace("cartesianX", "elsewhere"));
    refused(&elsewhere, scan.clone(), "neither cartesian nor spherical");
    refused(&replaced(&one, "<w type=\"Float\">1<", "<w type=\"Float\">NaN<"), scan.clone(), "pose is not finite");
    let zero = read(&replaced(&one, "<w type=\"Float\">1<", "<w type=\"Float\">0<")).unwrap();
    assert_eq!(zero.world(0), dvec3(2.0, 0.0, 0.0));
    assert!(zero.report.assumed.iter().any(|l| l.contains("length zero")));
    // A quaternion that is not quite of unit length turns, and does not scale.
    let long = read(&replaced(&one, "<w type=\"Float\">1<", "<w type=\"Float\">1.5<")).unwrap();
    assert_eq!(long.world(0), dvec3(2.0, 0.0, 0.0));
    let scaled = e57::RecordDataType::ScaledInteger { min: 0, max: 9, scale: 0.5, offset: 0.0 };
    let points = vec![vec![RecordValue::ScaledInteger(1); 3]];
    let scaled = [Scan { fields: xyz(&scaled), points, ..Default::default() }];
    refused(&replaced(&scaled, "scale=\"0.5\"", "scale=\"0\""), scan, "a scale is zero");
    let away = replaced(&one, "fileOffset=\"48\"", "fileOffset=\"987654321\"");
    refused(&away, Place::File, "the binary section of a scan is said to be at byte 987654321");
    let wrong = replaced(&one, "fileOffset=\"48\"", "fileOffset=\"52\"");
    refused(&wrong, Place::Byte(52), "no binary section");
}

/// A page's worth of a packet that holds no points is put behind the first packet of data.
#[test]
fn packets_that_are_not_of_data_are_passed_over() {
    let points: Vec<DVec3> = (0..5000).map(|i| dvec3(i as f64, 0.5, 0.25)).collect();
    let bytes = file(&[bare(&points)]);
    let whole = read(&bytes).unwrap();
    let mut logical: Vec<u8> = bytes.chunks_exact(1024).flat_map(|page| page[..1020].to_vec()).collect();
    let first = 48 + 32;
    let length = usize::from(u16::from_le_bytes([logical[first + 2], logical[first + 3]])) + 1;
    for kind in [0, 2] {
        let mut gap = vec![0; 1020];
        gap[0] = kind;
        gap[2..4].copy_from_slice(&1019u16.to_le_bytes());
        let mut longer = logical.clone();
        longer.splice(first + length..first + length, gap);
        // All that lies behind is one page farther.
        for at in [16, 24] {
            let word = u64::from_le_bytes(longer[at..at + 8].try_into().unwrap()) + 1024;
            longer[at..at + 8].copy_from_slice(&word.to_le_bytes());
        }
        let mut bytes: Vec<u8> = longer.chunks_exact(1020).flat_map(|page| [page, &[0; 4]].concat()).collect();
        sign(&mut bytes);
        let cloud = read(&bytes).unwrap();
        assert!(cloud.positions == whole.positions && cloud.origin == whole.origin, "kind {kind}");
    }
    // A packet that claims more than it is.
    logical[first + 6..first + 8].copy_from_slice(&u16::MAX.to_le_bytes());
    let mut bytes: Vec<u8> = logical.chunks_exact(1020).flat_map(|page| [page, &[0; 4]].concat()).collect();
    sign(&mut bytes);
    refused(&bytes, Place::Byte(80), "a packet is shorter than what it says it holds");
}

#[test]
fn pieces_refuse_before_the_first_what_is_cut_short() {
    let folder = Folder::new("e57-short");
    let path = folder.0.join("a.e57");
    std::fs::write(&path, replaced(&[bare(&[DVec3::X; 9])], "recordCount=\"9\"", "recordCount=\"10\"")).unwrap();
    let error = Pieces::open(&path, &Options::default()).unwrap_err().to_string();
    assert!(error.contains("in point 9"), "{error}");
}

#[test]
fn with_data_every_odd_file_has_its_outcome() {
    let open = |name: &str| load::open(&data(&format!("bad/e57_{name}.e57")), &Options::default());
    let refused = |name: &str, place: Place, words: &str| match open(name) {
        Err(Error::Data { file, place: found, why }) => {
            assert!(file.ends_with(format!("bad/e57_{name}.e57")) && why.contains(words), "{name}: {why}");
            assert_eq!(found, place, "{name}: {why}");
        }
        other => panic!("{name}: {other:?}"),
    };
    refused("bad_crc_1k", Place::Byte(0), "checksum of page 0");
    refused("corrupt_crc", Place::Byte(33 * 1024), "checksum of page 33");
    refused("empty", Place::File, "there is no scan in the file");
    refused("zero_points", Place::File, "no point left: 0 in the file");
    refused("invalid_cv_header", Place::File, "no point left: 0 in the file");
    let good = |name: &str| {
        let cloud = open(name).unwrap_or_else(|e| panic!("{e}"));
        check_promises(&cloud);
        cloud
    };
    let one = good("no_ext_namespace");
    assert_eq!((one.len(), one.world(0)), (1, dvec3(1.0, 2.0, 3.0)));
    let las = good("las_extension");
    // 16 bits without limits, and the values need them.
    assert_eq!((las.len(), las.viewpoint, las.colors.is_some()), (153, None, true));
    assert!(las.colors.iter().flatten().flatten().any(|c| *c == 254), "65280 of 65535");
    let ranges = good("spherical");
    // Half of them are marked: the direction is known, the range is not.
    assert_eq!((ranges.len(), ranges.report.points_in_file), (180, 360));
    assert!((0..180).all(|i| (ranges.world(i).length() - 1.0).abs() < 1e-6));
    let zeros = good("read_error");
    assert_eq!((zeros.len(), zeros.angular_step), (2651, None), "all at one place");
    for name in ["bad_crc_1k", "corrupt_crc", "empty", "zero_points", "invalid_cv_header"] {
        assert!(Pieces::open(&data(&format!("bad/e57_{name}.e57")), &Options::default()).is_err(), "{name}");
    }
}
