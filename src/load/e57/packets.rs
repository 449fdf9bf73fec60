//! The points of a scan: packets that hold a piece of every field's stream of bits.
//!
//! All of it is read here and not by the crate `e57`, whose readers keep 16 bytes for each value that waits for others of
//! its point (an eighth of a byte in the file), never end where all fields are constant, and lose their way behind a
//! packet that is not of data.

use std::io::{Read, Seek};

use super::describe::Scan;
use super::pages::Pages;
use crate::error::{Error, Place, Result};
use crate::par;

/// How a value is made of bits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Single,
    Double,
    /// An unsigned number above `min`; the value is that times `scale` plus `offset`.
    Integer {
        min: i64,
        scale: f64,
        offset: f64,
    },
}

/// What every point has one value of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Field {
    /// Bits a value, 0 to 64; with 0 all values are the same.
    pub(super) bits: u32,
    pub(super) kind: Kind,
}

impl Field {
    fn value(&self, raw: u64) -> f64 {
        match self.kind {
            Kind::Single => f64::from(f32::from_bits(raw as u32)),
            Kind::Double => f64::from_bits(raw),
            // Bits may stand for more than the maximum; then they are what they are.
            Kind::Integer { min, scale, offset } => min.wrapping_add(raw as i64) as f64 * scale + offset,
        }
    }

    /// `n` values from number `first` of a stream that begins at bit `bit` of `bytes`, every `step`th.
    fn values(&self, bytes: &[u8], bit: usize, first: usize, n: usize, step: usize) -> Vec<f64> {
        let at = |i: usize| bit + (first + i * step) * self.bits as usize;
        (0..n).map(|i| self.value(number(bytes, at(i), self.bits))).collect()
    }

    /// Whole values in so many bits; as many as one likes of a constant.
    fn count(&self, bits: u64) -> u64 {
        bits.checked_div(u64::from(self.bits)).unwrap_or(u64::MAX)
    }
}

/// `bits` bits from bit `at`, the lowest first.
fn number(bytes: &[u8], at: usize, bits: u32) -> u64 {
    let rest = &bytes[(at / 8).min(bytes.len())..];
    let raw = match rest.first_chunk::<16>() {
        Some(raw) => u128::from_le_bytes(*raw),
        None => {
            let mut raw = [0; 16];
            raw[..rest.len()].copy_from_slice(rest);
            u128::from_le_bytes(raw)
        }
    };
    ((raw >> (at % 8)) & ((1 << bits) - 1)) as u64
}

/// Values of consecutive points, one list a field; empty where the field is not wanted.
pub(super) type Columns = Vec<Vec<f64>>;

/// A packet of any kind.
struct Packet {
    /// Logical offset of its first byte.
    at: u64,
    /// Logical offset of its end.
    end: u64,
    /// Bytes of each stream, empty where it holds no points.
    sizes: Vec<u16>,
}

/// Goes to a scan's first packet.
fn start<S: Read + Seek>(pages: &mut Pages<S>, scan: &Scan) -> Result<()> {
    pages.seek_physical(scan.section, "the binary section of a scan")?;
    let at = pages.at();
    let mut head = [0; 32];
    pages.read(&mut head)?;
    if head[0] != 1 {
        return Err(Error::data(pages.file(), Pages::<S>::place(at), "there is no binary section of a scan here"));
    }
    let mut word = [0; 8];
    word.copy_from_slice(&head[16..24]);
    pages.seek_physical(u64::from_le_bytes(word), "the first packet of a scan")
}

/// Reads a packet's head and stays behind it.
fn packet<S: Read + Seek>(pages: &mut Pages<S>, fields: usize, done: u64, scan: &Scan) -> Result<Packet> {
    let at = pages.at();
    let mut head = [0; 4];
    if at + 4 > pages.len() {
        return Err(ended(pages, done, scan));
    }
    pages.read(&mut head)?;
    let length = u64::from(u16::from_le_bytes([head[2], head[3]])) + 1;
    let fail = |pages: &Pages<S>, why: &str| Err(Error::data(pages.file(), Pages::<S>::place(at), why));
    if head[0] > 2 {
        return Err(ended(pages, done, scan));
    }
    if at + length > pages.len() {
        return Err(ended(pages, done, scan));
    }
    if !length.is_multiple_of(4) {
        return fail(pages, "the length of a packet is not a multiple of four");
    }
    let mut packet = Packet { at, end: at + length, sizes: Vec::new() };
    if head[0] != 1 {
        // An index, or a gap.
        return Ok(packet);
    }
    let mut count = [0; 2];
    pages.read(&mut count)?;
    if usize::from(u16::from_le_bytes(count)) != fields {
        return fail(pages, "a packet has another number of fields than its scan");
    }
    let mut sizes = vec![0; 2 * fields];
    pages.read(&mut sizes)?;
    packet.sizes = sizes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    let needed = 6 + sizes.len() as u64 + packet.sizes.iter().map(|n| u64::from(*n)).sum::<u64>();
    if needed > length {
        return fail(pages, "a packet is shorter than what it says it holds");
    }
    Ok(packet)
}

fn ended<S: Read + Seek>(pages: &Pages<S>, done: u64, scan: &Scan) -> Error {
    let why = format!("the points of this scan end here; the description promises {}", scan.points);
    Error::data(pages.file(), Place::Element("point", done), why)
}

/// What was read of one field's stream and not yet used.
#[derive(Default)]
struct Stream {
    bytes: Vec<u8>,
    /// Bits of the first byte that were used.
    bit: usize,
}

