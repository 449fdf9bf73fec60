//! `surfel bench`: what it writes, that it goes on where it was, and that it refuses what cannot be compared.

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::fs;
use std::process::{Command, Output};

use serde_json::Value;

use crate::folder::Folder;

fn surfel(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_surfel")).args(args).output().expect("the binary")
}

fn done(args: &[&str]) -> String {
    let output = surfel(args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {said}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn refused(args: &[&str], code: i32, says: &str) {
    let output = surfel(args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(code) && said.contains(says), "{args:?}: {:?} {said}", output.status);
}

/// A sphere of 24 × 12 quads, each two triangles.
fn mesh(path: &str) {
    let (n, m) = (24, 12);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        n * (m + 1),
        2 * n * m
    );
    for j in 0..=m {
        for i in 0..n {
            let (a, b) = (2.0 * PI * i as f64 / n as f64, PI * j as f64 / m as f64);
            let _ = writeln!(text, "{} {} {}", b.sin() * a.cos(), b.cos(), -b.sin() * a.sin());
        }
    }
    for j in 0..m {
        for i in 0..n {
            let (k, right) = (j * n + i, j * n + (i + 1) % n);
            let _ = writeln!(text, "3 {k} {} {right}\n3 {right} {} {}", k + n, k + n, right + n);
        }
    }
    fs::write(path, text).expect("a mesh");
}

fn results(folder: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(format!("{folder}/results.json")).expect("results")).expect("JSON")
}

#[test]
fn a_sweep_is_judged_kept_and_gone_on_with() {
    let folder = Folder::new("bench-sweep");
    let (ply, out) = (folder.path("mesh.ply"), folder.path("out"));
    mesh(&ply);
    let sweep = [
        "bench",
        &ply,
        "--out",
        &out,
        "--views",
        "2",
        "--sizes",
        "64x80",
        "--rounds",
        "5",
        "--frames",
        "1",
        "--samples",
        "500,2000",
        "--techniques",
        "flat.two-pass.point,flat.opaque.quad",
    ];
    let said = done(&sweep);
    assert!(
        said.starts_with(&format!("{out}/report.html\n")) && said.contains("flat.opaque.quad 2000 points"),
        "{said}"
    );

    let all = results(&out);
    let records = all["records"].as_array().expect("records");
    assert_eq!(records.len(), 2 * 2 * 2);
    for r in records {
        let samples = r["samples"].as_u64().expect("samples");
        assert_eq!(r["points_submitted"].as_u64(), Some(samples), "{r}");
        for times in ["gpu_ms", "frame_ms"] {
            let times = r[times].as_array().expect("times");
            assert!(times.len() == 5 && times.iter().all(|t| t.as_f64() > Some(0.0)), "{r}");
        }
        let error = |key: &str| r["errors"][key].as_f64().unwrap_or_else(|| panic!("no {key}: {r}"));
        // A sphere as high as the picture, drawn in the right place: even 500 discs are no tenth of the range off.
        assert!(error("rmse") < 0.1 && error("flip") < 0.2 && error("covered_truth") > 1000.0, "{r}");
        assert!(r["truth"].as_str().expect("truth").contains("ray cast"), "{r}");
        for file in ["picture", "truth_file"] {
            let path = format!("{out}/{}", r[file].as_str().expect("a name"));
            assert!(fs::metadata(&path).expect(&path).len() > 100, "{path}");
        }
    }
    let interior = |n: u64| -> f64 {
        let of = records.iter().filter(|r| r["samples"] == n && r["technique"] == "flat.two-pass.point");
        of.map(|r| r["errors"]["rmse_interior"].as_f64().expect("an interior")).sum()
    };
    assert!(interior(2000) < 0.75 * interior(500), "more points are nearer to the truth");
    let ceilings = all["ceilings"].as_array().expect("ceilings");
    assert!(!ceilings.is_empty() && ceilings.iter().all(|c| c["points_per_second"][0].as_f64() > Some(0.0)));

    let report = fs::read_to_string(format!("{out}/report.html")).expect("a report");
    // Two of time against error, one of convergence; a truth and a picture a way; nothing from elsewhere.
    assert_eq!((report.matches("<svg").count(), report.matches("<figure").count()), (3, 5));
    assert!(!report.contains("href=") && !report.contains("src=\"http"), "self-contained");
    let csv = fs::read_to_string(format!("{out}/results.csv")).expect("a table");
    assert_eq!(csv.lines().count(), 9);

    // Again: nothing is measured anew. Cut in the middle of a line: only what was cut is.
    let journal = format!("{out}/journal.jsonl");
    let before = fs::read_to_string(&journal).expect("a journal");
    done(&sweep);
    assert_eq!(fs::read_to_string(&journal).expect("a journal"), before);
    fs::write(&journal, &before[..before.len() - 20]).expect("a shorter journal");
    done(&sweep);
    let after = fs::read_to_string(&journal).expect("a journal");
    let kept = before.lines().count() - 1;
    assert_eq!(after.lines().count(), before.lines().count());
    assert!(after.lines().take(kept).eq(before.lines().take(kept)), "what was whole is as it was");
    assert_eq!(results(&out)["records"].as_array().expect("records").len(), 8);

    // What was deleted or broken is made again, with all that was judged by it.
    let text = |key: &str| format!("{out}/{}", records[0][key].as_str().expect("a name"));
    let (picture, truth) = (text("picture"), text("truth_file"));
    let whole = fs::read(&truth).expect("a truth");
    fs::remove_file(&picture).expect("a picture");
    fs::write(&truth, &whole[..whole.len() / 2]).expect("half a truth");
    done(&sweep);
    assert!(fs::metadata(&picture).is_ok() && fs::read(&truth).expect("a truth") == whole);
    assert_eq!(fs::read_to_string(&journal).expect("a journal").lines().count(), after.lines().count() + 1);
    assert_eq!(results(&out)["records"].as_array().expect("records").len(), 8);

    // Another look is another bench; so says the folder.
    refused(&[&sweep[..], &["--shade", "none"]].concat(), 1, "look was");
    let more = folder.path("more");
    let old = format!("{out}/results.json");
    refused(&[&sweep[..], &["--baseline", &old]].concat(), 1, "would be overwritten");
    let against = [&sweep[..3], &[&more], &sweep[4..], &["--baseline", &old]].concat();
    let said = done(&against);
    assert!(said.contains("8 cases compared") && !said.contains("WARNING"), "{said}");
}

