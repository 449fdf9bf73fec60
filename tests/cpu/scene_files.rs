//! Scene files as the binary takes them, where it needs no Vulkan.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::folder::Folder;

/// A triangle that is its own mirror image in no direction.
const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1.5 0 0\n0 1 0\n3 0 1 2\n";

fn surfel(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_surfel")).args(args).output().expect("the binary starts")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn reference(input: &str, out: &str, more: &str) -> image::RgbaImage {
    let args = ["reference", input, "-o", out, "--size", "60x60", "--shade", "none", "--up", "y"];
    let output = surfel(&args.into_iter().chain(more.split_whitespace()).collect::<Vec<_>>());
    assert!(output.status.success(), "{input} {more}: {}", stderr(&output));
    image::open(out).expect("a picture").to_rgba8()
}

#[test]
fn an_instance_is_a_cloud_that_was_moved() {
    let folder = Folder::new("scene-moved");
    let (out, file) = (folder.path("a.png"), folder.path("s.json"));
    let triangle = folder.path("triangle.ply");
    fs::write(&triangle, TRIANGLE).unwrap();
    for truth in ["--truth mesh", "--truth supersampled --radius 0.4"] {
        let as_it_is = reference(&triangle, &out, &format!("{truth} --eye 0.2,0.1,4 --target 0.2,0.1,0"));
        // The path is relative to the file.
        for (instance, view) in [
            (r#"{"of": "t"}"#, "--eye 0.2,0.1,4 --target 0.2,0.1,0"),
            (r#"{"of": "t", "translate": [10, 20, 30]}"#, "--eye 10.2,20.1,34 --target 10.2,20.1,30"),
            (r#"{"of": "t", "scale": 8}"#, "--eye 1.6,0.8,32 --target 1.6,0.8,0"),
            // From +Z a quarter turn about y is seen from +X.
            (r#"{"of": "t", "rotate": {"axis": [0, 3, 0], "degrees": 90}}"#, "--eye 4,0.1,-0.2 --target 0,0.1,-0.2"),
        ] {
            fs::write(&file, format!(r#"{{"inputs": {{"t": "triangle.ply"}}, "instances": [{instance}]}}"#)).unwrap();
            let moved = reference(&file, &out, &format!("{truth} {view}"));
            let off = moved
                .pixels()
                .zip(as_it_is.pixels())
                .filter(|(a, b)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 1));
            // A sample on an edge may fall to either side.
            assert!(off.count() < 5, "{truth} {instance}");
        }
    }
}

#[test]
fn grids_are_framed_and_told() {
    let folder = Folder::new("scene-grid");
    let (out, file) = (folder.path("a.png"), folder.path("s.json"));
    let text = r#"{"inputs": {"ball": "scene:sphere:500", "ring": "scene:torus:400"}, "instances": [
        {"of": "ring"}, {"of": "ball", "translate": [0, 0, 5], "scale": 0.5, "grid": {"count": [3, 2, 1], "step": [4, 4, 0]}}]}"#;
    fs::write(&file, text).unwrap();
    let said = surfel(&["reference", &file, "-o", &out, "--size", "60x60", "--cull", "off"]);
    let text = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(said.status.success() && text.contains("900 in the input, 3 400 drawn"), "{text}{}", stderr(&said));
    let info = surfel(&["info", &file, "--json"]);
    let v: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!((&v["instances"], &v["inputs"][1]["name"]), (&7.into(), &"ball".into()));
    assert_eq!((&v["inputs"][1]["input"], &v["inputs"][1]["instances"]), (&"scene:sphere:500:1".into(), &6.into()));
    let text = String::from_utf8_lossy(&surfel(&["info", &file]).stdout).into_owned();
    assert!(text.contains("ring         scene:torus:400:1, 1 times"), "{text}");
}

#[test]
fn what_a_scene_cannot_be_is_refused() {
    let folder = Folder::new("scene-refused");
    let (out, file) = (folder.path("a.png"), folder.path("s.json"));
    let refused = |text: &str, more: &[&str], code: i32, says: &str| {
        fs::write(&file, text).unwrap();
        for command in ["render", "reference"] {
            let output = surfel(&[&[command, &file, "-o", &out], more].concat());
            let told = stderr(&output);
            assert_eq!(output.status.code(), Some(code), "{command} {text}: {told}");
            assert!(told.contains(says) && !Path::new(&out).exists(), "{command} {text}: {told}");
        }
    };
    let torus = r#"{"inputs": {"a": "scene:torus:99"}, "instances": [{"of": "a", "scale": 0}]}"#;
    refused(torus, &[], 1, "s.json: instances[0].scale: must be more than 0");
    let missing = r#"{"inputs": {"a": "no.ply"}, "instances": [{"of": "a"}]}"#;
    refused(missing, &[], 1, "s.json: inputs.a: ");
    refused(missing, &[], 1, "no.ply: No such file");
    refused(r#"{"inputs": {"a": "s.json"}, "instances": [{"of": "a"}]}"#, &[], 1, "no scenes in scenes");
    refused(r#"{"inputs": 1"#, &[], 1, "s.json: EOF");
    let fine = torus.replace("0}", "1}");
    refused(&fine, &["scene:torus:99"], 2, "only input");
    refused(&fine, &["--storage", "back-to-front"], 2, "--storage");
    let two = r#"{"inputs": {"a": "scene:torus:99", "b": "scene:sphere:99"}, "instances": [{"of": "a"}, {"of": "b"}]}"#;
    refused(two, &["--blend", "groups", "--groups", &folder.path("g")], 2, "one input");
    let many = r#"{"inputs": {"a": "scene:torus:99k"}, "instances": [{"of": "a", "grid": {"count": [300, 300, 1], "step": [1, 1, 1]}}]}"#;
    fs::write(&file, many).unwrap();
    let output = surfel(&["reference", &file, "-o", &out]);
    assert!(output.status.code() == Some(1) && stderr(&output).contains("8910000000 points"), "{}", stderr(&output));
    let output = surfel(&["bench", &file, "--out", &folder.path("bench"), "-q"]);
    assert!(
        output.status.code() == Some(1) && stderr(&output).contains("s.json: a scene file is for"),
        "{}",
        stderr(&output)
    );
}
