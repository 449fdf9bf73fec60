//! From files and formulas to a [`PointCloud`].
//!
//! Every byte of a file is taken to be hostile: a broken file ends in an [`Error`] that names the file and the place, and
//! memory grows with the data that is there, never with the count that a header claims. What was dropped, repaired or
//! assumed is in the cloud's [`Report`].
#![forbid(unsafe_code)]

#[cfg(feature = "preprocess")]
pub mod attributes;
mod bounds;
mod clean;
mod cloud;
mod copies;
#[cfg(feature = "e57")]
mod e57;
#[cfg(feature = "las")]
mod las;
mod merge;
#[cfg(feature = "layered")]
mod pieces;
#[cfg(feature = "ply")]
mod ply;
mod sample;
pub mod synthetic;

use std::fmt;
use std::fs::File;
use std::io::{Cursor, Read, Seek};
use std::path::Path;

pub use bounds::Bounds;
pub use cloud::{Mesh, PointCloud, Report};
pub use copies::{COPIES, thin_copies};
pub use merge::merge;
#[cfg(feature = "layered")]
pub use pieces::Pieces;
pub use sample::sample_mesh;

use crate::error::{Error, Place, Result};

/// How to read. `Options::default()` is right for most.
#[derive(Clone, Copy, Default)]
pub struct Options<'a> {
    /// Called now and then with (points done, points in all), from the calling thread. The total is what the file
    /// claims; the last call has both equal if the file was read to its end.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
}

impl Options<'_> {
    #[cfg(any(feature = "ply", feature = "las", feature = "e57"))]
    fn report(&self, done: u64, total: u64) {
        if let Some(progress) = self.progress {
            progress(done, total);
        }
    }
}

impl fmt::Debug for Options<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Options").field("progress", &self.progress.is_some()).finish()
    }
}

/// Anything that bytes can be read from at any place.
trait Source: Read + Seek {}
impl<T: Read + Seek> Source for T {}

/// Reads the points of a file: PLY (feature `ply`), LAS and LAZ, COPC included (feature `las`), E57 (feature `e57`).
///
/// The content decides what it is, not the name.
///
/// # Errors
/// [`Error::Io`] if the file cannot be opened or read, [`Error::Data`] if it is not a point file that this crate reads,
/// is broken, or holds no usable point, [`Error::Unsupported`] if this build lacks the reader.
pub fn open(path: &Path, options: &Options) -> Result<PointCloud> {
    let io = |e| Error::io(path, e);
    let about = std::fs::metadata(path).map_err(io)?;
    if about.is_dir() {
        return Err(Error::data(path, Place::File, "this is a directory, not a file"));
    }
    if !about.is_file() {
        return Err(Error::data(path, Place::File, "this is not a regular file"));
    }
    let mut file = File::open(path).map_err(io)?;
    let mut magic = Vec::with_capacity(MAGIC_BYTES as usize);
    (&mut file).take(MAGIC_BYTES).read_to_end(&mut magic).map_err(io)?;
    file.rewind().map_err(io)?;
    match recognise(path, &magic)? {
        Kind::Ply => read_ply(path, &std::fs::read(path).map_err(io)?, options),
        Kind::Las => read_las(path, &mut file, options),
        Kind::E57 => read_e57(path, &mut file, options),
    }
}

/// Reads points from bytes in memory, as [`open`] reads a file. `name` stands for the file in errors.
///
/// # Errors
/// As [`open`].
pub fn read(name: &Path, bytes: &[u8], options: &Options) -> Result<PointCloud> {
    let magic = &bytes[..bytes.len().min(MAGIC_BYTES as usize)];
    match recognise(name, magic)? {
        Kind::Ply => read_ply(name, bytes, options),
        Kind::Las => read_las(name, &mut Cursor::new(bytes), options),
        Kind::E57 => read_e57(name, &mut Cursor::new(bytes), options),
    }
}

