//! Layered point clouds in files: whole, or a clear error.

use std::sync::Mutex;

use surfel::Error;
use surfel::load::PointCloud;
use surfel::stream::{Access, Fault, FaultKind};
use surfel::structure::Index;
use surfel::structure::groups::Relax;
use surfel::structure::layered::{Options, Patch, verify};

use crate::layered::{Model, scene};
use crate::written::{fnv, signed_at};

/// A file in memory that counts its reads.
#[derive(Debug)]
struct Bytes(Vec<u8>, Mutex<Vec<(u64, usize)>>);

impl Bytes {
    fn new(bytes: Vec<u8>) -> Bytes {
        Bytes(bytes, Mutex::default())
    }
}

impl Access for Bytes {
    fn name(&self) -> &str {
        "m.lpc"
    }

    fn size(&self) -> u64 {
        self.0.len() as u64
    }

    fn read(&self, at: u64, to: &mut [u8]) -> Result<(), Fault> {
        self.1.lock().expect("no panic").push((at, to.len()));
        let from = self.0.get(at as usize..).and_then(|rest| rest.get(..to.len()));
        let why = || Fault { kind: FaultKind::Short, name: "m.lpc".into(), at, why: "beyond the end".into() };
        to.copy_from_slice(from.ok_or_else(why)?);
        Ok(())
    }
}

fn bytes(exact: bool, cloud: &PointCloud) -> Vec<u8> {
    let model = Model::new("layered-file", cloud, &Options { samples: 64, exact, ..Options::default() });
    std::fs::read(model.folder.path("m.lpc")).expect("the model")
}

/// Reads everything.
fn read(bytes: Vec<u8>) -> Result<(), Error> {
    let access = Bytes::new(bytes);
    verify(&Index::read(&access)?, &access)
}

/// FNV-1a over header and index, put behind them.
fn signed(bytes: Vec<u8>) -> Vec<u8> {
    let nodes = u32::from_le_bytes(bytes[16..20].try_into().expect("four")) as usize;
    let end = 112 + 88 * nodes;
    // Of a file that says it has more, the sum does not matter.
    if end + 8 > bytes.len() { bytes } else { signed_at(bytes, end) }
}

#[test]
fn the_index_takes_two_reads() {
    let access = Bytes::new(bytes(false, &scene("sphere", 1000)));
    let index = Index::read(&access).expect("an index");
    let end = 112 + 88 * index.nodes.len();
    assert_eq!(*access.1.lock().expect("reads"), [(0, 200), (200, end + 8 - 200)], "what docs/FORMAT.md says");
    assert_eq!(index.nodes[0].at, end as u64 + 8);
    let levels: Vec<u8> = index.nodes.iter().map(|n| n.level).collect();
    assert!(levels.is_sorted() && levels[levels.len() - 1] > 2);
}

#[test]
fn every_cut_and_every_altered_byte_is_refused() {
    for exact in [false, true] {
        let bytes = bytes(exact, &scene("sphere", 700));
        read(bytes.clone()).expect("whole");
        for at in 0..bytes.len() {
            let error = read(bytes[..at].to_vec()).expect_err("cut short").to_string();
            assert!(error.starts_with("m.lpc at byte "), "cut at {at}: {error}");
            let mut altered = bytes.clone();
            altered[at] ^= 1 << (at % 8);
            let error = read(altered).expect_err("altered").to_string();
            assert!(error.starts_with("m.lpc at byte "), "altered at {at}: {error}");
        }
        let mut longer = bytes.clone();
        longer.push(0);
        read(longer).expect_err("longer");
    }
}

#[test]
fn nothing_is_believed_because_its_checksum_is_right() {
    let bytes = bytes(false, &scene("sphere", 700));
    let mut refused = 0;
    let end = 112 + 88 * u32::from_le_bytes(bytes[16..20].try_into().expect("four")) as usize;
    // Links, levels, places, sizes, numbers: whatever is altered is refused, or harmless; nothing panics.
    for at in 8..end {
        for to in [0x00, 0x7f, 0xff] {
            let mut altered = bytes.clone();
            altered[at] = to;
            refused += usize::from(read(signed(altered)).is_err());
        }
    }
    assert!(refused > end, "{refused} of {}", 3 * end);
    let says = |at: usize, word: u32, what: &str| {
        let mut altered = bytes.clone();
        altered[at..at + 4].copy_from_slice(&word.to_le_bytes());
        let error = read(signed(altered)).expect_err(what).to_string();
        assert!(error.contains(what), "{error}");
    };
    let node = |i: usize, field: usize| 112 + 88 * i + field;
    says(node(0, 60), 0, "not its parent's child");
    says(node(1, 60), 1, "a child is not its own");
    says(node(0, 52), 0, "a child is not its own");
    says(node(0, 56), 1, "a child is not its own");
    says(node(2, 64), u32::MAX, "samples, of at most");
    says(node(2, 68), 5, "does not follow");
    says(node(2, 84), u32::MAX, "beyond the end");
    says(node(1, 48), 5 | 1 << 8, "neither a leaf nor cut");
    says(node(1, 48), 2 << 8, "does not fit its parent's");
    says(node(1, 36), f32::NAN.to_bits(), "no number");
    says(node(1, 36), 1e9f32.to_bits(), "does not fit its parent's");
}