#[test]
fn points_without_faces_are_judged_by_all_of_them() {
    let folder = Folder::new("bench-points");
    let out = folder.path("out");
    let sweep = ["bench", "scene:sphere:3k", "--out", &out, "--views", "1", "--sizes", "64x64", "--rounds", "1", "-q"];
    let one = ["--techniques", "flat.two-pass.point", "--scales", "1,0.5", "--sums", "half"];
    assert_eq!(done(&[&sweep[..], &one[..]].concat()), format!("{out}/report.html\n"));
    let all = results(&out);
    let records = all["records"].as_array().expect("records");
    assert_eq!(records.len(), 2);
    assert!(records.iter().all(|r| r["truth"].as_str().expect("truth").contains("two-pass in f64")), "{records:?}");
    // Disks of half the radius leave holes.
    let holes = |i: usize| records[i]["errors"]["holes"].as_u64().expect("holes");
    assert!(holes(1) > holes(0), "{} {}", holes(0), holes(1));
    refused(&[&sweep[..], &["--truth", "mesh"]].concat(), 1, "truth was");
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let folder = Folder::new("bench-refused");
    let out = folder.path("out");
    let bench = |more: &[&'static str]| [&["bench", "scene:sphere:1k", "--out", &out], more].concat();
    refused(&bench(&["--radius", "px:2"]), 2, "--scales");
    refused(&bench(&["--samples", "100", "--views", "1"]), 1, "no faces");
    refused(
        &["bench", "scene:sphere:1k", "--out", &folder.path("b"), "--truth", "mesh", "--views", "1"],
        1,
        "no faces",
    );
    refused(&bench(&["--techniques", "nothing"]), 2, "nothing");
    refused(&bench(&["--sizes", "0x5"]), 2, "--sizes");
    refused(&bench(&["--background", "ffffff00"]), 2, "opaque");
    refused(&bench(&["--sizes", "4000000000x4000000000"]), 1, "of memory");
    refused(&bench(&["--samples", "4000000000"]), 2, "--samples");
    refused(&bench(&["scene:sphere:1k"]), 2, "scene:sphere:1000:1");
    refused(&["bench", "--out", &out], 2, "INPUT");
    refused(&["bench", &folder.path("none.ply"), "--out", &out], 1, "none.ply");
    let broken = folder.path("old.json");
    fs::write(&broken, "{\"schema\": \"other\"}").expect("a file");
    refused(&["bench", "scene:sphere:1k", "--out", &out, "--baseline", &broken], 1, "not a report");
}