#[cfg(feature = "ply")]
fn read_ply(name: &Path, bytes: &[u8], options: &Options) -> Result<PointCloud> {
    ply::read(name, bytes, options)
}

#[cfg(not(feature = "ply"))]
fn read_ply(name: &Path, _: &[u8], _: &Options) -> Result<PointCloud> {
    Err(Error::Unsupported(format!("{}: this build reads no PLY (feature `ply`)", name.display())))
}

#[cfg(feature = "las")]
fn read_las(name: &Path, source: &mut dyn Source, options: &Options) -> Result<PointCloud> {
    las::read(name, source, options)
}

#[cfg(not(feature = "las"))]
fn read_las(name: &Path, _: &mut dyn Source, _: &Options) -> Result<PointCloud> {
    Err(Error::Unsupported(format!("{}: this build reads no LAS or LAZ (feature `las`)", name.display())))
}

#[cfg(feature = "e57")]
fn read_e57(name: &Path, source: &mut dyn Source, options: &Options) -> Result<PointCloud> {
    e57::read(name, source, options)
}

#[cfg(not(feature = "e57"))]
fn read_e57(name: &Path, _: &mut dyn Source, _: &Options) -> Result<PointCloud> {
    Err(Error::Unsupported(format!("{}: this build reads no E57 (feature `e57`)", name.display())))
}

/// The cloud, or the error that says why nothing is left of it.
#[cfg(any(feature = "ply", feature = "las", feature = "e57"))]
fn finish(cloud: PointCloud, file: &Path) -> Result<PointCloud> {
    if !cloud.is_empty() {
        return Ok(cloud);
    }
    let mut why = format!("no point left: {} in the file", cloud.report.points_in_file);
    for (reason, n) in &cloud.report.dropped {
        why += &format!(", {n} dropped for {reason}");
    }
    Err(Error::data(file, Place::File, why))
}

enum Kind {
    Ply,
    Las,
    E57,
}

const MAGIC_BYTES: u64 = 32;
const READ: &str = "surfel reads PLY, LAS, LAZ and E57";

/// By the first bytes; the extension only helps to say what a file is that is not read.
fn recognise(name: &Path, magic: &[u8]) -> Result<Kind> {
    let refuse = |why: String| Err(Error::data(name, Place::File, why));
    if magic.is_empty() {
        return refuse(format!("the file is empty; {READ}"));
    }
    if magic.starts_with(b"ply") && magic.get(3).is_none_or(u8::is_ascii_whitespace) {
        return Ok(Kind::Ply);
    }
    if magic.starts_with(b"LASF") {
        return Ok(Kind::Las);
    }
    if magic.starts_with(b"ASTM-E57") {
        return Ok(Kind::E57);
    }
    let by_content: [(&[u8], &str); 5] =
        [(b"glTF", "glTF"), (b"# .PCD", "PCD"), (b"VERSION .7", "PCD"), (b"\x1f\x8b", "gzip"), (b"PK\x03\x04", "ZIP")];
    if let Some((_, what)) = by_content.iter().find(|(start, _)| magic.starts_with(start)) {
        return refuse(format!("{what} is not read yet; {READ}"));
    }
    let extension = name.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let by_name = match extension.as_str() {
        "gltf" | "glb" => "glTF",
        "obj" => "OBJ",
        "pcd" => "PCD",
        "pts" | "ptx" => "PTS/PTX",
        "xyz" | "txt" | "csv" | "asc" => "plain text points",
        "stl" => "STL",
        "off" => "OFF",
        "spz" | "splat" | "ksplat" | "sog" => "this splat format",
        "ply" => return refuse("this is not a PLY file: it does not start with `ply`".into()),
        "e57" => return refuse("this is not an E57 file: it does not start with `ASTM-E57`".into()),
        "las" | "laz" => return refuse("this is not a LAS file: it does not start with `LASF`".into()),
        _ => return refuse(format!("the format is not known; {READ}")),
    };
    refuse(format!("{by_name} is not read yet; {READ}"))
}
