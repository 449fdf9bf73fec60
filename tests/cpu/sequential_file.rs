//! Sequential point trees in files: whole, or a clear error.

use std::path::{Path, PathBuf};

use surfel::Error;
use surfel::structure::nodes::ErrorRule;
use surfel::structure::sequential::Options;
use surfel::structure::{Flat, Packing, Sequential};

use crate::folder::Folder;
use crate::groups::soup;
use crate::written::{self, signed};

fn made() -> (Flat, Options, Vec<u8>) {
    let (flat, options) =
        (soup(40, 0.3, 2.0, 2), Options { rule: ErrorRule::Split, clusters: true, ..Options::default() });
    (flat.clone(), options, bytes(&Sequential::build(&flat, &options)))
}

fn bytes(tree: &Sequential) -> Vec<u8> {
    let mut bytes = Vec::new();
    tree.write(&mut bytes).expect("memory");
    bytes
}

fn read(mut bytes: &[u8]) -> Result<Sequential, Error> {
    Sequential::read(&mut bytes, Path::new("a.tree"))
}

#[test]
fn what_was_written_is_read() {
    let (mut flat, options, _) = made();
    flat.origin.x = 7.5;
    flat.geometry[5][0] = f32::NAN;
    let bare = Flat { normals: None, colors: None, closed: true, ..flat.clone() };
    for (flat, options) in
        [(&flat, options), (&bare, Options { clusters: false, ..options }), (&Flat::default(), options)]
    {
        let tree = Sequential::build(flat, &options);
        let written = bytes(&tree);
        let streams = [flat.normals.is_some(), flat.colors.is_some()].iter().filter(|s| **s).count();
        let (n, inner) = (tree.flat.len(), tree.nodes.nodes.len());
        let size = 72 + 52 * tree.lists.len() + 32 * inner + n * (8 + 16 + 4 * streams + 1) + 8;
        assert_eq!(written.len(), size, "what docs/FORMAT.md says");
        let back = read(&written).expect("whole");
        assert_eq!(bytes(&back), written);
        assert_eq!((&back.lists, &back.nodes, &back.levels), (&tree.lists, &tree.nodes, &tree.levels));
        assert_eq!((back.flat.origin, back.flat.closed), (flat.origin, flat.closed));
        assert_eq!((back.flat.blocks, back.options, back.leaves), (tree.flat.blocks, options, tree.leaves));
    }
}

#[test]
fn whose_it_is() {
    let (flat, options, bytes) = made();
    let tree = read(&bytes).expect("whole");
    assert!(tree.is_of(&flat, &options));
    let mut others = vec![flat.clone(); 3];
    others[0].geometry[7][0] += 1e-6;
    others[1].normals = None;
    others[2].geometry.pop();
    assert!(others.iter().all(|other| !tree.is_of(other, &options)));
    assert!(!tree.is_of(&flat, &Options { tau_max: 0.1, ..options }));
    assert!(!tree.is_of(&flat, &Options { published_errors: true, ..options }));
}

#[test]
fn every_byte_counts() {
    written::every_byte_counts("a.tree", &made().2, &[28, 32, 36], read);
}

#[test]
fn a_right_checksum_is_not_enough() {
    let (_, _, bytes) = made();
    assert!(read(&signed(bytes.clone())).is_ok());
    let lists = u32::from_le_bytes(std::array::from_fn(|k| bytes[28 + k])) as usize;
    let nodes = u32::from_le_bytes(std::array::from_fn(|k| bytes[32 + k])) as usize;
    // A rule, τ_max, where the second list begins, the length of the last, a link.
    for at in [16, 23, 72 + 52, 72 + 52 * lists - 48, 72 + 52 * lists + 32 * nodes + 2] {
        let mut altered = bytes.clone();
        altered[at] ^= 0x55;
        assert!(read(&signed(altered)).is_err(), "byte {at}");
    }
}

#[test]
fn files_are_whole_or_not_there() {
    let (flat, options, written) = made();
    let folder = Folder::new("sequential_file");
    let path = PathBuf::from(folder.path("a.tree"));
    let tree = Sequential::build(&flat, &options);
    tree.save(&path).expect("a folder to write to");
    assert_eq!(std::fs::read(&path).expect("written"), written);
    assert!(Sequential::load(&path).expect("whole").is_of(&flat, &options));
    let beside = std::fs::read_dir(path.parent().expect("a folder")).expect("a folder").count();
    assert_eq!(beside, 1, "nothing is left beside");
    let nowhere = PathBuf::from(folder.path("none")).join("a.tree");
    assert!(matches!(tree.save(&nowhere), Err(Error::Io { .. })));
    // What is packed is not what was made: the file stays.
    for packing in [Packing::Exact, Packing::Quantised] {
        let refused = tree.clone().packed(packing).save(&path).expect_err("packed").to_string();
        assert!(refused.contains("a.tree") && refused.contains("packed"), "{refused}");
        assert_eq!(std::fs::read(&path).expect("as before"), bytes(&tree));
    }
    assert!(matches!(Sequential::load(&nowhere), Err(Error::Io { .. })));
}
