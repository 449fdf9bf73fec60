//! What the files of structures have in common: a checksum, a name that only ever leads to a whole file, and errors that say
//! where.

use std::fs::File;
use std::io::{BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::Path;

use glam::DVec3;

use super::{Flat, Packing, flat};
use crate::error::{Error, Place, Result};

/// FNV-1a, 64 bits: any altered byte alters it, since every step is reversible.
#[derive(Clone, Copy)]
pub(super) struct Fnv(pub u64);

impl Fnv {
    pub const NEW: Fnv = Fnv(0xcbf2_9ce4_8422_2325);

    pub fn add(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.0 = (self.0 ^ b as u64).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

/// Changes with all that a structure makes of a cloud's points.
pub(super) fn fingerprint(flat: &Flat) -> u64 {
    let flat = flat.unpacked();
    let mut hash = Fnv::NEW;
    hash.add(bytemuck::cast_slice(&flat.geometry));
    for stream in [&flat.normals, &flat.colors] {
        hash.add(&[stream.is_some() as u8]);
        hash.add(bytemuck::cast_slice(stream.as_deref().unwrap_or_default()));
    }
    hash.0
}

/// In the flags of a structure with points: what [`Output::points`] writes of them, and whether they are closed. Other bits are
/// the structure's.
const NORMALS: u32 = 1;
const COLORS: u32 = 2;
const CLOSED: u32 = 4;

/// Flags of the points.
pub(super) fn flags(flat: &Flat) -> u32 {
    let flags = [(flat.normals.is_some(), NORMALS), (flat.colors.is_some(), COLORS), (flat.closed, CLOSED)];
    flags.iter().filter(|f| f.0).map(|f| f.1).sum()
}

/// What a structure's file begins with, little-endian: a magic number, the version and others, the origin, and whose it is.
pub(super) struct Header<const WORDS: usize> {
    /// The first is the version.
    pub words: [u32; WORDS],
    pub origin: DVec3,
    /// See [`fingerprint`].
    pub cloud: u64,
}

/// Writes a file: whole under its name, or not at all.
pub(super) fn save(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>) -> Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(format!(".{}.part", std::process::id()));
    let beside = Path::new(&beside);
    let written = File::create(beside)
        .and_then(|file| {
            let mut to = BufWriter::new(file);
            write(&mut to)?;
            to.flush()?;
            to.get_ref().sync_all()
        })
        .and_then(|()| std::fs::rename(beside, path));
    written.map_err(|e| {
        // What is left is of no use; that it cannot be removed changes nothing.
        let _ = std::fs::remove_file(beside);
        Error::io(path, e)
    })
}

/// Reads a file as `read` does, whose second argument is the name for errors.
pub(super) fn load<T>(path: &Path, read: impl FnOnce(&mut BufReader<File>, &Path) -> Result<T>) -> Result<T> {
    read(&mut BufReader::new(File::open(path).map_err(|e| Error::io(path, e))?), path)
}

/// Writes through a checksum.
pub(super) struct Output<'a, W> {
    to: &'a mut W,
    hash: Fnv,
}

impl<'a, W: Write> Output<'a, W> {
    /// Of a structure as it was built. One whose points were packed since is refused: it is not what would be compared with a cloud.
    pub fn new(to: &'a mut W, points: &Flat) -> std::io::Result<Self> {
        if points.packing() != Packing::Full {
            let why = "a structure that is packed: pack what was loaded instead";
            return Err(std::io::Error::new(ErrorKind::InvalidInput, why));
        }
        Ok(Output { to, hash: Fnv::NEW })
    }

    pub fn add<T: bytemuck::NoUninit>(&mut self, items: &[T]) -> std::io::Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(items);
        self.hash.add(bytes);
        self.to.write_all(bytes)
    }

    pub fn header<const WORDS: usize>(&mut self, magic: &[u8; 8], header: &Header<WORDS>) -> std::io::Result<()> {
        self.add(magic)?;
        self.add(&header.words.map(u32::to_le))?;
        self.add(&header.origin.to_array().map(f64::to_bits).map(u64::to_le))?;
        self.add(&[header.cloud.to_le()])
    }

    /// Places and radii, normals, colours, of points that are not packed.
    pub fn points(&mut self, flat: &Flat) -> std::io::Result<()> {
        self.add(&flat.geometry)?;
        [&flat.normals, &flat.colors].into_iter().flatten().try_for_each(|stream| self.add(stream))
    }

    /// The checksum, last of all.
    pub fn finish(self) -> std::io::Result<()> {
        self.to.write_all(&self.hash.0.to_le_bytes())?;
        self.to.flush()
    }
}

