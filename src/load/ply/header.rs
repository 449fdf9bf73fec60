//! The header's grammar. Nothing after it is looked at before all of it is understood and within limits.
//!
//! ```text
//! header   = "ply" line*  "end_header"
//! line     = "format" ("ascii" | "binary_little_endian" | "binary_big_endian") "1.0"
//!          | ("comment" | "obj_info") anything
//!          | "element" name count
//!          | "property" type name
//!          | "property" "list" integer-type type name
//! ```
//! Words are parted by any number of blanks and tabs. A line ends with LF, CR LF, or with a lone CR if the first one does;
//! the body starts right after the end of the line `end_header`, whatever its first byte is.

use std::path::Path;

use crate::error::{Error, Place, Result};

/// A header that is longer is refused: 64 KiB.
pub(super) const MAX_HEADER: usize = 64 << 10;
/// So is a line of more than 4 KiB.
const MAX_LINE: usize = 4 << 10;

/// The eight types of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Scalar> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }

    /// Bytes in a binary body.
    pub(super) fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    pub(super) fn is_float(self) -> bool {
        matches!(self, Scalar::F32 | Scalar::F64)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Little,
    Big,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    /// The type of a list's count; `None` for a scalar.
    pub(super) list: Option<Scalar>,
    pub(super) ty: Scalar,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Bytes of one binary row, if all rows have the same.
    pub(super) fn stride(&self) -> Option<usize> {
        // At most 64 KiB of header, so at most a few thousand properties: the sum cannot overflow.
        self.properties.iter().try_fold(0, |sum, p| p.list.is_none().then(|| sum + p.ty.size()))
    }

    /// A row's place in an error.
    pub(super) fn place(&self, row: u64) -> Place {
        let name = match self.name.as_str() {
            "vertex" => "vertex",
            "face" => "face",
            "tristrips" => "tristrips",
            "range_grid" => "range_grid",
            _ => "element",
        };
        Place::Element(name, row)
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Where the body starts.
    pub(super) body: usize,
    /// The line of a text body's first line, from 1.
    pub(super) body_line: u64,
}

pub(super) fn parse(file: &Path, bytes: &[u8]) -> Result<Header> {
    let head = &bytes[..bytes.len().min(MAX_HEADER)];
    let end = match head.iter().position(|b| matches!(b, b'\n' | b'\r')) {
        Some(at) if head[at] == b'\r' && head.get(at + 1) != Some(&b'\n') => b'\r',
        _ => b'\n',
    };
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut at = 0;
    let mut number = 0;
    loop {
        number += 1;
        let fail = |why: String| Error::data(file, Place::Line(number), why);
        let rest = &head[at..];
        let Some(len) = rest.iter().take(MAX_LINE + 1).position(|b| *b == end) else {
            return Err(fail(match (rest.len() > MAX_LINE, bytes.len() > MAX_HEADER) {
                (true, _) => format!("a header line is longer than {MAX_LINE} bytes"),
                (_, true) => format!("the header is longer than {MAX_HEADER} bytes"),
                _ => "the file ends inside the header: there is no line `end_header`".into(),
            }));
        };
        at += len + 1;
        // Comments may be in any encoding; words of the grammar are ASCII.
        let line = String::from_utf8_lossy(&rest[..len]);
        let words: Vec<&str> = line.split_ascii_whitespace().take(6).collect();
        match words[..] {
            ["ply"] if number == 1 => {}
            _ if number == 1 => return Err(fail("the first line is not `ply`".into())),
            [] | ["comment" | "obj_info", ..] => {}
            ["format", name, version] => {
                if format.is_some() {
                    return Err(fail("there is a second format line".into()));
                }
                if version != "1.0" {
                    return Err(fail(format!("PLY version {version} is not known, only 1.0")));
                }
                format = Some(match name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    _ => return Err(fail(format!("format {name} is not known"))),
                });
            }
            ["element", name, count] => {
                if elements.iter().any(|e| e.name == name) {
                    return Err(fail(format!("there is a second element {name}")));
                }
                let count = count_of(count).ok_or_else(|| fail(format!("{count} is not a number of rows")))?;
                elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            ["property", ..] => {
                let property = property(&words).map_err(fail)?;
                let Some(element) = elements.last_mut() else {
                    return Err(fail("a property comes before any element".into()));
                };
                if element.properties.iter().any(|p| p.name == property.name) {
                    return Err(fail(format!("there is a second property {} in {}", property.name, element.name)));
                }
                element.properties.push(property);
            }
            ["end_header"] => {
                let encoding = format.ok_or_else(|| fail("the header has no format line".into()))?;
                return Ok(Header { encoding, elements, body: at, body_line: number + 1 });
            }
            _ => return Err(fail(format!("this header line is not understood: {}", line.trim()))),
        }
    }
}

/// Digits only, and not so many that they do not fit.
fn count_of(word: &str) -> Option<u64> {
    (word.len() <= 20 && word.bytes().all(|b| b.is_ascii_digit())).then(|| word.parse().ok())?
}

fn property(words: &[&str]) -> Result<Property, String> {
    let ty = |name: &str| Scalar::named(name).ok_or_else(|| format!("{name} is not a type"));
    match *words {
        ["property", "list", count, item, name] => {
            let count = ty(count)?;
            if count.is_float() {
                return Err("a list's length must have an integer type".into());
            }
            Ok(Property { name: name.into(), list: Some(count), ty: ty(item)? })
        }
        ["property", item, name] => Ok(Property { name: name.into(), list: None, ty: ty(item)? }),
        _ => Err(format!("this property is not understood: {}", words.join(" "))),
    }
}