#[test]
fn a_patch_of_another_model_is_refused() {
    let [one, other] = [700, 701].map(|n| Bytes::new(bytes(false, &scene("sphere", n))));
    let index = Index::read(&one).expect("an index");
    let node = index.nodes[0];
    let mut patch = vec![0; node.bytes as usize];
    other.read(node.at, &mut patch).expect("bytes");
    let error = Patch::decode(&index, 0, &patch).expect_err("another's").to_string();
    assert_eq!(
        error,
        format!("m.lpc at byte {}: the patch's checksum differs: it was altered, or is another model's", node.at)
    );
    assert!(Patch::decode(&index, 0, &patch[..10]).is_err());
}

#[test]
fn patches_are_checked_behind_their_checksum() {
    let options = Options { samples: 64, groups: Some(Relax::default()), ..Options::default() };
    let model = Model::new("layered-checked", &scene("sphere", 700), &options);
    let access = Bytes::new(std::fs::read(model.folder.path("m.lpc")).expect("the model"));
    let index = Index::read(&access).expect("an index");
    let mut patch = vec![0; index.nodes[0].bytes as usize];
    access.read(index.nodes[0].at, &mut patch).expect("bytes");
    let mut refused = 0;
    for at in 0..patch.len() {
        for flip in [0x01, 0x80, 0xff] {
            let mut altered = patch.clone();
            altered[at] ^= flip;
            let mut index = index.clone();
            index.nodes[0].checksum = fnv(&altered);
            // Decodes to something of the right length, or is refused.
            match Patch::decode(&index, 0, &altered) {
                Ok(found) => assert_eq!(found.positions.len(), index.nodes[0].samples as usize),
                Err(e) => {
                    assert!(e.to_string().starts_with("m.lpc at byte "), "{e}");
                    refused += 1;
                }
            }
        }
    }
    assert!(refused > 30, "{refused}");
    // Fewer groups than samples are in, and none at all: the header says how many there are.
    let index = Index { groups: Some(1), ..index };
    let error = Patch::decode(&index, 0, &patch).expect_err("too few groups").to_string();
    assert!(error.contains("a group that the model does not have"), "{error}");
    let error = Patch::decode(&Index { groups: None, ..index }, 0, &patch).expect_err("one plane more").to_string();
    assert!(error.contains("decompressed"), "{error}");
    for count in [0, 257] {
        let mut altered = std::fs::read(model.folder.path("m.lpc")).expect("the model");
        altered[108..112].copy_from_slice(&u32::to_le_bytes(count));
        let error = read(signed(altered)).expect_err("no number of groups").to_string();
        assert!(error.contains("1 to 256"), "{error}");
    }
}

#[test]
fn the_binary_builds_tells_and_draws() {
    let folder = crate::folder::Folder::new("layered-binary");
    let (model, picture) = (folder.path("m.lpc"), folder.path("a.png"));
    let run = |args: &[&str]| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_surfel")).args(args).output().expect("the binary");
        (output.status.code(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
    };
    let (code, text) = run(&["build", "scene:demo:5000", "-o", &model, "--patch", "512"]);
    assert!(code == Some(0) && text.contains("samples      5 000\n"), "{text}");
    let (code, text) = run(&["info", &model, "--verify", "--json"]);
    let facts: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!((code, &facts["samples"], &facts["verified"]), (Some(0), &5000.into(), &true.into()));
    let (code, text) = run(&["reference", &model, "-o", &picture, "--size", "32x32"]);
    assert!(code == Some(0) && text.contains("all levels of the layered point cloud are drawn"), "{text}");
    let (code, text) = run(&["build", &model, "-o", &model]);
    assert!(code == Some(1) && text.contains("is an input, and would be overwritten"), "{text}");
    assert_eq!(run(&["info", "scene:demo:10", "--verify"]).0, Some(2));
    assert_eq!(run(&["build", "scene:demo:10", "-o", &model, "--memory", "1M"]).0, Some(2));
    let mut bytes = std::fs::read(&model).expect("the model");
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&model, bytes).expect("a file");
    let (code, text) = run(&["info", &model, "--verify"]);
    assert!(code == Some(1) && text.contains("m.lpc at byte ") && text.contains("checksum differs"), "{text}");
}