/// Reads through a checksum, and knows where it is.
pub(super) struct Input<'a, R> {
    from: &'a mut R,
    name: &'a Path,
    at: u64,
    hash: Fnv,
}

impl<'a, R: Read> Input<'a, R> {
    pub fn new(from: &'a mut R, name: &'a Path) -> Self {
        Input { from, name, at: 0, hash: Fnv::NEW }
    }

    /// Bytes read so far.
    pub fn at(&self) -> u64 {
        self.at
    }

    pub fn fill(&mut self, to: &mut [u8]) -> Result<()> {
        let mut done = 0;
        while done < to.len() {
            match self.from.read(&mut to[done..]) {
                Ok(0) => {
                    return Err(Error::data(self.name, Place::Byte(self.at + done as u64), "the file ends too early"));
                }
                Ok(n) => done += n,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(Error::io(self.name, e)),
            }
        }
        self.hash.add(to);
        self.at += to.len() as u64;
        Ok(())
    }

    /// The header, of a file of `what` that this program reads.
    pub fn header<const WORDS: usize>(&mut self, magic: &[u8; 8], version: u32, what: &str) -> Result<Header<WORDS>> {
        let (mut start, mut words, mut numbers) = ([0; 8], [0u32; WORDS], [0u64; 4]);
        self.fill(&mut start)?;
        self.fill(bytemuck::cast_slice_mut(&mut words))?;
        self.fill(bytemuck::cast_slice_mut(&mut numbers))?;
        let bad = |at: u64, why: String| Err(Error::data(self.name, Place::Byte(at), why));
        if start != *magic {
            return bad(0, format!("not a file of {what}"));
        }
        let words = words.map(u32::from_le);
        if words[0] != version {
            return bad(8, format!("version {}: this program reads {version}", words[0]));
        }
        let [x, y, z, cloud] = numbers.map(u64::from_le);
        Ok(Header { words, origin: DVec3::from_array([x, y, z].map(f64::from_bits)), cloud })
    }

    /// The points that [`Output::points`] wrote, as `flags` say.
    pub fn points(&mut self, flags: u32, origin: DVec3, count: u64) -> Result<Flat> {
        let geometry: Vec<[f32; 4]> = self.items(count)?;
        let mut stream = |flag: u32| if flags & flag != 0 { self.items(count).map(Some) } else { Ok(None) };
        let (normals, colors) = (stream(NORMALS)?, stream(COLORS)?);
        let (blocks, closed) = (flat::blocks(geometry.len(), |i| geometry[i]), flags & CLOSED != 0);
        Ok(Flat { origin, geometry, normals, colors, blocks, closed, ..Flat::default() })
    }

    /// So many items. Memory is taken as they come: a count that the file does not keep costs nothing.
    pub fn items<T: bytemuck::Pod>(&mut self, count: u64) -> Result<Vec<T>> {
        let mut items = Vec::new();
        let mut buffer = vec![T::zeroed(); (1 << 16) / size_of::<T>()];
        while (items.len() as u64) < count {
            let part = (count - items.len() as u64).min(buffer.len() as u64) as usize;
            self.fill(bytemuck::cast_slice_mut(&mut buffer[..part]))?;
            items.extend_from_slice(&buffer[..part]);
        }
        Ok(items)
    }

    /// The checksum, and nothing after it.
    pub fn finish(&mut self) -> Result<()> {
        let (sum, at) = (self.hash.0, self.at);
        let mut said = [0; 8];
        self.fill(&mut said)?;
        if u64::from_le_bytes(said) != sum {
            return Err(Error::data(self.name, Place::Byte(at), "the checksum differs: the file was altered"));
        }
        if self.more()? {
            return Err(Error::data(self.name, Place::Byte(at + 8), "there is more after the end"));
        }
        Ok(())
    }

    fn more(&mut self) -> Result<bool> {
        loop {
            match self.from.read(&mut [0]) {
                Ok(n) => return Ok(n > 0),
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(Error::io(self.name, e)),
            }
        }
    }
}
