//! Faces: polygons become fans of triangles, strips with −1 restarts are unrolled.

use std::path::Path;

use super::ascii::{self, Lines, Words, truncated};
use super::header::{Element, Encoding, Scalar};
use crate::error::{Error, Place, Result};
use crate::load::Report;

/// Triangles of the vertices in the file, all indices in range.
#[derive(Default)]
pub(super) struct Faces {
    pub(super) triangles: Vec<[u32; 3]>,
    /// Vertices that there are, from the header.
    vertices: u64,
    out_of_range: u64,
    short: u64,
    degenerate: u64,
}

/// The property that holds the corners, if `element` is one of faces or strips.
pub(super) fn corners_of(element: &Element) -> Option<usize> {
    let strips = element.name == "tristrips";
    if !strips && element.name != "face" {
        return None;
    }
    let named = |name| element.properties.iter().position(|p| p.list.is_some() && p.name == name);
    named("vertex_indices").or_else(|| named("vertex_index"))
}

impl Faces {
    pub(super) fn new(vertices: u64) -> Faces {
        Faces { vertices, ..Default::default() }
    }

    fn corner(&self, index: i64) -> Option<u32> {
        u32::try_from(index).ok().filter(|&i| u64::from(i) < self.vertices)
    }

    fn triangle(&mut self, t: [u32; 3]) {
        if t[0] == t[1] || t[1] == t[2] || t[0] == t[2] {
            self.degenerate += 1;
        } else {
            self.triangles.push(t);
        }
    }

    fn polygon(&mut self, corners: &[i64]) {
        if corners.len() < 3 {
            self.short += 1;
        } else if corners.iter().any(|&c| self.corner(c).is_none()) {
            self.out_of_range += 1;
        } else {
            let at = |i: usize| corners[i] as u32;
            for i in 2..corners.len() {
                self.triangle([at(0), at(i - 1), at(i)]);
            }
        }
    }

    fn strips(&mut self, list: &[i64]) {
        for strip in list.split(|&i| i == -1).filter(|s| !s.is_empty()) {
            if strip.len() < 3 {
                self.short += 1;
            }
            for (i, t) in strip.windows(3).enumerate() {
                match (self.corner(t[0]), self.corner(t[1]), self.corner(t[2])) {
                    // Every other triangle of a strip is listed clockwise.
                    (Some(a), Some(b), Some(c)) if i % 2 == 0 => self.triangle([a, b, c]),
                    (Some(a), Some(b), Some(c)) => self.triangle([b, a, c]),
                    _ => self.out_of_range += 1,
                }
            }
        }
    }

    fn list(&mut self, strips: bool, list: &[i64]) {
        if strips { self.strips(list) } else { self.polygon(list) }
    }

    /// Writes down what was left out.
    pub(super) fn note(&self, report: &mut Report) {
        report.drop("faces with corners out of range", self.out_of_range);
        report.drop("faces with fewer than three corners", self.short);
        report.drop("degenerate triangles", self.degenerate);
    }
}

/// Walks over the binary rows of `element` from `at`, hands face corners to `faces`, and returns where it ends.
pub(super) fn binary(
    file: &Path,
    bytes: &[u8],
    mut at: usize,
    element: &Element,
    encoding: Encoding,
    mut faces: Option<&mut Faces>,
) -> Result<usize> {
    let corners = corners_of(element).filter(|_| faces.is_some());
    if let (None, Some(stride)) = (corners, element.stride()) {
        let left = bytes.len() - at;
        let size = usize::try_from(element.count).ok().and_then(|n| n.checked_mul(stride)).filter(|n| *n <= left);
        return size.map(|n| at + n).ok_or_else(|| truncated(file, element, (left / stride.max(1)) as u64));
    }
    let big = encoding == Encoding::Big;
    let strips = element.name == "tristrips";
    let mut list = Vec::new();
    for row in 0..element.count {
        for (i, p) in element.properties.iter().enumerate() {
            let mut take = |n: usize| -> Result<&[u8]> {
                let taken = bytes[at..].get(..n).ok_or_else(|| truncated(file, element, row))?;
                at += n;
                Ok(taken)
            };
            let Some(count) = p.list else {
                take(p.ty.size())?;
                continue;
            };
            let n = integer(take(count.size())?, count, big);
            let Ok(n) = usize::try_from(n) else {
                return Err(Error::data(file, element.place(row), format!("a list has {n} items")));
            };
            let size = n.checked_mul(p.ty.size()).ok_or_else(|| truncated(file, element, row))?;
            let items = take(size)?;
            if corners == Some(i) {
                list.clear();
                list.extend(items.chunks_exact(p.ty.size()).map(|b| integer(b, p.ty, big)));
                if let Some(faces) = &mut faces {
                    faces.list(strips, &list);
                }
            }
        }
    }
    Ok(at)
}

/// A number as an integer; what is not whole becomes −2, which is no index.
fn integer(b: &[u8], ty: Scalar, big: bool) -> i64 {
    let mut raw = [0; 8];
    for (i, out) in raw.iter_mut().take(b.len()).enumerate() {
        *out = b[if big { b.len() - 1 - i } else { i }];
    }
    let v = u64::from_le_bytes(raw);
    let whole = |v: f64| if v.fract() == 0.0 && v.abs() < 1e15 { v as i64 } else { -2 };
    match ty {
        Scalar::I8 => (v as i8).into(),
        Scalar::U8 | Scalar::U16 | Scalar::U32 => v as i64,
        Scalar::I16 => (v as i16).into(),
        Scalar::I32 => (v as i32).into(),
        Scalar::F32 => whole(f32::from_bits(v as u32).into()),
        Scalar::F64 => whole(f64::from_bits(v)),
    }
}

/// Reads the text rows of an element of faces.
pub(super) fn text(file: &Path, lines: &mut Lines, element: &Element, faces: &mut Faces) -> Result<()> {
    let Some(corners) = corners_of(element) else { return ascii::skip(file, lines, element) };
    let strips = element.name == "tristrips";
    let mut list = Vec::new();
    for row in 0..element.count {
        let line = lines.next().ok_or_else(|| truncated(file, element, row))?;
        let fail = |why: String| Error::data(file, Place::Line(lines.number), why);
        let short = || fail(format!("the line of {} {row} ends too soon", element.name));
        let mut words = Words::new(line);
        // What follows the corners does not matter.
        for (i, p) in element.properties[..=corners].iter().enumerate() {
            let Some(count) = p.list else {
                words.next().ok_or_else(short)?;
                continue;
            };
            let n = ascii::value(words.next().ok_or_else(short)?, count).map_err(fail)?.integer();
            let n = u64::try_from(n).map_err(|_| fail(format!("a list has {n} items")))?;
            list.clear();
            for _ in 0..n {
                // The loop ends with the line, whatever the count claims.
                let word = words.next().ok_or_else(short)?;
                if i == corners {
                    list.push(ascii::value(word, p.ty).map_err(fail)?.integer());
                }
            }
        }
        faces.list(strips, &list);
    }
    Ok(())
}
