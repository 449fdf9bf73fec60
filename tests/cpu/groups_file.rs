//! Groups in files: whole, or a clear error; of this cloud, or none.

use std::path::{Path, PathBuf};

use surfel::Error;
use surfel::structure::Flat;
use surfel::structure::groups::{Groups, Relax};

use crate::folder::Folder;
use crate::groups::soup;
use crate::written;

fn made() -> (Flat, Relax, Groups, Vec<u8>) {
    let (flat, relax) = (soup(300, 0.3, 2.0, 2), Relax { limit: 2, ..Relax::default() });
    let groups = Groups::color(&flat, &relax).expect("groups");
    let mut bytes = Vec::new();
    groups.write(&mut bytes, &flat, &relax).expect("memory");
    (flat, relax, groups, bytes)
}

fn read(mut bytes: &[u8], flat: &Flat, relax: &Relax) -> Result<Option<Groups>, Error> {
    Groups::read(&mut bytes, Path::new("a.groups"), flat, relax)
}

#[test]
fn what_was_written_is_read() {
    let (flat, relax, groups, bytes) = made();
    assert!(groups.conflicts > 0, "a case with everything");
    assert_eq!(bytes.len(), 72 + 300 + 8, "a byte a point, and what docs/FORMAT.md says");
    assert_eq!(read(&bytes, &flat, &relax).expect("whole"), Some(groups));
}

#[test]
fn of_another_cloud_or_with_other_options_is_none() {
    let (flat, relax, _, bytes) = made();
    let mut others = vec![flat.clone(); 4];
    others[0].geometry[7][0] += 1e-6;
    others[1].normals = None;
    others[2].colors.as_mut().expect("colours")[299] ^= 1;
    others[3].geometry.pop();
    for other in &others {
        assert_eq!(read(&bytes, other, &relax).expect("whole"), None);
    }
    for other in [Relax { factor: 0.5, ..relax }, Relax { limit: 3, ..relax }, Relax { coplanar: true, ..relax }] {
        assert_eq!(read(&bytes, &flat, &other).expect("whole"), None, "{other:?}");
    }
}

#[test]
fn every_byte_counts() {
    let (flat, relax, _, bytes) = made();
    // The upper half of the number of points.
    written::every_byte_counts("a.groups", &bytes, &[68], |bytes| read(bytes, &flat, &relax));
}

#[test]
fn files_are_whole_or_not_there() {
    let (flat, relax, groups, bytes) = made();
    let folder = Folder::new("groups_file");
    let path = PathBuf::from(folder.path("a.groups"));
    groups.save(&path, &flat, &relax).expect("a folder to write to");
    assert_eq!(std::fs::read(&path).expect("written"), bytes);
    assert_eq!(Groups::load(&path, &flat, &relax).expect("whole"), Some(groups.clone()));
    assert_eq!(
        std::fs::read_dir(path.parent().expect("a folder")).expect("a folder").count(),
        1,
        "nothing is left beside"
    );
    let nowhere = PathBuf::from(folder.path("none")).join("a.groups");
    assert!(matches!(groups.save(&nowhere, &flat, &relax), Err(Error::Io { .. })));
    assert!(matches!(Groups::load(&nowhere, &flat, &relax), Err(Error::Io { .. })));
}
