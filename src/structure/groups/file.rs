//! Groups in a file, so that they are made once. The layout is in docs/FORMAT.md.

use std::io::{Read, Write};
use std::path::Path;

use super::{Groups, Relax};
use crate::error::{Error, Place, Result};
use crate::structure::Flat;
use crate::structure::file::{Fnv, Input, fingerprint, load, save};

const MAGIC: &[u8; 8] = b"surfelGR";
const VERSION: u32 = 1;
/// Bytes before the groups.
const HEADER: usize = 72;

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
        let mut input = Input::new(from, name);
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
        input.finish()?;
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
        save(path, |to| self.write(to, flat, relax))
    }

    /// Reads a file; `None` where it is whole, but of another cloud or made with other options.
    pub fn load(path: &Path, flat: &Flat, relax: &Relax) -> Result<Option<Groups>> {
        load(path, |from, name| Groups::read(from, name, flat, relax))
    }
}
