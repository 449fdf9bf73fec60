//! Vertices that carry lists among their numbers: rare, never laid out by us, and read by the crate `ply-rs`.
//!
//! `ply-rs` 0.1.3 panics on a header whose count has too many digits and reads endless lines, so it never sees a header:
//! it gets one element's definition from our own grammar, one row at a time, and no more bytes than there are. A list's
//! count cannot make it allocate, because it grows its vectors value by value and ends with the bytes.

use std::path::Path;

use ply_rs::parser::Parser;
use ply_rs::ply::{Addable, ElementDef, Property as Read, PropertyAccess, PropertyDef, PropertyType, ScalarType};

use super::ascii::{Lines, truncated};
use super::header::{Element, Encoding, Scalar};
use super::table::{Table, Value};
use crate::error::{Error, Place, Result};

/// The scalars of one row with their names; lists are dropped as they come.
struct Row(Vec<(String, Value)>);

impl PropertyAccess for Row {
    fn new() -> Row {
        Row(Vec::new())
    }

    fn set_property(&mut self, name: String, property: Read) {
        let value = match property {
            Read::Char(v) => Value::Integer(v.into()),
            Read::UChar(v) => Value::Integer(v.into()),
            Read::Short(v) => Value::Integer(v.into()),
            Read::UShort(v) => Value::Integer(v.into()),
            Read::Int(v) => Value::Integer(v.into()),
            Read::UInt(v) => Value::Integer(v.into()),
            Read::Float(v) => Value::Narrow(v),
            Read::Double(v) => Value::Wide(v),
            _ => return,
        };
        self.0.push((name, value));
    }
}

fn definition(element: &Element) -> ElementDef {
    let ty = |ty| match ty {
        Scalar::I8 => ScalarType::Char,
        Scalar::U8 => ScalarType::UChar,
        Scalar::I16 => ScalarType::Short,
        Scalar::U16 => ScalarType::UShort,
        Scalar::I32 => ScalarType::Int,
        Scalar::U32 => ScalarType::UInt,
        Scalar::F32 => ScalarType::Float,
        Scalar::F64 => ScalarType::Double,
    };
    let mut out = ElementDef::new(element.name.clone());
    for p in &element.properties {
        let kind = match p.list {
            Some(count) => PropertyType::List(ty(count), ty(p.ty)),
            None => PropertyType::Scalar(ty(p.ty)),
        };
        out.properties.add(PropertyDef::new(p.name.clone(), kind));
    }
    out
}

fn empty_table(element: &Element) -> Table<'static> {
    Table::with_columns(element.properties.iter().filter(|p| p.list.is_none()).map(|p| (p.name.clone(), p.ty)))
}

fn push(table: &mut Table, element: &Element, row: &Row) {
    for p in element.properties.iter().filter(|p| p.list.is_none()) {
        // Every scalar of the definition is set exactly once.
        let value = row.0.iter().find(|(name, _)| *name == p.name).map_or(Value::Integer(0), |(_, v)| *v);
        table.push(p.ty, value);
    }
}

/// Binary rows from `at`; returns the table and where it ends.
pub(super) fn binary(
    file: &Path,
    bytes: &[u8],
    at: usize,
    element: &Element,
    encoding: Encoding,
) -> Result<(Table<'static>, usize)> {
    // Finds a short file, negative counts and counts beyond the file's end, with their place, before ply-rs reads.
    let end = super::faces::binary(file, bytes, at, element, encoding, None)?;
    let (parser, definition) = (Parser::<Row>::new(), definition(element));
    let mut table = empty_table(element);
    let mut rest = &bytes[at..end];
    for row in 0..element.count {
        let read = match encoding {
            Encoding::Big => parser.read_big_endian_element(&mut rest, &definition),
            _ => parser.read_little_endian_element(&mut rest, &definition),
        };
        let read = read.map_err(|e| Error::data(file, element.place(row), e.to_string()))?;
        push(&mut table, element, &read);
    }
    Ok((table, end))
}

/// Text rows.
pub(super) fn text(file: &Path, lines: &mut Lines, element: &Element) -> Result<Table<'static>> {
    let (parser, definition) = (Parser::<Row>::new(), definition(element));
    let mut table = empty_table(element);
    for row in 0..element.count {
        let line = lines.next().ok_or_else(|| truncated(file, element, row))?;
        let line = String::from_utf8_lossy(line);
        let read = parser.read_ascii_element(&line, &definition).map_err(|e| {
            // Its messages are several lines with the whole input in them: the last one says what was wrong.
            let why = e.to_string();
            let why = why.lines().last().unwrap_or_default().trim().chars().take(200).collect::<String>();
            Error::data(file, Place::Line(lines.number), format!("the line of {} {row}: {why}", element.name))
        })?;
        push(&mut table, element, &read);
    }
    Ok(table)
}
