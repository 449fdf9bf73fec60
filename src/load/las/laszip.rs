//! Compressed points: chunks are found and bounded here, decoded by `laz`, side by side.
//!
//! A chunk is decoded a few thousand points at a time into a small buffer, so that memory follows what comes out and not
//! what a table claims. Chunks that would hold absurdly many points for their bytes are refused: a bomb of a few
//! kilobytes must not fill the memory.

use std::io::{Cursor, Read, SeekFrom};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use laz::decoders::ArithmeticDecoder;
use laz::decompressors::IntegerDecompressorBuilder;
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{LazItemType, LazVlr};

use super::header::Header;
use super::points::{Block, Layout, Points, decode_into};
use crate::error::{Error, Place, Result};
use crate::load::{Options, Source};
use crate::par;

/// Records decoded into one buffer.
const STEP: usize = 4096;
/// Points for each compressed byte that are believed, beyond [`ANYWAY`]. Real files have less than one.
const POINTS_A_BYTE: u64 = 16;
/// Points that are believed of any file.
const ANYWAY: u64 = 1 << 20;

/// `number` points in `bytes` from `at`.
struct Chunk {
    at: u64,
    bytes: u64,
    number: u64,
    /// Index of its first point.
    first: u64,
}

/// The chunks of a file, and what decodes them.
pub(super) struct Chunks {
    vlr: LazVlr,
    layers: usize,
    chunks: Vec<Chunk>,
    /// The oldest kind: all points are one chunk.
    pub(super) is_one: bool,
}

impl Chunks {
    pub(super) fn open(file: &Path, source: &mut dyn Source, header: &Header) -> Result<Chunks> {
        let io = |e| Error::io(file, e);
        let fail = |why: String| Error::data(file, Place::File, why);
        let record = header.record(source, LazVlr::USER_ID, LazVlr::RECORD_ID).map_err(io)?;
        let record = record.ok_or_else(|| fail("the points are compressed but there is no LASzip record".into()))?;
        let vlr = LazVlr::from_buffer(&record).map_err(|e| fail(format!("the LASzip record is broken: {e}")))?;
        let layers = check_items(&vlr, &header.layout).map_err(fail)?;
        if header.points > ANYWAY + POINTS_A_BYTE * header.file_bytes {
            return Err(fail(format!("{} points cannot be in {} bytes", header.points, header.file_bytes)));
        }
        // The compressor's kind is not public; it is the first number of the record.
        let is_one = record.first() == Some(&1);
        let chunks = match is_one {
            true => vec![Chunk {
                at: header.first_point,
                bytes: header.file_bytes - header.first_point,
                number: header.points,
                first: 0,
            }],
            false => chunks(file, source, header, &vlr)?,
        };
        Ok(Chunks { vlr, layers, chunks, is_one })
    }

    pub(super) fn len(&self) -> usize {
        self.chunks.len()
    }

    /// Decodes consecutive chunks side by side.
    pub(super) fn decode(
        &self,
        file: &Path,
        source: &mut dyn Source,
        layout: &Layout,
        which: Range<usize>,
    ) -> Result<Vec<Block>> {
        let batch = &self.chunks[which];
        let (Some(first), Some(last)) = (batch.first(), batch.last()) else { return Ok(Vec::new()) };
        let (start, end) = (first.at, last.at + last.bytes);
        let mut buffer = vec![0; (end - start) as usize];
        source.seek(SeekFrom::Start(start)).map_err(|e| Error::io(file, e))?;
        source.read_exact(&mut buffer).map_err(|e| Error::io(file, e))?;
        let blocks = par::map(batch, |chunk| {
            let from = (chunk.at - start) as usize;
            let bytes = &buffer[from..from + chunk.bytes as usize];
            // The last fence: on corrupt streams `laz` 0.13 indexes out of its tables, and there is no way to check the
            // stream without decoding it. Nothing of the decoder survives the panic.
            catch_unwind(AssertUnwindSafe(|| decode(bytes, chunk.number, &self.vlr, self.layers, layout)))
                .unwrap_or_else(|_| Err((0, "the compressed stream is corrupt".into())))
        });
        let placed = |(block, chunk): (Result<Block, (u64, String)>, &Chunk)| {
            block.map_err(|(done, why)| Error::data(file, Place::Element("point", chunk.first + done), why))
        };
        blocks.into_iter().zip(batch).map(placed).collect()
    }
}

