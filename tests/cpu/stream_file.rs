//! A file that others write to while it is open.

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::time::{Duration, SystemTime};

use surfel::Error;
use surfel::stream::{Access, FaultKind, FileAccess};

use crate::folder::Folder;

fn kind(access: &FileAccess, at: u64, len: usize) -> Option<FaultKind> {
    access.read(at, &mut vec![0; len]).err().map(|fault| fault.kind)
}

#[test]
fn a_file_that_others_touch() {
    let folder = Folder::new("stream-file");
    let path = folder.path("a");
    let opened = |bytes: &[u8]| {
        fs::write(&path, bytes).expect("a file");
        FileAccess::open(&path).expect("a file")
    };

    let access = opened(b"0123456789");
    fs::write(folder.path("b"), b"abcdefghij").and_then(|()| fs::rename(folder.path("b"), &path)).expect("replaced");
    let mut bytes = [0; 4];
    access.read(3, &mut bytes).expect("the file that was opened is still there");
    assert_eq!(&bytes, b"3456");

    let access = opened(b"0123456789");
    File::options().append(true).open(&path).and_then(|mut f| f.write_all(b"!")).expect("longer");
    assert_eq!(kind(&access, 0, 4), Some(FaultKind::Changed));

    let access = opened(b"0123456789");
    File::options().write(true).open(&path).and_then(|f| f.set_len(5)).expect("shorter");
    for at in [0, 4, 8] {
        assert_eq!(kind(&access, at, 2), Some(FaultKind::Changed), "cut short, from {at}");
    }

    let access = opened(b"0123456789");
    assert_eq!(kind(&access, 0, 10), None);
    let later = SystemTime::now() + Duration::from_secs(5);
    let mut file = OpenOptions::new().write(true).open(&path).expect("a file");
    file.write_all(b"X").and_then(|()| file.set_modified(later)).expect("altered");
    assert_eq!(kind(&access, 5, 1), Some(FaultKind::Changed), "altered elsewhere");
}

#[test]
fn offsets_beyond_the_end() {
    let folder = Folder::new("stream-end");
    fs::write(folder.path("a"), [7; 100]).expect("a file");
    let access = FileAccess::open(folder.path("a")).expect("a file");
    assert_eq!(kind(&access, 100, 0), None);
    for (at, len) in [(100, 1), (99, 2), (101, 0), (0, 101), (u64::MAX, 1), (u64::MAX, 0), (1 << 63, 5)] {
        assert_eq!(kind(&access, at, len), Some(FaultKind::Short), "{at}, {len}");
    }
    match FileAccess::open(&folder.0) {
        Err(Error::Io { source, .. }) => assert_eq!(source.kind(), ErrorKind::InvalidInput),
        other => panic!("a folder is no file: {other:?}"),
    }
}

#[test]
fn many_read_at_once() {
    let folder = Folder::new("stream-many");
    let bytes: Vec<u8> = (0..1 << 20).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    fs::write(folder.path("a"), &bytes).expect("a file");
    let access = FileAccess::open(folder.path("a")).expect("a file");
    std::thread::scope(|scope| {
        for n in 0..8usize {
            let (access, bytes) = (&access, &bytes);
            scope.spawn(move || {
                let mut to = vec![0; 5000];
                for i in 0..200usize {
                    let at = (n * 104_729 + i * 7919) % (bytes.len() - to.len());
                    access.read(at as u64, &mut to).expect("a part");
                    assert!(to == bytes[at..at + to.len()], "thread {n}, read {i}");
                }
            });
        }
    });
}
