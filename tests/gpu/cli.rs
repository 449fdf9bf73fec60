//! `surfel render` as a user runs it: exit codes, pictures, statistics.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

use crate::common::data;
use crate::folder::Folder;

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Small and with the layers on, so that code 0 also says that they were silent.
pub fn render(inputs: &[&str], out: &str, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_surfel"));
    command.arg("render").args(inputs).args(["-o", out, "--frames", "2", "--validate"]).args(more);
    if !more.contains(&"--size") {
        command.args(["--size", "160x120"]);
    }
    command.output().expect("the binary starts")
}

fn rendered(inputs: &[&str], out: &str, more: &[&str]) -> image::RgbaImage {
    let output = render(inputs, out, more);
    assert_eq!(output.status.code(), Some(0), "{inputs:?} {more:?}: {}", stderr(&output));
    image::open(out).expect("a picture").to_rgba8()
}

/// Pixels that are not the background's, which is transparent.
fn covered(picture: &image::RgbaImage) -> usize {
    picture.pixels().filter(|p| p[3] > 0).count()
}

fn stats(path: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(path).expect("statistics")).expect("JSON")
}

fn count(v: &Value) -> u64 {
    v.as_u64().unwrap_or_else(|| panic!("{v} is a count"))
}

fn adds_up(v: &Value) {
    let culled: u64 = v["culled"].as_object().unwrap().values().map(count).sum();
    assert_eq!(count(&v["points_submitted"]), count(&v["points_drawn"]) + culled, "{v:#}");
}

