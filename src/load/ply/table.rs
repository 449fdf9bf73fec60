//! Rows of one length with numbers at fixed places: a binary body as it lies in the file, or a text body transcoded.
//!
//! A column is read in a loop of its own, compiled for its type and byte order; the rows of one block stay in the
//! processor's cache meanwhile, so that many columns cost little more than one.

use std::borrow::Cow;

use super::header::{Element, Encoding, Scalar};

/// Rows that are read together: with 27 bytes a row 110 KB, which fits a second-level cache.
pub(super) const BLOCK: usize = 4096;

#[derive(Debug, Clone, Copy)]
pub(super) struct Field {
    offset: usize,
    pub(super) ty: Scalar,
}

pub(super) struct Table<'a> {
    bytes: Cow<'a, [u8]>,
    stride: usize,
    big: bool,
    fields: Vec<(String, Field)>,
}

impl<'a> Table<'a> {
    /// Binary rows of `element` as they lie in the file. `None` if it has lists.
    pub(super) fn in_place(bytes: &'a [u8], element: &Element, encoding: Encoding) -> Option<Table<'a>> {
        let stride = element.stride()?;
        let mut fields = Vec::with_capacity(element.properties.len());
        let mut offset = 0;
        for p in &element.properties {
            fields.push((p.name.clone(), Field { offset, ty: p.ty }));
            offset += p.ty.size();
        }
        Some(Table { bytes: Cow::Borrowed(bytes), stride, big: encoding == Encoding::Big, fields })
    }

    /// An empty table with the given columns, to be filled by [`Table::push`].
    pub(super) fn with_columns(columns: impl Iterator<Item = (String, Scalar)>) -> Table<'static> {
        let mut fields = Vec::new();
        let mut stride = 0;
        for (name, ty) in columns {
            fields.push((name, Field { offset: stride, ty }));
            stride += ty.size();
        }
        Table { bytes: Cow::Owned(Vec::new()), stride, big: false, fields }
    }

    pub(super) fn reserve(&mut self, rows: usize) {
        let bytes = rows.saturating_mul(self.stride);
        self.bytes.to_mut().reserve(bytes);
    }

    /// The next value of the next row, in the order of the columns.
    pub(super) fn push(&mut self, ty: Scalar, value: Value) {
        let out = self.bytes.to_mut();
        match ty {
            Scalar::I8 => out.extend((value.integer() as i8).to_le_bytes()),
            Scalar::U8 => out.extend((value.integer() as u8).to_le_bytes()),
            Scalar::I16 => out.extend((value.integer() as i16).to_le_bytes()),
            Scalar::U16 => out.extend((value.integer() as u16).to_le_bytes()),
            Scalar::I32 => out.extend((value.integer() as i32).to_le_bytes()),
            Scalar::U32 => out.extend((value.integer() as u32).to_le_bytes()),
            Scalar::F32 => out.extend(value.narrow().to_le_bytes()),
            Scalar::F64 => out.extend(value.wide().to_le_bytes()),
        }
    }

    pub(super) fn rows(&self) -> usize {
        self.bytes.len().checked_div(self.stride).unwrap_or(0)
    }

    pub(super) fn field(&self, name: &str) -> Option<Field> {
        self.fields.iter().find(|(n, _)| n == name).map(|(_, f)| *f)
    }

    /// All of `names`, or nothing.
    pub(super) fn fields<const N: usize>(&self, names: [&str; N]) -> Option<[Field; N]> {
        let found = names.map(|name| self.field(name));
        found.iter().all(Option::is_some).then(|| found.map(|f| f.unwrap_or(Field { offset: 0, ty: Scalar::U8 })))
    }