pub(super) fn read(
    file: &Path,
    source: &mut dyn Source,
    header: &Header,
    out: &mut Points,
    options: &Options,
) -> Result<()> {
    let chunks = Chunks::open(file, source, header)?;
    // The check of their number makes this a fixed multiple of the file at most.
    out.reserve(header.points.min(header.file_bytes));
    let step = 4 * par::width();
    for first in (0..chunks.len()).step_by(step) {
        let which = first..chunks.len().min(first + step);
        chunks.decode(file, source, &header.layout, which)?.into_iter().for_each(|block| out.push(block));
        options.report(out.seen(), header.points);
    }
    Ok(())
}

/// The items must make up the record that the header describes; anything else would send `laz` astray. Returns the
/// number of layers in a layered chunk, 0 for the older sequential kind.
fn check_items(vlr: &LazVlr, layout: &Layout) -> Result<usize, String> {
    let mut layers = 0;
    let mut length = 0;
    for (i, item) in vlr.items().iter().enumerate() {
        let (size, its_layers, sequential) = match item.item_type() {
            LazItemType::Point10 => (20, 0, true),
            LazItemType::GpsTime => (8, 0, true),
            LazItemType::RGB12 => (6, 0, true),
            LazItemType::WavePacket13 => (29, 0, true),
            LazItemType::Byte(n) => (n, 0, true),
            LazItemType::Point14 => (30, 9, false),
            LazItemType::RGB14 => (6, 1, false),
            LazItemType::RGBNIR14 => (8, 2, false),
            LazItemType::WavePacket14 => (29, 1, false),
            LazItemType::Byte14(n) => (n, usize::from(n), false),
        };
        let versions = if sequential { 1..=2 } else { 3..=4 };
        let is_point = matches!(item.item_type(), LazItemType::Point10 | LazItemType::Point14);
        if item.size() != size || size == 0 || sequential == layout.is_extended || is_point != (i == 0) {
            return Err("the LASzip record does not describe these points".into());
        }
        if !versions.contains(&item.version()) {
            return Err(format!("LASzip item version {} is not known", item.version()));
        }
        length += usize::from(size);
        layers += its_layers;
    }
    if length != usize::from(layout.length) {
        return Err(format!("LASzip records of {length} bytes, header says {}", layout.length));
    }
    Ok(layers)
}

/// The chunk table, every entry inside the file.
fn chunks(file: &Path, source: &mut dyn Source, header: &Header, vlr: &LazVlr) -> Result<Vec<Chunk>> {
    let fail = |why: &str| Error::data(file, Place::File, why);
    let short = |_| fail("the file ends inside its chunk table, or before it");
    let mut word = [0; 8];
    let mut offset = |source: &mut dyn Source, at: SeekFrom| -> std::io::Result<u64> {
        source.seek(at)?;
        source.read_exact(&mut word)?;
        Ok(u64::from_le_bytes(word))
    };
    let data = header.first_point + 8;
    let mut table = offset(source, SeekFrom::Start(header.first_point)).map_err(short)?;
    if table < data || table > header.file_bytes {
        // A writer that could not seek back puts it at the end.
        table = offset(source, SeekFrom::End(-8)).map_err(short)?;
    }
    if table < data || table > header.file_bytes {
        return Err(fail("there is no chunk table where the file says: it was cut off or never finished"));
    }
    source.seek(SeekFrom::Start(table)).map_err(short)?;
    let mut head = [0; 8];
    source.read_exact(&mut head).map_err(short)?;
    let count = u32::from_le_bytes([head[4], head[5], head[6], head[7]]);
    // A chunk starts with a point as it is, of 20 bytes at least.
    if u64::from(count) > (table - data) / 20 {
        return Err(fail("the chunk table claims more chunks than there is room for"));
    }
    let variable = vlr.uses_variable_size_chunks();
    let mut raw = Vec::new();
    source.take(header.file_bytes - table).read_to_end(&mut raw).map_err(|e| Error::io(file, e))?;
    let sizes = catch_unwind(|| table_entries(&raw, count, variable))
        .unwrap_or_else(|_| Err(std::io::ErrorKind::InvalidData.into()))
        .map_err(|_| fail("the chunk table is corrupt"))?;
    let mut out: Vec<Chunk> = Vec::new();
    let (mut at, mut first) = (data, 0);
    for (i, (number, bytes)) in sizes.into_iter().enumerate() {
        let left = header.points - first;
        let number = match variable {
            true => u64::from(number),
            // The last chunk of fixed-size ones is the only one that may be shorter, and only the header knows.
            false if i + 1 == count as usize => left.min(vlr.chunk_size().into()),
            false => vlr.chunk_size().into(),
        };
        let bytes = u64::from(bytes);
        if at + bytes > table || number > left {
            return Err(fail("the chunk table does not fit the file"));
        }
        if number > 0 {
            out.push(Chunk { at, bytes, number, first });
        }
        at += bytes;
        first += number;
    }
    if first != header.points {
        let why = format!("the chunks end here; the header promises {}", header.points);
        return Err(Error::data(file, Place::Element("point", first), why));
    }
    Ok(out)
}

