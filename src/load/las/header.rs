//! The header, checked against the file that it is in.

use std::io::{Read, SeekFrom};
use std::path::Path;

use las::point::Format;

use super::points::Layout;
use crate::error::{Error, Place, Result};
use crate::load::Source;

/// A variable-length record's own header.
const RECORD_HEADER: u64 = 54;

pub(super) struct Header {
    pub(super) version: (u8, u8),
    /// Point format without the compression bits.
    pub(super) format: u8,
    pub(super) is_compressed: bool,
    pub(super) layout: Layout,
    /// How many points the header claims.
    pub(super) points: u64,
    pub(super) scale: [f64; 3],
    pub(super) offset: [f64; 3],
    /// Byte of the first point record, or of the chunk table's offset.
    pub(super) first_point: u64,
    pub(super) file_bytes: u64,
    /// Where variable-length records begin, and how many there are said to be.
    first_record: u64,
    records: u64,
}

pub(super) fn read(file: &Path, source: &mut dyn Source) -> Result<Header> {
    let io = |e| Error::io(file, e);
    let fail = |why: String| Error::data(file, Place::File, why);
    let file_bytes = source.seek(SeekFrom::End(0)).map_err(io)?;
    source.rewind().map_err(io)?;
    let raw = las::raw::Header::read_from(source)
        .map_err(|_| fail("the file ends inside the header, or the header is broken".into()))?;
    let version = (raw.version.major, raw.version.minor);
    if version.0 != 1 || version.1 > 4 {
        return Err(fail(format!("LAS version {}.{} is not known", version.0, version.1)));
    }
    // Bit 7 says LAZ; bit 6 did in old files.
    let format = raw.point_data_record_format & 0x3f;
    let is_compressed = raw.point_data_record_format & 0xc0 != 0;
    if format > 10 {
        return Err(fail(format!("LAS point format {format} is not known")));
    }
    let known = Format::new(format).map_err(|e| fail(e.to_string()))?;
    let length = raw.point_data_record_length;
    if length < known.len() {
        return Err(fail(format!("records of {length} bytes are too short for point format {format}")));
    }
    let first_point = u64::from(raw.offset_to_point_data);
    if first_point < u64::from(raw.header_size).max(227) || first_point > file_bytes {
        return Err(fail(format!("the points are said to start at byte {first_point} of {file_bytes}")));
    }
    let scale = [raw.x_scale_factor, raw.y_scale_factor, raw.z_scale_factor];
    let offset = [raw.x_offset, raw.y_offset, raw.z_offset];
    if scale.iter().any(|s| *s == 0.0 || !s.is_finite()) || offset.iter().any(|o| !o.is_finite()) {
        return Err(fail("a scale factor is zero, or scale or offset is not finite".into()));
    }
    let legacy = u64::from(raw.number_of_point_records);
    let points = match raw.large_file {
        Some(large) if legacy == 0 || format >= 6 => large.number_of_point_records,
        _ => legacy,
    };
    let color = known.has_color.then_some(match (known.is_extended, known.has_gps_time) {
        (true, _) => 30,
        (false, true) => 28,
        (false, false) => 20,
    });
    Ok(Header {
        version,
        format,
        is_compressed,
        layout: Layout { length, is_extended: known.is_extended, color },
        points,
        scale,
        offset,
        first_point,
        file_bytes,
        first_record: raw.header_size.into(),
        records: raw.number_of_variable_length_records.into(),
    })
}

impl Header {
    /// For the report.
    pub(super) fn kind(&self) -> String {
        let name = if self.is_compressed { "LAZ" } else { "LAS" };
        format!("{name} {}.{} format {}", self.version.0, self.version.1, self.format)
    }

    /// The content of the variable-length record `user`/`id`, which lies between the header and the points.
    pub(super) fn record(&self, source: &mut dyn Source, user: &str, id: u16) -> std::io::Result<Option<Vec<u8>>> {
        let mut at = self.first_record;
        // The count may be garbage: the room before the points is what bounds the walk.
        for _ in 0..self.records {
            if at + RECORD_HEADER > self.first_point {
                break;
            }
            source.seek(SeekFrom::Start(at))?;
            let mut head = [0; RECORD_HEADER as usize];
            source.read_exact(&mut head)?;
            let (name, number) = (&head[2..18], u16::from_le_bytes([head[18], head[19]]));
            let length = u64::from(u16::from_le_bytes([head[20], head[21]]));
            let name = name.split(|b| *b == 0).next().unwrap_or_default();
            if name == user.as_bytes() && number == id {
                let mut content = Vec::new();
                source.take(length).read_to_end(&mut content)?;
                return Ok(Some(content));
            }
            at += RECORD_HEADER + length;
        }
        Ok(None)
    }
}
