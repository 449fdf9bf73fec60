//! Scene files on the device: one cloud, drawn many times.

use std::fs;
use std::process::Command;

use serde_json::Value;

use crate::folder::Folder;

/// With the layers on: code 0 says that they were silent.
fn render(input: &str, out: &str, more: &str) -> (image::RgbaImage, Value) {
    let stats = format!("{out}.json");
    let output = Command::new(env!("CARGO_BIN_EXE_surfel"))
        .args(["render", input, "-o", out, "--size", "120x90", "--frames", "1", "--validate", "--stats", &stats])
        .args(more.split_whitespace())
        .output()
        .expect("the binary starts");
    assert_eq!(output.status.code(), Some(0), "{input} {more}: {}", String::from_utf8_lossy(&output.stderr));
    let stats = serde_json::from_str(&fs::read_to_string(stats).unwrap()).unwrap();
    (image::open(out).expect("a picture").to_rgba8(), stats)
}

#[test]
fn every_instance_is_submitted_and_seen_where_it_is() {
    let folder = Folder::new("scene-render");
    let (out, file) = (folder.path("a.png"), folder.path("s.json"));
    fs::write(
        &file,
        r#"{"inputs": {"ball": "scene:sphere:700", "ring": "scene:torus:900"}, "instances": [
            {"of": "ring", "translate": [0, -3, 0]},
            {"of": "ball", "scale": 0.5, "grid": {"count": [4, 1, 2], "step": [3, 0, 3]}}]}"#,
    )
    .unwrap();
    for blend in ["fuzzy", "two-pass", "opaque", "groups"] {
        let (picture, v) = render(&file, &out, &format!("--blend {blend} --background 00000000"));
        let count = |key: &str| v[key].as_u64().unwrap();
        assert_eq!((count("points_input"), count("points_submitted")), (1600, 900 + 8 * 700), "{blend}");
        let culled: u64 = v["culled"].as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum();
        assert_eq!(count("points_submitted"), count("points_drawn") + culled, "{blend}");
        let covered = picture.pixels().filter(|p| p[3] > 0).count();
        assert!(covered > 600, "{blend}: {covered}");
        // All is framed: nothing touches the border.
        let (w, h) = picture.dimensions();
        let border = picture.enumerate_pixels().filter(|(x, y, _)| *x == 0 || *y == 0 || *x == w - 1 || *y == h - 1);
        assert!(border.into_iter().all(|(.., p)| p[3] == 0), "{blend}");
    }
}

#[test]
fn a_moved_cloud_is_a_moved_viewer() {
    let folder = Folder::new("scene-moved");
    let (out, file) = (folder.path("a.png"), folder.path("s.json"));
    let view = |x: f64| format!("--eye {},2,4 --target {x},0,0 --up y", x + 1.0);
    let (as_it_is, _) = render("scene:torus:2k", &out, &view(0.0));
    fs::write(&file, r#"{"inputs": {"a": "scene:torus:2k"}, "instances": [{"of": "a", "translate": [1000, 0, 0]}]}"#)
        .unwrap();
    let (moved, _) = render(&file, &out, &view(1000.0));
    let off =
        moved.pixels().zip(as_it_is.pixels()).filter(|(a, b)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 1));
    assert!(off.count() < 10);
}