/// (points, bytes) of each chunk; points are 0 if the table does not have them.
fn table_entries(raw: &[u8], count: u32, variable: bool) -> std::io::Result<Vec<(u32, u32)>> {
    let mut out = Vec::new();
    if count == 0 {
        return Ok(out);
    }
    let mut decoder = ArithmeticDecoder::new(Cursor::new(raw));
    decoder.read_init_bytes()?;
    let mut integers = IntegerDecompressorBuilder::new().bits(32).contexts(2).build_initialized();
    let (mut number, mut bytes) = (0, 0);
    for _ in 0..count {
        if variable {
            number = integers.decompress(&mut decoder, number, 0)?;
        }
        bytes = integers.decompress(&mut decoder, bytes, 1)?;
        out.push((number as u32, bytes as u32));
        if bytes <= 0 || number < 0 {
            return Err(std::io::ErrorKind::InvalidData.into());
        }
    }
    Ok(out)
}

/// One chunk. The error tells how many of its points came out.
fn decode(bytes: &[u8], number: u64, vlr: &LazVlr, layers: usize, layout: &Layout) -> Result<Block, (u64, String)> {
    check_layers(bytes, number, layers, layout).map_err(|why| (0, why.to_owned()))?;
    let mut block = Block::default();
    let mut decoder: Box<dyn RecordDecompressor<Cursor<&[u8]>>> = match layers {
        0 => Box::new(SequentialPointRecordDecompressor::new(Cursor::new(bytes))),
        _ => Box::new(LayeredPointRecordDecompressor::new(Cursor::new(bytes))),
    };
    decoder.set_fields_from(vlr.items()).map_err(|e| (0, e.to_string()))?;
    let length = usize::from(layout.length);
    let mut buffer = vec![0; STEP * length];
    let mut done = 0;
    while done < number {
        let n = (number - done).min(STEP as u64);
        let records = &mut buffer[..n as usize * length];
        decoder.decompress_many(records).map_err(|e| (done, format!("the compressed chunk is broken: {e}")))?;
        decode_into(records, layout, &mut block);
        done += n;
    }
    Ok(block)
}

/// A layered chunk starts with a raw point, a count and the sizes of its layers, which `laz` allocates as they are.
fn check_layers(bytes: &[u8], number: u64, layers: usize, layout: &Layout) -> Result<(), &'static str> {
    if layers == 0 {
        return Ok(());
    }
    let broken = "the chunk is shorter than its layers";
    let head = bytes.get(usize::from(layout.length)..).ok_or(broken)?;
    let count = head.first_chunk().map(|b| u32::from_le_bytes(*b)).ok_or(broken)?;
    let sizes = head.get(4..4 + 4 * layers).ok_or(broken)?;
    let sum: u64 = sizes.chunks_exact(4).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]]))).sum();
    if sum > (head.len() - sizes.len()) as u64 {
        return Err(broken);
    }
    if u64::from(count) != number {
        Err("the chunk holds another number of points than its table says")
    } else {
        Ok(())
    }
}