impl Stream {
    fn bits(&self) -> u64 {
        8 * self.bytes.len() as u64 - self.bit as u64
    }
}

/// Reads a scan from its first point to its last.
pub(super) struct Cursor {
    /// Logical offset of the next packet.
    next: u64,
    streams: Vec<Stream>,
    done: u64,
    /// Most bytes that may wait for others of their points.
    backlog: u64,
}

impl Cursor {
    pub(super) fn new<S: Read + Seek>(pages: &mut Pages<S>, scan: &Scan, backlog: u64) -> Result<Cursor> {
        let mut cursor = Cursor { next: 0, streams: Vec::new(), done: 0, backlog };
        cursor.streams.resize_with(scan.fields.len(), Stream::default);
        if scan.fields.iter().any(|f| f.bits > 0) {
            start(pages, scan)?;
            cursor.next = pages.at();
        }
        Ok(cursor)
    }

    /// Points that were read.
    pub(super) fn done(&self) -> u64 {
        self.done
    }

    /// The next points, `most` at most; `None` at the end.
    pub(super) fn next<S: Read + Seek>(
        &mut self,
        pages: &mut Pages<S>,
        scan: &Scan,
        most: u64,
    ) -> Result<Option<Columns>> {
        let most = most.min(scan.points - self.done);
        if most == 0 {
            return Ok(None);
        }
        let there = |streams: &[Stream]| {
            let counts = scan.fields.iter().zip(streams).map(|(f, s)| f.count(s.bits()));
            counts.min().unwrap_or(0).min(most)
        };
        while there(&self.streams) < most {
            self.read(pages, scan)?;
        }
        let n = most as usize;
        let fields: Vec<(&Field, &Stream, bool)> =
            scan.fields.iter().zip(&self.streams).enumerate().map(|(i, (f, s))| (f, s, scan.wants(i))).collect();
        let columns = par::map(&fields, |(field, stream, wanted)| match wanted {
            true => field.values(&stream.bytes, stream.bit, 0, n, 1),
            false => Vec::new(),
        });
        for (field, stream) in scan.fields.iter().zip(&mut self.streams) {
            let used = stream.bit + n * field.bits as usize;
            stream.bytes.drain(..used / 8);
            stream.bit = used % 8;
        }
        self.done += most;
        Ok(Some(columns))
    }

    /// Appends the next packet to the streams.
    fn read<S: Read + Seek>(&mut self, pages: &mut Pages<S>, scan: &Scan) -> Result<()> {
        pages.seek(self.next);
        let packet = packet(pages, scan.fields.len(), self.done, scan)?;
        let mut waiting = 0;
        for ((size, stream), field) in packet.sizes.iter().zip(&mut self.streams).zip(&scan.fields) {
            let from = stream.bytes.len();
            stream.bytes.resize(from + usize::from(*size), 0);
            pages.read(&mut stream.bytes[from..])?;
            if field.bits == 0 {
                stream.bytes.clear();
            }
            waiting += stream.bytes.len() as u64;
        }
        if waiting > self.backlog {
            let why = "the fields of a point lie too far apart for reading in pieces: read the file in full";
            return Err(Error::data(pages.file(), Pages::<S>::place(packet.at), why));
        }
        self.next = packet.end;
        Ok(())
    }
}

/// Walks over a scan's packets without decoding them, to see that all points are there, and decodes some of those whose
/// number `wanted` asks for: it is given the numbers of the points that lie wholly in a packet, and says how many it wants
/// of them, to be taken evenly.
pub(super) fn survey<S: Read + Seek>(
    pages: &mut Pages<S>,
    scan: &Scan,
    wanted: impl Fn(u64, u64) -> u64,
    mut taken: impl FnMut(&Columns),
) -> Result<()> {
    if scan.fields.iter().all(|f| f.bits == 0) {
        taken(&scan.fields.iter().map(|f| f.values(&[], 0, 0, 1, 1)).collect());
        return Ok(());
    }
    start(pages, scan)?;
    let mut read = vec![0u64; scan.fields.len()];
    let mut done = 0;
    while done < scan.points {
        let packet = packet(pages, scan.fields.len(), done, scan)?;
        let mut range = (0, scan.points);
        let mut bits = Vec::with_capacity(read.len());
        for ((read, size), field) in read.iter_mut().zip(&packet.sizes).zip(&scan.fields) {
            let before = *read;
            *read += 8 * u64::from(*size);
            if field.bits > 0 {
                range.0 = range.0.max(before.div_ceil(u64::from(field.bits)));
                range.1 = range.1.min(field.count(*read));
            }
            bits.push(before);
        }
        done = read.iter().zip(&scan.fields).map(|(bits, f)| f.count(*bits)).min().unwrap_or(0);
        let inside = range.1.saturating_sub(range.0);
        let n = if packet.sizes.is_empty() || inside == 0 { 0 } else { wanted(range.0, range.1).min(inside) };
        if n > 0 {
            let step = inside.div_ceil(n);
            let n = inside.div_ceil(step) as usize;
            let mut columns = Columns::new();
            for (i, (size, field)) in packet.sizes.iter().zip(&scan.fields).enumerate() {
                let mut bytes = vec![0; usize::from(*size)];
                pages.read(&mut bytes)?;
                // The stream's first bit in this packet is number `bits[i]` of all.
                let first = range.0 * u64::from(field.bits) - if field.bits > 0 { bits[i] } else { 0 };
                columns.push(match scan.wants(i) {
                    true => field.values(&bytes, first as usize, 0, n, step as usize),
                    false => Vec::new(),
                });
            }
            taken(&columns);
        }
        pages.seek(packet.end);
    }
    Ok(())
}
