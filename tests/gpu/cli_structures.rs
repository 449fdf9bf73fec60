//! `surfel render` with structures: made once and kept, and of meshes by samples.

use std::fs;

use serde_json::Value;

use crate::cli::{render, stderr};
use crate::folder::Folder;

#[test]
fn trees_are_made_once() {
    made_once("scene:torus:3k", "sequential", &["--error", "diameter"], "a.tree: holds the tree of");
}

#[test]
fn octrees_are_made_once() {
    for structure in ["mospt", "espt", "poisson"] {
        made_once("scene:torus:3k", structure, &["--block", "500"], "a.tree: holds the octree of");
    }
}

#[test]
fn hybrids_are_made_once() {
    let folder = Folder::new("render-mesh-hybrid");
    made_once(&waves(&folder), "hybrid", &["--error", "diameter"], "a.tree: holds the hybrid of");
}

/// A file of a mesh: 40 × 40 vertices in waves.
fn waves(folder: &Folder) -> String {
    let n = 40;
    let vertex = |i: u32| {
        let (x, y) = ((i % n) as f32, (i / n) as f32);
        format!("{x} {y} {}\n", 3.0 * (0.3 * x).sin() * (0.2 * y).cos())
    };
    let face = |i: u32| {
        let a = i / (n - 1) * n + i % (n - 1);
        format!("3 {a} {} {}\n3 {a} {} {}\n", a + 1, a + n + 1, a + n + 1, a + n)
    };
    let (vertices, faces): (String, String) =
        ((0..n * n).map(vertex).collect(), (0..(n - 1).pow(2)).map(face).collect());
    let head = format!("ply\nformat ascii 1.0\nelement vertex {}\n", n * n);
    let head = head + "property float x\nproperty float y\nproperty float z\n";
    let head =
        head + &format!("element face {}\nproperty list uchar int vertex_indices\nend_header\n", 2 * (n - 1).pow(2));
    let path = folder.path("waves.ply");
    fs::write(&path, head + &vertices + &faces).expect("a file");
    path
}

#[test]
fn meshes_are_sampled() {
    let folder = Folder::new("render-samples");
    let (mesh, out, json) = (waves(&folder), folder.path("a.png"), folder.path("a.json"));
    let mut drawn = Vec::new();
    for structure in ["flat", "sequential", "espt", "mospt", "poisson"] {
        let more = ["--samples", "20000", "--structure", structure, "--threshold", "0.01", "--stats", &json];
        let done = render(&[&mesh], &out, &more);
        assert_eq!(done.status.code(), Some(0), "{structure}: {}", stderr(&done));
        let said = String::from_utf8_lossy(&done.stdout).into_owned();
        assert!(said.contains("20000 points sampled from 3042 faces, evenly by area"), "{structure}: {said}");
        let stats: Value = serde_json::from_slice(&fs::read(&json).unwrap()).unwrap();
        drawn.push((stats["points_drawn"].as_u64().expect("counted"), fs::read(&out).unwrap()));
    }
    assert!(drawn.iter().all(|(n, _)| *n == 20_000), "{:?}", drawn.iter().map(|d| d.0).collect::<Vec<_>>());
    assert!(render(&[&mesh], &out, &[]).status.success());
    assert!(drawn.iter().all(|(_, picture)| *picture != fs::read(&out).unwrap()), "not the vertices");
    for (input, says) in [("scene:torus:99", "the input has no faces"), ("scene:demo:99", "--samples")] {
        let refused = render(&[input], &out, &["--samples", "9"]);
        assert!(refused.status.code() == Some(1) && stderr(&refused).contains(says), "{input}: {}", stderr(&refused));
    }
}

fn made_once(input: &str, structure: &str, other: &[&str], named: &str) {
    let folder = Folder::new(&format!("render-{structure}"));
    let (out, again, kept) = (folder.path("a.png"), folder.path("b.png"), folder.path("a.tree"));
    let with = |out: &str, more: &[&str]| {
        let more = [&["--structure", structure, "--threshold", "2", "--tree", &kept], more].concat();
        render(&[input], out, &more)
    };
    for out in [&out, &again] {
        let done = with(out, &[]);
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    }
    assert!(fs::read(&out).unwrap() == fs::read(&again).unwrap(), "what is read is what was made");
    // Of other options, or of another cloud: a line that names the file, which stays as it is.
    let before = fs::read(&kept).unwrap();
    let other = with(&out, other);
    assert!(other.status.code() == Some(1) && stderr(&other).contains(named), "{}", stderr(&other));
    assert_eq!(fs::read(&kept).unwrap(), before);
    fs::write(&kept, &before[..before.len() / 2]).unwrap();
    let cut = with(&out, &[]);
    assert!(cut.status.code() == Some(1) && stderr(&cut).contains("a.tree at byte"), "{}", stderr(&cut));
}
