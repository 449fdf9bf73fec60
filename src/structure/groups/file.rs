//! Groups in a file, so that they are made once. The layout is in docs/FORMAT.md.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;

use super::{Groups, Relax};
use crate::error::{Error, Place, Result};
use crate::structure::Flat;

const MAGIC: &[u8; 8] = b"surfelGR";
const VERSION: u32 = 1;
/// Bytes before the groups.
const HEADER: usize = 72;

/// FNV-1a, 64 bits: any altered byte alters it, since every step is reversible.
#[derive(Clone, Copy)]
struct Fnv(u64);

impl Fnv {
    const NEW: Fnv = Fnv(0xcbf2_9ce4_8422_2325);

    fn add(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.0 = (self.0 ^ b as u64).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

/// Changes with all that a colouring depends on.
fn fingerprint(flat: &Flat) -> u64 {
    let mut hash = Fnv::NEW;
    hash.add(bytemuck::cast_slice(&flat.geometry));
    for stream in [&flat.normals, &flat.colors] {
        hash.add(&[stream.is_some() as u8]);
        hash.add(bytemuck::cast_slice(stream.as_deref().unwrap_or_default()));
    }
    hash.0
}

impl Groups {
    /// The header: little-endian, in this order.
    fn header(&self, flat: &Flat, relax: &Relax) -> Vec<u8> {
        let flags = relax.coplanar as u32 | (relax.opposing as u32) << 1 | (self.overlapping as u32) << 2;
        let mut header = Vec::with_capacity(HEADER);
        header.extend(MAGIC);
        for word in [VERSION, flags, relax.factor.to_bits(), relax.limit, self.count, self.max_degree] {
            header.extend(word.to_le_bytes());
        }
        let numbers = [self.mean_degree.to_bits(), self.conflicts, self.truncated, fingerprint(flat)];
        for number in numbers.into_iter().chain([self.of.len() as u64]) {
            header.extend(number.to_le_bytes());
        }
        header
    }

    /// Writes them. `flat` and `relax` are what they were made of.
    pub fn write(&self, to: &mut impl Write, flat: &Flat, relax: &Relax) -> std::io::Result<()> {
        let header = self.header(flat, relax);
        let mut hash = Fnv::NEW;
        hash.add(&header);
        hash.add(&self.of);
        to.write_all(&header)?;
        to.write_all(&self.of)?;
        to.write_all(&hash.0.to_le_bytes())?;
        to.flush()
    }

    /// Reads what [`write`](Self::write) wrote; `None` where it is whole, but of another cloud or made with other options.
    /// `name` is for errors.
    ///
    /// Nothing is allocated for more points than `flat` has.
    pub fn read(from: &mut impl Read, name: &Path, flat: &Flat, relax: &Relax) -> Result<Option<Groups>> {
        let mut input = Input { from, name, at: 0, hash: Fnv::NEW };
        let mut header = [0; HEADER];
        input.fill(&mut header)?;
        let word = |i: usize| u32::from_le_bytes(std::array::from_fn(|k| header[8 + 4 * i + k]));
        let number = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| header[32 + 8 * i + k]));
        if &header[..8] != MAGIC {
            return Err(Error::data(name, Place::Byte(0), "not a file of groups"));
        }
        if word(0) != VERSION {
            let why = format!("version {}: this program reads {VERSION}", word(0));
            return Err(Error::data(name, Place::Byte(8), why));
        }
        let (count, points) = (word(4), number(4));
        let fits = points == flat.len() as u64;
        let mut of = Vec::with_capacity(if fits { flat.len() } else { 0 });
        let mut rest = points;
        let mut buffer = [0; 1 << 14];
        while rest > 0 {
            let part = &mut buffer[..rest.min(1 << 14) as usize];
            input.fill(part)?;
            if fits {
                of.extend_from_slice(part);
            }
            rest -= part.len() as u64;
        }
        let (sum, at) = (input.hash.0, input.at);
        let mut said = [0; 8];
        input.fill(&mut said)?;
        if u64::from_le_bytes(said) != sum {
            return Err(Error::data(name, Place::Byte(at), "the checksum differs: the file was altered"));
        }
        if input.more()? {
            return Err(Error::data(name, Place::Byte(at + 8), "there is more after the end"));
        }
        if let Some(i) = of.iter().position(|g| *g as u32 >= count) {
            return Err(Error::data(name, Place::Byte((HEADER + i) as u64), "a group beyond the last"));
        }
        let groups = Groups {
            of,
            count,
            overlapping: word(1) & 4 != 0,
            conflicts: number(1),
            truncated: number(2),
            max_degree: word(5),
            mean_degree: f64::from_bits(number(0)),
        };
        // The same header comes of the same cloud and options, and of nothing else.
        Ok((fits && groups.header(flat, relax) == header).then_some(groups))
    }

    /// Writes a file: whole under its name, or not at all.
    pub fn save(&self, path: &Path, flat: &Flat, relax: &Relax) -> Result<()> {
        let mut beside = path.as_os_str().to_owned();
        beside.push(format!(".{}.part", std::process::id()));
        let beside = Path::new(&beside);
        let written = File::create(beside)
            .and_then(|file| {
                let mut to = BufWriter::new(file);
                self.write(&mut to, flat, relax)?;
                to.get_ref().sync_all()
            })
            .and_then(|()| std::fs::rename(beside, path));
        written.map_err(|e| {
            // What is left is of no use; that it cannot be removed changes nothing.
            let _ = std::fs::remove_file(beside);
            Error::io(path, e)
        })
    }

    /// Reads a file; `None` where it is whole, but of another cloud or made with other options.
    pub fn load(path: &Path, flat: &Flat, relax: &Relax) -> Result<Option<Groups>> {
        let file = File::open(path).map_err(|e| Error::io(path, e))?;
        Groups::read(&mut BufReader::new(file), path, flat, relax)
    }
}

struct Input<'a, R> {
    from: &'a mut R,
    name: &'a Path,
    at: u64,
    hash: Fnv,
}

impl<R: Read> Input<'_, R> {
    fn fill(&mut self, to: &mut [u8]) -> Result<()> {
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
