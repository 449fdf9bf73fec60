//! Hybrids in files: whole, or a clear error.

use std::path::{Path, PathBuf};

use surfel::Error;
use surfel::load::Mesh;
use surfel::structure::sequential::Options;
use surfel::structure::{Flat, Hybrid, Packing};

use crate::folder::Folder;
use crate::hybrid_common::torus;
use crate::written::{self, signed};

/// Where the tree begins, and its lists.
const TREE: usize = 8 + 4 * 4 + 3 * 8 + 8;
const LISTS: usize = TREE + 72;

fn made() -> (Flat, Mesh, Options, Hybrid) {
    let mut cloud = torus(10, 6);
    cloud.origin.x = 7.5;
    let (flat, mesh) = (Flat::new(&cloud), cloud.mesh.expect("faces"));
    let options = Options { blocks: 20, ..Options::default() };
    let hybrid = Hybrid::build(&flat, &mesh, &options);
    (flat, mesh, options, hybrid)
}

fn bytes(hybrid: &Hybrid) -> Vec<u8> {
    let mut bytes = Vec::new();
    hybrid.write(&mut bytes).expect("memory");
    bytes
}

fn read(mut bytes: &[u8]) -> Result<Hybrid, Error> {
    Hybrid::read(&mut bytes, Path::new("a.hybrid"))
}

#[test]
fn what_was_written_is_read() {
    let (flat, mesh, options, hybrid) = made();
    let bare = Flat { normals: None, colors: None, ..flat.clone() };
    let none = Hybrid::build(&Flat::default(), &Mesh::default(), &options);
    for hybrid in [hybrid, Hybrid::build(&bare, &mesh, &Options::default()), none] {
        let (tree, triangles) = (&hybrid.tree, &hybrid.triangles);
        let written = bytes(&hybrid);
        let streams = [&tree.flat.normals, &tree.flat.colors].iter().filter(|s| s.is_some()).count();
        let (n, inner) = (tree.flat.len(), tree.nodes.nodes.len());
        let body = 52 * tree.lists.len() + 32 * inner + n * (8 + 16 + 4 * streams + 1);
        let faces = (16 + 4 * streams) * triangles.vertices.len() + 16 * triangles.len();
        assert_eq!(written.len(), LISTS + body + faces + 8, "what docs/FORMAT.md says");
        let back = read(&written).expect("whole");
        assert_eq!(bytes(&back), written);
        assert_eq!(&back.triangles, triangles, "blocks too");
        let (a, b) = (&back.tree, tree);
        assert_eq!((&a.lists, &a.nodes, &a.levels, &a.flat), (&b.lists, &b.nodes, &b.levels, &b.flat));
        assert_eq!((a.options, a.leaves, a.cloud, back.mesh), (b.options, b.leaves, b.cloud, hybrid.mesh));
    }
}

#[test]
fn whose_it_is() {
    let (flat, mesh, options, hybrid) = made();
    let back = read(&bytes(&hybrid)).expect("whole");
    assert!(back.is_of(&flat, &mesh, &options));
    let mut others = vec![flat.clone(); 3];
    others[0].geometry[7][0] += 1e-6;
    others[1].normals = None;
    others[2].geometry.pop();
    assert!(others.iter().all(|other| !back.is_of(other, &mesh, &options)));
    assert!(!back.is_of(&flat, &mesh, &Options { tau_max: 0.1, ..options }));
    let (mut fewer, mut turned) = (mesh.clone(), mesh.clone());
    fewer.triangles.pop();
    turned.triangles[5].rotate_left(1);
    assert!([fewer, turned].iter().all(|other| !back.is_of(&flat, other, &options)));
}

#[test]
fn every_byte_counts() {
    // Entries, faces; lists, nodes and points of the tree.
    written::every_byte_counts("a.hybrid", &bytes(&made().3), &[16, 20, TREE + 28, TREE + 32, TREE + 36], read);
}

#[test]
fn a_right_checksum_is_not_enough() {
    let hybrid = made().3;
    let bytes = bytes(&hybrid);
    assert!(read(&signed(bytes.clone())).is_ok());
    let sizes = bytes.len() - 8 - 4 * hybrid.triangles.len();
    let corners = sizes - 12 * hybrid.triangles.len();
    // A rule, τ_max, where the second list begins, a corner, a size that rises, and one that is none.
    for at in [TREE + 16, TREE + 23, LISTS + 52, corners + 2, sizes + 7, bytes.len() - 9] {
        let mut altered = bytes.clone();
        altered[at] ^= 0x55;
        let error = read(&signed(altered)).expect_err("altered").to_string();
        assert!(error.starts_with("a.hybrid at byte "), "byte {at}: {error}");
    }
}

#[test]
fn files_are_whole_or_not_there() {
    let (flat, mesh, options, hybrid) = made();
    let folder = Folder::new("hybrid_file");
    let path = PathBuf::from(folder.path("a.hybrid"));
    hybrid.save(&path).expect("a folder to write to");
    assert_eq!(std::fs::read(&path).expect("written"), bytes(&hybrid));
    assert!(Hybrid::load(&path).expect("whole").is_of(&flat, &mesh, &options));
    assert_eq!(std::fs::read_dir(path.parent().expect("a folder")).expect("a folder").count(), 1, "nothing beside it");
    // What is packed is not what was made: the file stays.
    for packing in [Packing::Exact, Packing::Quantised] {
        let refused = hybrid.clone().packed(packing).save(&path).expect_err("packed").to_string();
        assert!(refused.contains("a.hybrid") && refused.contains("packed"), "{refused}");
        assert_eq!(std::fs::read(&path).expect("as before"), bytes(&hybrid));
    }
    let nowhere = PathBuf::from(folder.path("none")).join("a.hybrid");
    assert!(matches!(hybrid.save(&nowhere), Err(Error::Io { .. })));
    assert!(matches!(Hybrid::load(&nowhere), Err(Error::Io { .. })));
}