#[test]
fn the_demo_renders_and_its_statistics_add_up() {
    let folder = Folder::new("render-demo");
    let (out, json) = (folder.path("demo.png"), folder.path("demo.json"));
    let picture = rendered(&["scene:demo:20k"], &out, &["--stats", &json, "--background", "00000000"]);
    assert_eq!(picture.dimensions(), (160, 120));
    assert!(covered(&picture) > 160 * 120 / 8, "{}", covered(&picture));
    let v = stats(&json);
    let keys = "assumed blend blend_drawn culled device device_bytes draw_calls driver frame_ms_median gpu_ms_median \
                height layer_bytes layers ordered_access passes peak_rss_bytes points_drawn points_input points_submitted prepare_ms_median skipped structure sums threshold \
                triangles_submitted validation_messages width";
    assert_eq!(
        v.as_object().unwrap().keys().map(String::as_str).collect::<Vec<_>>(),
        keys.split_whitespace().collect::<Vec<_>>()
    );
    adds_up(&v);
    assert_eq!((&v["points_input"], &v["points_submitted"]), (&20_000.into(), &20_000.into()));
    assert_eq!((&v["width"], &v["height"], &v["blend"]), (&160.into(), &120.into(), &"fuzzy".into()));
    assert_eq!((&v["blend_drawn"], &v["ordered_access"]), (&"fuzzy".into(), &"rasterization-order".into()));
    assert_eq!(v["validation_messages"], 0);
    assert!(v["frame_ms_median"].as_f64() > Some(0.0) && count(&v["device_bytes"]) > 20_000 * 16);
    let names: Vec<_> = v["passes"].as_array().unwrap().iter().map(|p| p["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["fuzzy", "composite"]);
}

#[test]
fn what_is_outside_is_counted_as_culled() {
    let folder = Folder::new("render-outside");
    let (out, json) = (folder.path("a.png"), folder.path("a.json"));
    // From the middle of the sphere most of it is behind or beside the viewer.
    rendered(&["scene:sphere:5k"], &out, &["--orbit", "0,0,0", "--cull", "off", "--stats", &json]);
    let v = stats(&json);
    adds_up(&v);
    assert!(count(&v["culled"]["frustum"]) > 2_500, "{v:#}");
    rendered(&["scene:sphere:5k"], &out, &["--cull", "on", "--stats", &json]);
    let v = stats(&json);
    adds_up(&v);
    assert!(count(&v["culled"]["cone"]) > 2_000, "{v:#}");
}

#[test]
fn every_option_is_taken() {
    let folder = Folder::new("render-options");
    let out = folder.path("a.png");
    let mut pictures = Vec::new();
    for more in [
        "",
        "--blend opaque",
        "--primitive quad --ellipse approximate",
        "--shade none",
        "--shade phong",
        "--shade edl",
        "--edl 2",
        "--color height",
        "--color normal",
        "--color intensity",
        "--color class",
        "--radius 0.05",
        "--radius scale:2",
        "--radius px:3",
        "--radius px:3 --shade headlight",
        "--tolerance 0.5 --threshold 1 --structure flat --warmup 1",
        "--eye 0,3,3 --target 0,0,0 --up 0,0,1 --fov 60",
        "--eye 0,0,5 --target 0,0,0",
        "--orbit -30,90,3 --up -x",
        "--quiet",
        "--blend two-pass",
        "--front first --storage back-to-front",
        "--storage morton --sums half",
        "--blend groups --group-factor 0.8 --group-limit 12",
        "--blend groups --voronoi slabs --storage random",
        "--structure sequential --threshold 3",
        "--structure sequential --error split --clusters --selection vertex",
        "--structure sequential --interval published --blend two-pass --block 100",
        "--structure one-spt --threshold 2 --blend opaque",
        "--structure spt-r --blend groups --group-limit 20",
        "--structure vbo-r --block 200",
        "--structure espt --threshold 4 --primitive quad",
        "--structure mospt --block 50 --threshold 2.5",
        "--structure r-grid --radius scale:2",
        "--radius angle:0.5 --scanner 0,0,6",
    ] {
        let more: Vec<&str> = more.split_whitespace().chain(["--background", "00000000"]).collect();
        let picture = rendered(&["scene:torus:3k"], &out, &more);
        assert!(covered(&picture) > 500, "{more:?}: {} pixels", covered(&picture));
        pictures.push(picture);
    }
    assert_ne!(pictures[0], pictures[3], "light is seen");
    assert_ne!(pictures[0], pictures[7], "heights are seen");
    assert_eq!(pictures[0], pictures[19], "quiet changes nothing");
}

#[test]
fn groups_are_made_once() {
    let folder = Folder::new("render-groups");
    let (out, json, kept) = (folder.path("a.png"), folder.path("a.json"), folder.path("a.groups"));
    let with = |more: &[&str]| {
        let more = [&["--blend", "groups", "--groups", &kept, "--stats", &json], more].concat();
        render(&["scene:torus:3k"], &out, &more)
    };
    let said = |output: Output| {
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let v = stats(&json);
        assert!(count(&v["layers"]) > 1 && count(&v["layer_bytes"]) == 160 * 120 * 44 * count(&v["layers"]), "{v:#}");
        let lines = v["assumed"].as_array().unwrap().iter().map(|l| l.as_str().unwrap().to_owned());
        lines.filter(|l| l.starts_with("groups: ")).collect::<Vec<_>>()
    };
    let made = said(with(&[]));
    let read = said(with(&[]));
    assert!(made.len() == 1 && made[0].ends_with("made") && read[0].ends_with("read"), "{made:?} {read:?}");
    // Of other options: a line that names the file, which stays as it is.
    let before = fs::read(&kept).unwrap();
    let other = with(&["--group-factor", "0.5"]);
    assert!(
        other.status.code() == Some(1) && stderr(&other).contains("a.groups: holds the groups of"),
        "{}",
        stderr(&other)
    );
    assert_eq!(fs::read(&kept).unwrap(), before);
    fs::write(&kept, &before[..before.len() / 2]).unwrap();
    let cut = with(&[]);
    assert!(cut.status.code() == Some(1) && stderr(&cut).contains("a.groups at byte"), "{}", stderr(&cut));
}

#[test]
fn packed_points_look_the_same() {
    let folder = Folder::new("render-packing");
    let json = folder.path("a.json");
    for structure in ["flat", "mospt"] {
        let draw = |packing: &str| {
            let out = folder.path(&format!("{structure}-{packing}.png"));
            let more = ["--structure", structure, "--packing", packing, "--stats", &json];
            let done = render(&["scene:torus:30k"], &out, &more);
            assert_eq!(done.status.code(), Some(0), "{packing}: {}", stderr(&done));
            let stats = stats(&json);
            let said = stats["assumed"].to_string().contains(&format!("{packing}, radii at most"));
            assert_eq!(said, packing != "full", "{packing}: {}", stats["assumed"]);
            (image::open(out).expect("a picture").to_rgba8(), stats["device_bytes"].as_u64().expect("bytes"))
        };
        let [(full, most), (exact, fewer), (quantised, fewest)] = ["full", "exact", "quantised"].map(draw);
        assert!(most > fewer && fewer > fewest, "{structure}: {most} {fewer} {fewest}");
        for packed in [exact, quantised] {
            // Colours are off by 2 steps of 255 and normals by 0.0168 rad, of which light makes 4.3 steps; rims average out.
            let differences = full.iter().zip(packed.iter()).map(|(a, b)| a.abs_diff(*b) as f64);
            let mean = differences.sum::<f64>() / (4 * covered(&full)) as f64;
            assert!(mean < 6.3 && mean > 0.0, "{structure}: {mean}");
        }
    }
}

#[test]
fn a_far_view_submits_less_and_looks_the_same() {
    let folder = Folder::new("render-levels");
    let (out, json) = (folder.path("a.png"), folder.path("a.json"));
    let submitted = |structure: &str| {
        let more = ["--structure", structure, "--orbit", "30,20,12", "--stats", &json];
        let picture = rendered(&["scene:torus:100k"], &out, &more);
        (count(&stats(&json)["points_submitted"]), covered(&picture))
    };
    let (all, pixels) = submitted("flat");
    for structure in ["sequential", "one-spt", "spt-r", "espt", "mospt", "poisson", "r-grid"] {
        let (few, shown) = submitted(structure);
        assert!(few * 8 < all, "{structure}: {few} of {all}");
        // A rim of some 100 px may be a pixel wider or narrower.
        assert!(shown.abs_diff(pixels) < 110, "{structure}: {shown} pixels, {pixels} of all points");
    }
}

#[test]
fn what_makes_no_sense_for_a_blend_is_refused() {
    let folder = Folder::new("render-blends");
    let out = folder.path("a.png");
    for (more, code) in [
        ("--blend groups --group-factor 1.5", 2),
        ("--threshold 0", 2),
        ("--threshold nan", 2),
        ("--structure mospt --storage morton", 2),
        ("--structure flat --tree a.tree", 2),
        ("--packing tight", 2),
        ("--structure espt --blend groups --groups a.groups", 2),
        ("--structure sequential --error cell", 2),
        ("--structure hybrid --samples 9", 2),
        ("--samples 0", 2),
        ("--structure espt --block 0", 2),
        ("--radius angle:90", 2),
        ("--radius angle:1", 1),
        ("--radius angle:auto", 2),
        ("--blend groups --group-factor nan", 2),
        ("--blend groups --group-limit 0", 2),
        ("--groups a.groups", 2),
        ("--tolerance 0", 2),
        ("--tolerance nan", 2),
        ("--blend fuzzy --radius px:3", 2),
        ("--without warpDrive", 1),
    ] {
        let output = render(&["scene:torus:3k"], &out, &more.split(' ').collect::<Vec<_>>());
        assert_eq!(output.status.code(), Some(code), "{more}: {}", stderr(&output));
        assert!(!Path::new(&out).exists(), "{more}: a picture was written");
    }
}

#[test]
fn what_a_device_cannot_is_said() {
    let folder = Folder::new("render-without");
    let (out, json) = (folder.path("a.png"), folder.path("a.json"));
    let names = "rasterizationOrderColorAttachmentAccess,shaderOutputLayer";
    let mut pictures = Vec::new();
    for blend in ["two-pass", "fuzzy", "groups"] {
        let more = ["--blend", blend, "--without", names, "--stats", &json];
        pictures.push(rendered(&["scene:torus:3k"], &out, &more));
        let v = stats(&json);
        assert_eq!((&v["blend"], &v["blend_drawn"]), (&blend.into(), &"two-pass".into()));
        assert!(v["ordered_access"].is_null() && v["layers"] == 0);
    }
    assert!(pictures[0] == pictures[1] && pictures[0] == pictures[2]);
}

#[test]
fn with_data_two_inputs_are_one_picture() {
    let folder = Folder::new("render-two");
    let (out, json) = (folder.path("a.png"), folder.path("a.json"));
    let pond = data("pond_mvs_normals.ply");
    // Different kinds stay apart and are drawn in one frame.
    rendered(&["scene:torus:3k", &pond.to_string_lossy()], &out, &["--stats", &json]);
    let v = stats(&json);
    adds_up(&v);
    assert_eq!(count(&v["points_input"]), 73_051);
    assert_eq!(count(&v["points_submitted"]), 73_051);
    rendered(&["scene:sphere:1k", "scene:torus:1k"], &out, &["--stats", &json]);
    assert_eq!(count(&stats(&json)["points_input"]), 2_000);
}

#[test]
fn with_data_failures_have_code_one_and_one_line() {
    let folder = Folder::new("render-failures");
    let out = folder.path("a.png");
    let fails = |inputs: &[&str], more: &[&str], says: &str| {
        let output = render(inputs, &out, more);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(text.lines().count() == 1 && text.starts_with("surfel: ") && text.contains(says), "{text}");
        assert!(!Path::new(&out).exists(), "no picture where there was an error");
    };
    fails(&["scene:torus:99"], &["--device", "no such device"], "no device of that name");
    fails(&["scene:torus:99"], &["--size", "1000000x1"], "limit");
    fails(&["scene:torus:99"], &["--size", "4000000000x4000000000"], "memory");
    fails(&[&data("bad/ply_zero_bytes.ply").to_string_lossy()], &[], "ply_zero_bytes.ply");
    let left = fs::read_dir(&folder.0).unwrap().count();
    assert_eq!(left, 0, "nothing was left behind");
}

#[test]
fn with_data_every_bad_file_ends_in_an_error_or_a_picture() {
    let folder = Folder::new("render-bad");
    let (out, json) = (folder.path("a.png"), folder.path("a.json"));
    let bad = data("bad/ply_zero_bytes.ply");
    let mut pictures = 0;
    for entry in fs::read_dir(bad.parent().unwrap()).unwrap() {
        let path = entry.unwrap().path();
        let output = render(&[&path.to_string_lossy()], &out, &["--stats", &json]);
        let text = stderr(&output);
        match output.status.code() {
            Some(0) => {
                adds_up(&stats(&json));
                pictures += 1;
            }
            Some(1) => assert_eq!(text.lines().count(), 1, "{text}"),
            other => panic!("{}: {other:?} {text}", path.display()),
        }
    }
    assert!(pictures >= 10, "{pictures} pictures");
}
