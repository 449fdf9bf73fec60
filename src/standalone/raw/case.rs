//! What is timed: one value on each axis, and a table that varies one at a time.

use std::fmt;

use ash::vk;

use crate::draw::targets::{DEPTH, SUMS};
use crate::gpu::program::BlendMode;
use crate::technique::Primitive;

/// Where a vertex comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Vertices {
    /// A stream of three floats, 12 B.
    F32x3,
    /// A stream of four floats, 16 B.
    F32x4,
    /// A stream of four 16-bit fractions, 8 B.
    Unorm16x4,
    /// Four floats, 16 B, read from storage by the vertex's number.
    Pulled,
    /// Computed from the vertex's number: no memory is read.
    Computed,
}

/// What colours are kept in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Color {
    /// Four bytes.
    Rgba8,
    /// Four half floats.
    Rgba16f,
    /// Four floats: what the library's sums are.
    Rgba32f,
    /// One float.
    R32f,
}

/// What is drawn where.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Passes {
    /// One pass with colours alone.
    Color,
    /// One pass with depth alone, tested and written.
    Depth,
    /// One pass with both: the nearest fragment stays. What blend `opaque` does.
    Opaque,
    /// A pass with depth alone, then one that adds the colours of what is not behind it, and marks in the stencil what is.
    /// What blend `two-pass` does.
    TwoPass,
}

/// One thing to time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Case {
    /// The axis that it varies; `base` and `technique` for what varies none or several.
    pub axis: &'static str,
    /// What is rasterised.
    pub primitive: Primitive,
    /// Side of a point's square \[px\], 1 to [`super::LARGEST`].
    pub size: u32,
    /// Where vertices come from; quads are pulled.
    pub vertices: Vertices,
    /// Passes.
    pub passes: Passes,
    /// Colour attachments, 1 to 4; 0 with depth alone.
    pub attachments: u32,
    /// Format of every colour attachment.
    pub color: Color,
    /// Fragments are added, not put in place. With `two-pass`, of the second attachment's alpha the greatest stays.
    pub blend: bool,
}

const BASE: Case = Case {
    axis: "base",
    primitive: Primitive::Point,
    size: 4,
    vertices: Vertices::F32x4,
    passes: Passes::Color,
    attachments: 1,
    color: Color::Rgba32f,
    blend: true,
};

/// The base case – points of 4 px from streams of four floats, added into one RGBA32F attachment –, every other value of
/// one axis at a time, and what the library's techniques do.
pub fn cases() -> Vec<Case> {
    let mut all = vec![BASE];
    all.extend([1, 2, 8, 16, 32, 64].map(|size| Case { axis: "size", size, ..BASE }));
    let quad = Case { primitive: Primitive::Quad, vertices: Vertices::Pulled, ..BASE };
    all.extend([1, 4, 16, 64].map(|size| Case { axis: "primitive", size, ..quad }));
    let formats = [Vertices::F32x3, Vertices::Unorm16x4, Vertices::Pulled, Vertices::Computed];
    all.extend(formats.map(|vertices| Case { axis: "vertices", vertices, ..BASE }));
    all.push(Case { axis: "attachments", passes: Passes::Depth, attachments: 0, blend: false, ..BASE });
    all.extend([2, 3, 4].map(|attachments| Case { axis: "attachments", attachments, ..BASE }));
    for color in [Color::Rgba8, Color::Rgba16f, Color::Rgba32f, Color::R32f] {
        let case = Case { axis: "format", color, ..BASE };
        all.extend(
            [Case { blend: false, ..case }, case].into_iter().filter(|c| Case { axis: BASE.axis, ..*c } != BASE),
        );
    }
    for of in [BASE, quad] {
        for attachments in [1, 2] {
            let case = Case { axis: "technique", attachments, ..of };
            all.push(Case { passes: Passes::Opaque, blend: false, ..case });
            all.push(Case { passes: Passes::TwoPass, ..case });
        }
    }
    all
}

impl Case {
    /// How often every point is rasterised.
    pub fn draws(&self) -> u64 {
        if self.passes == Passes::TwoPass { 2 } else { 1 }
    }

    /// Of the depth attachment, if there is one: with a stencil only where that is used.
    pub(super) fn depth_format(&self) -> Option<vk::Format> {
        match self.passes {
            Passes::Color => None,
            Passes::Depth => Some(vk::Format::D32_SFLOAT),
            Passes::Opaque | Passes::TwoPass => Some(DEPTH),
        }
    }

    /// Of attachment `i`.
    pub(super) fn blend_mode(&self, i: u32) -> BlendMode {
        match (self.blend, self.passes, i) {
            (false, ..) => BlendMode::Replace,
            (true, Passes::TwoPass, 1) => BlendMode::AddMax,
            (true, ..) => BlendMode::Add,
        }
    }
}