    /// Hands the value of `field` in rows `first..first + out.len()` to `set`, one row after the other.
    #[inline]
    pub(super) fn each<T>(&self, field: Field, first: usize, out: &mut [T], set: impl Fn(&mut T, f64)) {
        let rows = &self.bytes[first * self.stride..(first + out.len()) * self.stride];
        let rows = rows.chunks_exact(self.stride);
        macro_rules! read {
            ($ty:ty, $from:ident) => {
                for (out, row) in out.iter_mut().zip(rows) {
                    if let Some(b) = row.get(field.offset..).and_then(|r| r.first_chunk()) {
                        set(out, <$ty>::$from(*b) as f64);
                    }
                }
            };
        }
        match (field.ty, self.big) {
            (Scalar::I8, _) => read!(i8, from_le_bytes),
            (Scalar::U8, _) => read!(u8, from_le_bytes),
            (Scalar::I16, false) => read!(i16, from_le_bytes),
            (Scalar::I16, true) => read!(i16, from_be_bytes),
            (Scalar::U16, false) => read!(u16, from_le_bytes),
            (Scalar::U16, true) => read!(u16, from_be_bytes),
            (Scalar::I32, false) => read!(i32, from_le_bytes),
            (Scalar::I32, true) => read!(i32, from_be_bytes),
            (Scalar::U32, false) => read!(u32, from_le_bytes),
            (Scalar::U32, true) => read!(u32, from_be_bytes),
            (Scalar::F32, false) => read!(f32, from_le_bytes),
            (Scalar::F32, true) => read!(f32, from_be_bytes),
            (Scalar::F64, false) => read!(f64, from_le_bytes),
            (Scalar::F64, true) => read!(f64, from_be_bytes),
        }
    }

    /// Three values a row, in one pass where they lie side by side with one type, as x, y, z nearly always do.
    #[inline]
    pub(super) fn each3<T>(&self, fields: [Field; 3], first: usize, out: &mut [T], set: impl Fn(&mut T, [f64; 3])) {
        let [a, b, c] = fields;
        let size = a.ty.size();
        let adjacent = b.offset == a.offset + size && c.offset == b.offset + size && a.ty == b.ty && b.ty == c.ty;
        let rows = self.bytes[first * self.stride..(first + out.len()) * self.stride].chunks_exact(self.stride);
        macro_rules! read {
            ($ty:ty, $size:literal, $from:ident) => {
                for (out, row) in out.iter_mut().zip(rows) {
                    if let Some((&[a, b, c], _)) =
                        row.get(a.offset..).map(|r| r.as_chunks::<$size>()).and_then(|(r, _)| r.split_first_chunk())
                    {
                        set(out, [a, b, c].map(|v| <$ty>::$from(v) as f64));
                    }
                }
            };
        }
        match (adjacent, a.ty, self.big) {
            (true, Scalar::U8, _) => read!(u8, 1, from_le_bytes),
            (true, Scalar::F32, false) => read!(f32, 4, from_le_bytes),
            (true, Scalar::F32, true) => read!(f32, 4, from_be_bytes),
            (true, Scalar::F64, false) => read!(f64, 8, from_le_bytes),
            (true, Scalar::F64, true) => read!(f64, 8, from_be_bytes),
            _ => {
                let mut block = vec![[0.0; 3]; out.len()];
                for (i, field) in fields.into_iter().enumerate() {
                    self.each(field, first, &mut block, |row, v| row[i] = v);
                }
                out.iter_mut().zip(block).for_each(|(out, row)| set(out, row));
            }
        }
    }

    /// One value.
    pub(super) fn at(&self, field: Field, row: usize) -> f64 {
        let mut out = [0.0];
        self.each(field, row, &mut out, |o, v| *o = v);
        out[0]
    }

    /// A whole column, each value through `f`.
    pub(super) fn column<T: Clone + Send>(&self, field: Field, zero: T, f: impl Fn(f64) -> T + Sync + Send) -> Vec<T> {
        let mut out = vec![zero; self.rows()];
        crate::par::fill(&mut out, BLOCK, |first, out| self.each(field, first, out, |o, v| *o = f(v)));
        out
    }
}

/// A number before it takes the type that the header declares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value {
    Integer(i64),
    Narrow(f32),
    Wide(f64),
}

impl Value {
    pub(super) fn integer(self) -> i64 {
        match self {
            Value::Integer(v) => v,
            Value::Narrow(v) => v as i64,
            Value::Wide(v) => v as i64,
        }
    }

    fn narrow(self) -> f32 {
        match self {
            Value::Integer(v) => v as f32,
            Value::Narrow(v) => v,
            Value::Wide(v) => v as f32,
        }
    }

    fn wide(self) -> f64 {
        match self {
            Value::Integer(v) => v as f64,
            Value::Narrow(v) => v.into(),
            Value::Wide(v) => v,
        }
    }
}
