//! Text bodies: one row a line, words parted by blanks.

use std::path::Path;

use super::header::{Element, Header, Scalar};
use super::table::{Table, Value};
use crate::error::{Error, Place, Result};

/// Lines of a text body that have at least one word. LF, CR LF and CR end a line.
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    /// The line that the last call returned, from 1.
    pub(super) number: u64,
    next: u64,
}

impl<'a> Lines<'a> {
    pub(super) fn new(bytes: &'a [u8], header: &Header) -> Lines<'a> {
        Lines { rest: bytes.get(header.body..).unwrap_or(&[]), number: header.body_line, next: header.body_line }
    }

    pub(super) fn next(&mut self) -> Option<&'a [u8]> {
        while !self.rest.is_empty() {
            let len = self.rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(self.rest.len());
            let (line, after) = self.rest.split_at(len);
            self.rest = match after {
                [b'\r', b'\n', rest @ ..] | [_, rest @ ..] => rest,
                [] => after,
            };
            self.number = self.next;
            self.next += 1;
            if line.iter().any(|b| !b.is_ascii_whitespace()) {
                return Some(line);
            }
        }
        None
    }

    pub(super) fn bytes_left(&self) -> usize {
        self.rest.len()
    }
}

/// The words of a line.
pub(super) struct Words<'a>(&'a [u8]);

impl<'a> Words<'a> {
    pub(super) fn new(line: &'a [u8]) -> Words<'a> {
        Words(line)
    }

    pub(super) fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.0.iter().position(|b| !b.is_ascii_whitespace())?;
        let word = &self.0[start..];
        let len = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
        let (word, rest) = word.split_at(len);
        self.0 = rest;
        Some(word)
    }
}

/// A word as a number of type `ty`. Integers out of their type's range are refused.
pub(super) fn value(word: &[u8], ty: Scalar) -> Result<Value, String> {
    let refuse = |what: &str| {
        let shown = &word[..word.len().min(40)];
        format!("`{}` is not {what}", String::from_utf8_lossy(shown))
    };
    let text = std::str::from_utf8(word).map_err(|_| refuse("a number"))?;
    let (low, high) = match ty {
        Scalar::F32 => return float(text).map(Value::Narrow).ok_or_else(|| refuse("a number")),
        Scalar::F64 => return float(text).map(Value::Wide).ok_or_else(|| refuse("a number")),
        Scalar::I8 => (i8::MIN.into(), i8::MAX.into()),
        Scalar::U8 => (0, u8::MAX.into()),
        Scalar::I16 => (i16::MIN.into(), i16::MAX.into()),
        Scalar::U16 => (0, u16::MAX.into()),
        Scalar::I32 => (i32::MIN.into(), i32::MAX.into()),
        Scalar::U32 => (0, u32::MAX.into()),
    };
    // Some writers put `255.0` into integer columns.
    let whole = || text.parse::<f64>().ok().filter(|v| v.fract() == 0.0 && v.abs() < 1e15).map(|v| v as i64);
    match text.parse::<i64>().ok().or_else(whole) {
        Some(v) if (low..=high).contains(&v) => Ok(Value::Integer(v)),
        _ => Err(refuse("a whole number of the declared type")),
    }
}

/// Rust knows `nan` and `inf`; C runtimes write `-nan`, `nan(ind)`, `-1.#IND` and `1.#QNAN` as well.
fn float<T: std::str::FromStr + From<f32>>(text: &str) -> Option<T> {
    if let Ok(v) = text.parse() {
        return Some(v);
    }
    let bare = text.trim_start_matches(['+', '-']);
    let odd = bare.starts_with("1.#") || bare.get(..3).is_some_and(|s| s.eq_ignore_ascii_case("nan"));
    odd.then(|| T::from(f32::NAN))
}

/// The scalar columns of `element` that `wanted` names, transcoded to a table.
pub(super) fn rows(
    file: &Path,
    lines: &mut Lines,
    element: &Element,
    wanted: impl Fn(&str) -> bool,
    mut progress: impl FnMut(u64),
) -> Result<Table<'static>> {
    // Up to the last wanted column; what follows it on the line is not looked at.
    let columns: Vec<(Scalar, bool)> = element.properties.iter().map(|p| (p.ty, wanted(&p.name))).collect();
    let used = columns.iter().rposition(|(_, wanted)| *wanted).map_or(0, |i| i + 1);
    let picked = element.properties.iter().filter(|p| wanted(&p.name));
    let mut table = Table::with_columns(picked.map(|p| (p.name.clone(), p.ty)));
    // A row takes two bytes at least: a digit and the end of the line.
    table.reserve(usize::try_from(element.count).unwrap_or(usize::MAX).min(lines.bytes_left() / (2 * used.max(1)) + 1));
    for row in 0..element.count {
        let line = lines.next().ok_or_else(|| truncated(file, element, row))?;
        let mut words = Words::new(line);
        for (i, (ty, wanted)) in columns[..used].iter().enumerate() {
            let fail = |why: String| Error::data(file, Place::Line(lines.number), why);
            let Some(word) = words.next() else {
                let name = &element.properties[i].name;
                return Err(fail(format!("the line of {} {row} ends before its {name}", element.name)));
            };
            if *wanted {
                table.push(*ty, value(word, *ty).map_err(fail)?);
            }
        }
        if row % 65536 == 0 {
            progress(row);
        }
    }
    Ok(table)
}

/// Passes over the rows of an element that nobody wants.
pub(super) fn skip(file: &Path, lines: &mut Lines, element: &Element) -> Result<()> {
    if element.properties.is_empty() {
        return Ok(());
    }
    for row in 0..element.count {
        lines.next().ok_or_else(|| truncated(file, element, row))?;
    }
    Ok(())
}

pub(super) fn truncated(file: &Path, element: &Element, row: u64) -> Error {
    Error::data(file, element.place(row), format!("the file ends here; the header promises {}", element.count))
}