impl fmt::Display for Case {
    /// A name that tells the case from all others, and stays from one version to the next: baselines know it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let passes = match self.passes {
            Passes::Color | Passes::Depth => "",
            Passes::Opaque => "opaque ",
            Passes::TwoPass => "two-pass ",
        };
        let primitive = match self.primitive {
            Primitive::Point => "point",
            Primitive::Quad => "quad",
        };
        write!(f, "{passes}{primitive} {}px {}", self.size, self.vertices.name())?;
        match self.attachments {
            0 => write!(f, " depth"),
            n => write!(f, " {n}x{} {}", self.color.name(), if self.blend { "add" } else { "replace" }),
        }
    }
}

impl Passes {
    /// Its name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Passes::Color => "color",
            Passes::Depth => "depth",
            Passes::Opaque => "opaque",
            Passes::TwoPass => "two-pass",
        }
    }
}

impl Vertices {
    /// Its name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Vertices::F32x3 => "f32x3",
            Vertices::F32x4 => "f32x4",
            Vertices::Unorm16x4 => "unorm16x4",
            Vertices::Pulled => "pulled",
            Vertices::Computed => "computed",
        }
    }

    /// Format and bytes of the stream, where there is one.
    pub(super) fn stream(self) -> Option<(vk::Format, u32)> {
        match self {
            Vertices::F32x3 => Some((vk::Format::R32G32B32_SFLOAT, 12)),
            Vertices::F32x4 => Some((vk::Format::R32G32B32A32_SFLOAT, 16)),
            Vertices::Unorm16x4 => Some((vk::Format::R16G16B16A16_UNORM, 8)),
            Vertices::Pulled | Vertices::Computed => None,
        }
    }
}

impl Color {
    /// Its name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Color::Rgba8 => "rgba8",
            Color::Rgba16f => "rgba16f",
            Color::Rgba32f => "rgba32f",
            Color::R32f => "r32f",
        }
    }

    pub(super) fn format(self) -> vk::Format {
        match self {
            Color::Rgba8 => vk::Format::R8G8B8A8_UNORM,
            Color::Rgba16f => vk::Format::R16G16B16A16_SFLOAT,
            Color::Rgba32f => SUMS,
            Color::R32f => vk::Format::R32_SFLOAT,
        }
    }

    /// The largest number to which it counts by ones: full bytes, and the integers that a float holds without gaps.
    pub(super) fn most(self) -> u32 {
        match self {
            Color::Rgba8 => 255,
            Color::Rgba16f => 1 << 11,
            Color::Rgba32f | Color::R32f => 1 << 24,
        }
    }

    /// Channels, and how one is read from its bytes; bytes count as whole numbers.
    pub(super) fn decode(self, bytes: &[u8]) -> Vec<f32> {
        let half = |b: u16| {
            let (exponent, mantissa) = ((b >> 10 & 31) as i32, (b & 1023) as f32);
            let value =
                if exponent == 0 { mantissa * 2f32.powi(-24) } else { (1024.0 + mantissa) * 2f32.powi(exponent - 25) };
            if b >> 15 == 1 { -value } else { value }
        };
        match self {
            Color::Rgba8 => bytes.iter().map(|&b| b as f32).collect(),
            Color::Rgba16f => bytes.chunks_exact(2).map(|b| half(u16::from_le_bytes([b[0], b[1]]))).collect(),
            Color::Rgba32f | Color::R32f => {
                bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
            }
        }
    }

    pub(super) fn channels(self) -> usize {
        if self == Color::R32f { 1 } else { 4 }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn names_tell_cases_apart() {
        let all = cases();
        let names: HashSet<String> = all.iter().map(|c| c.to_string()).collect();
        assert_eq!(names.len(), all.len());
        assert_eq!(all[0].to_string(), "point 4px f32x4 1xrgba32f add");
        assert!(names.contains("two-pass quad 4px pulled 2xrgba32f add") && names.contains("point 4px f32x4 depth"));
    }

    #[test]
    fn one_axis_at_a_time() {
        for case in cases() {
            let others = [
                case.primitive != BASE.primitive,
                case.size != BASE.size,
                case.vertices != BASE.vertices && case.primitive == BASE.primitive,
                case.attachments != BASE.attachments,
                case.color != BASE.color,
            ];
            let changed = others.iter().filter(|o| **o).count();
            // A quad of another size is compared with the quad of the base's.
            let most = if matches!(case.axis, "technique" | "primitive") { 2 } else { 1 };
            assert!(changed <= most, "{case}");
        }
    }

    #[test]
    fn halves_are_decoded() {
        let bits = [0x3c00u16, 0x4000, 0x6800, 0xbc00, 0x0001, 0];
        let bytes: Vec<u8> = bits.iter().flat_map(|b| b.to_le_bytes()).collect();
        assert_eq!(Color::Rgba16f.decode(&bytes), [1.0, 2.0, 2048.0, -1.0, 2f32.powi(-24), 0.0]);
    }
}
