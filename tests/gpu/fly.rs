//! `surfel fly` as a user runs it: laps, statistics that add up, pictures, and what it refuses.

use std::fs;
use std::process::{Command, Output};

use serde_json::Value;

use crate::folder::Folder;

fn surfel(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_surfel")).args(args).output().expect("the binary starts")
}

fn built(folder: &Folder, name: &str, scene: &str, patch: &str) -> String {
    let path = folder.path(name);
    let output = surfel(&["build", scene, "-o", &path, "--patch", patch, "--groups", "-q"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    path
}

/// Flies with the layers on, so that code 0 also says that they were silent.
fn flown(folder: &Folder, model: &str, more: &[&str]) -> Value {
    let stats = folder.path("stats.json");
    let mut args = vec!["fly", model, "--size", "120x90", "--validate", "-q", "--stats", &stats];
    args.extend(more);
    let output = surfel(&args);
    assert_eq!(output.status.code(), Some(0), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_str(&fs::read_to_string(&stats).expect("statistics")).expect("JSON")
}

#[test]
fn laps_have_an_account_that_adds_up() {
    let folder = Folder::new("fly");
    let model = built(&folder, "m.lpc", "scene:torus:20000", "512");
    let pictures = folder.path("pictures");
    let keys = folder.path("keys.json");
    let text = r#"{"keys": [{"eye": [3, 0, 1], "target": [0, 0, 0]}, {"eye": [0, 3, 1], "target": [0, 0, 0]}]}"#;
    fs::write(&keys, text).expect("key frames");
    for more in [
        &["--frames", "8", "--save", &pictures, "--every", "4"][..],
        &["--frames", "6", "--path", "approach", "--blend", "two-pass", "--cache", "200000", "--no-occlusion"],
        &["--frames", "6", "--path", "street", "--blend", "opaque", "--ms", "20"],
        &["--frames", "5", "--path", &keys, "--laps", "3", "--points", "3000"],
        &["--frames", "1", "--laps", "1"],
        &["--frames", "4", "--blend", "groups"],
    ] {
        let stats = flown(&folder, &model, more);
        assert_eq!(stats["samples"], 20_000, "{more:?}");
        for lap in stats["laps"].as_array().expect("laps") {
            let of = |name: &str| lap["patches"][name].as_u64().unwrap_or_else(|| panic!("{more:?}: no {name}: {lap}"));
            let sum: u64 = ["drawn", "frustum", "cone", "missing", "occluded"].into_iter().map(of).sum();
            assert_eq!(of("visited"), sum, "{more:?}");
            assert_eq!(lap["fetched"]["faults"], 0, "{more:?}");
            let frame = &lap["frame_ms"];
            let at = |name: &str| frame[name].as_f64().expect("a time");
            assert!(0.0 < at("p50") && at("p50") <= at("p90") && at("p90") <= at("p99") && at("p99") <= at("max"));
            assert!(lap["samples"]["max"].as_f64().expect("samples") <= 20_000.0);
            if more.contains(&"--points") {
                assert!(lap["samples"]["max"].as_f64().expect("samples") <= 3000.0, "the budget is kept: {lap}");
            }
        }
    }
    let saved = |lap: u32, frame: u32| format!("{pictures}/lap{lap}-{frame:05}.png");
    let last = image::open(saved(2, 4)).expect("a picture of the second lap").to_rgba8();
    let first = *last.get_pixel(0, 0);
    assert!(last.pixels().filter(|p| **p != first).count() > 500, "something is seen");
    assert!(fs::metadata(saved(2, 5)).is_err(), "every fourth frame only");
}

#[test]
fn the_smallest_models_are_flown_through() {
    let folder = Folder::new("fly-small");
    let one = folder.path("one.ply");
    let head =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    fs::write(&one, format!("{head}1 2 3\n")).expect("a file");
    let model = built(&folder, "one.lpc", &one, "512");
    for path in ["orbit", "approach", "street"] {
        let stats = flown(&folder, &model, &["--frames", "3", "--path", path]);
        assert_eq!((&stats["samples"], &stats["nodes"]), (&Value::from(1), &Value::from(1)), "{path}");
    }
}

#[test]
fn what_cannot_be_flown_is_refused() {
    let folder = Folder::new("fly-refused");
    let model = folder.path("m.lpc");
    assert_eq!(surfel(&["build", "scene:sphere:500", "-o", &model, "-q"]).status.code(), Some(0));
    let (text, cut) = (folder.path("text.lpc"), folder.path("cut.lpc"));
    fs::write(&text, "no model").expect("a file");
    let bytes = fs::read(&model).expect("the model");
    fs::write(&cut, &bytes[..bytes.len() - 9]).expect("a file");
    let keys = folder.path("keys.json");
    fs::write(&keys, r#"{"keys": []}"#).expect("a file");
    let missing = folder.path("nowhere.lpc");
    for (args, code, says) in [
        (vec![missing.as_str()], 1, "nowhere.lpc"),
        (vec![&text], 1, "text.lpc: is no layered point cloud"),
        (vec![&cut], 1, "cut.lpc"),
        (vec!["scene:sphere:100"], 2, "surfel build"),
        (vec![&model, "--path", &keys], 1, "keys"),
        (vec![&model, "--path", "sideways"], 2, "orbit"),
        (vec![&model, "--points", "5", "--ms", "3"], 2, "--ms"),
        (vec![&model, "--frames", "0"], 2, "frames"),
        (vec![&model, "--blend", "groups"], 1, "m.lpc: was built without groups: `surfel build --groups`"),
    ] {
        let output = surfel(&[&["fly"][..], &args].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
        assert!(said.contains(says), "{args:?}: {said}");
    }
}
