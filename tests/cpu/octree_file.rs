//! Octrees in files: whole, or a clear error.

use std::path::{Path, PathBuf};

use surfel::Error;
use surfel::structure::octree::{Options, Preset};
use surfel::structure::{Flat, Octree, Packing};

use crate::folder::Folder;
use crate::groups::soup;
use crate::written::{self, signed};

fn made(preset: Preset) -> (Flat, Options, Octree) {
    let (mut flat, options) = (soup(60, 0.3, 2.0, 2), Options { block: 8, ..Options::new(preset) });
    flat.origin.x = 7.5;
    flat.geometry[5][0] = f32::NAN;
    let octree = Octree::build(&flat, &options);
    assert!(
        octree.cells.iter().all(|c| c.min.is_finite() && c.max.is_finite()),
        "the point that is no number is in none"
    );
    (flat, options, octree)
}

fn bytes(octree: &Octree) -> Vec<u8> {
    let mut bytes = Vec::new();
    octree.write(&mut bytes).expect("memory");
    bytes
}

fn read(mut bytes: &[u8]) -> Result<Octree, Error> {
    Octree::read(&mut bytes, Path::new("a.octree"))
}

#[test]
fn what_was_written_is_read() {
    for (_, preset) in Preset::ALL {
        let (flat, options, octree) = made(*preset);
        let written = bytes(&octree);
        let back = read(&written).expect("whole");
        assert_eq!(bytes(&back), written, "{preset}");
        // What is no number is not equal to itself: all but the points.
        let without = |tree: &Octree| {
            let mut tree = tree.clone();
            tree.flat = Flat::default();
            tree
        };
        assert_eq!(without(&back), without(&octree), "{preset}");
        assert_eq!((back.flat.blocks, back.flat.finest), (octree.flat.blocks, octree.flat.finest), "{preset}");
        assert!(read(&written).expect("whole").is_of(&flat, &options), "{preset}");
    }
    let bare = Octree::build(&Flat::default(), &Options::new(Preset::Espt));
    assert_eq!(read(&bytes(&bare)).expect("nothing, whole"), bare);
}

#[test]
fn whose_it_is() {
    let (flat, options, octree) = made(Preset::Mospt);
    let mut others = vec![flat.clone(); 3];
    others[0].geometry[7][0] += 1e-6;
    others[1].normals = None;
    others[2].geometry.pop();
    assert!(others.iter().all(|other| !octree.is_of(other, &options)));
    assert!(octree.is_of(&flat, &options));
    assert!(!octree.is_of(&flat, &Options { block: 9, ..options }));
    assert!(!octree.is_of(&flat, &Options { preset: Preset::Espt, ..options }));
}

#[test]
fn every_byte_counts() {
    written::every_byte_counts("a.octree", &bytes(&made(Preset::Espt).2), &[44, 48, 52, 56, 60], read);
}

#[test]
fn a_right_checksum_is_not_enough() {
    let bytes = bytes(&made(Preset::Espt).2);
    assert!(read(&signed(bytes.clone())).is_ok());
    let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|k| bytes[at + k])) as usize;
    let (cells, blocks) = (word(44), word(48));
    let (cell, block) = (|i: usize| 96 + 44 * i, |i: usize| 96 + 44 * cells + 32 * i);
    let places = [
        ("preset", 16),
        ("points in no cell", 35),
        ("level", cell(1) + 29),
        ("next cell", cell(1) + 35),
        ("the point that stands for a cell", cell(1) + 39),
        ("a cell's block", cell(cells - 1) + 42),
        ("first point", block(0) + 3),
        ("lowest level", block(0) + 5),
        ("place in the table", block(0) + 10),
        ("number of levels", block(blocks - 1) + 14),
        ("ends that fall", block(blocks) + 3),
    ];
    for (what, at) in places {
        let mut altered = bytes.clone();
        altered[at] ^= 0x55;
        let error = read(&signed(altered)).expect_err(what).to_string();
        assert!(error.starts_with("a.octree at byte "), "{what}: {error}");
    }
    // A block of Poisson-disk samples may be said to hold none.
    let mut none = self::bytes(&made(Preset::Poisson).2);
    let (cells, blocks, ends) = {
        let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|k| none[at + k])) as usize;
        (word(44), word(48), word(52))
    };
    none[96 + 44 * cells + 32 * blocks..][..4 * ends].fill(0);
    assert!(read(&signed(none)).is_ok_and(|octree| octree.levels().iter().all(|level| *level == 0)));
    // Cells that are their own next, and blocks that hold nothing, would never be left or drawn.
    for (at, value) in [(cell(2) + 32, 2), (block(0) + 12, 0)] {
        let mut altered = bytes.clone();
        altered[at..at + 4].copy_from_slice(&u32::to_le_bytes(value));
        assert!(read(&signed(altered)).is_err(), "byte {at}");
    }
}

#[test]
fn files_are_whole_or_not_there() {
    let (flat, options, octree) = made(Preset::Mospt);
    let folder = Folder::new("octree_file");
    let path = PathBuf::from(folder.path("a.octree"));
    octree.save(&path).expect("a folder to write to");
    assert_eq!(std::fs::read(&path).expect("written"), bytes(&octree));
    assert!(Octree::load(&path).expect("whole").is_of(&flat, &options));
    // What is packed is not what was made: the file stays.
    let refused = octree.clone().packed(Packing::Exact).save(&path).expect_err("packed").to_string();
    assert!(refused.contains("a.octree") && refused.contains("packed"), "{refused}");
    assert_eq!(std::fs::read(&path).expect("as before"), bytes(&octree));
    assert_eq!(std::fs::read_dir(path.parent().expect("a folder")).expect("a folder").count(), 1, "nothing beside it");
    let nowhere = PathBuf::from(folder.path("none")).join("a.octree");
    assert!(octree.save(&nowhere).expect_err("no folder").to_string().contains("none"));
    assert!(Octree::load(&nowhere).expect_err("no file").to_string().contains("a.octree"));
}
