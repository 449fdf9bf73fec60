//! Fewer bytes a point, in memory and on the device.
//!
//! | packing | bytes a point | positions | radii | normals | colours |
//! |---|---|---|---|---|---|
//! | full | 16, 4 more for each of normals and colours | exact | exact | 6.5·10⁻⁵ rad | exact |
//! | exact | 16, 2 more with normals | exact | [`Radii`] | 0.017 rad | exact |
//! | quantised | 8, with both normals and colours 9; 1/16 for its [`Frame`] | half a step of the frame | [`Radii`] | 0.017 rad | exact; with normals 6 bits a channel |
//!
//! A packed cloud is what its decoded values say: reference, selection and bounds take the very floats that the device decodes.
//! Decoding is by integers, products without rounding and one rounded sum, so a fused product does no harm. Twin:
//! `glsl/shared/packing.glsl`.

mod exact;
mod frame;
mod quantised;
mod radii;

use std::borrow::Cow;
use std::ops::Range;

use super::{Flat, octahedral};
use crate::technique::names;

pub use exact::Exact;
pub use frame::{Frame, RUN};
pub use quantised::Quantised;
pub use radii::Radii;

/// Points a task.
const GRAIN: usize = 1 << 14;
const _: () = assert!(GRAIN.is_multiple_of(RUN));

/// How many bytes a point has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Packing {
    /// Single floats for position and radius, 32 bits each for normal and colour.
    #[default]
    Full,
    /// Positions and colours to the bit; radii as codes, rounded up; normals in 16 bits.
    Exact,
    /// Positions in steps of the box of 256 points.
    Quantised,
}

names!(Packing { Full = "full", Exact = "exact", Quantised = "quantised" });

/// The points of a packed cloud.
#[derive(Debug, Clone, PartialEq)]
pub enum Packed {
    /// As [`Packing::Exact`].
    Exact(Exact),
    /// As [`Packing::Quantised`].
    Quantised(Quantised),
}

/// A range of points as the device takes it. What a stream holds depends on the packing: `glsl/shared/packing.glsl`.
#[derive(Debug, Clone, Copy)]
pub struct Streams<'a> {
    /// Positions, in a full cloud with radii.
    pub geometry: &'a [u8],
    /// Normals; in a quantised cloud with normals and colours radii.
    pub normals: Option<&'a [u8]>,
    /// Colours; in a packed cloud what else a point has, so always there.
    pub colors: Option<&'a [u8]>,
    /// For quantised clouds: the frames of its runs.
    pub frames: Option<&'a [u8]>,
}

/// `each` for every variant.
macro_rules! either {
    ($packed:expr, $points:ident => $each:expr) => {
        match $packed {
            Packed::Exact($points) => $each,
            Packed::Quantised($points) => $each,
        }
    };
}

impl Packed {
    pub(super) fn packing(&self) -> Packing {
        match self {
            Packed::Exact(_) => Packing::Exact,
            Packed::Quantised(_) => Packing::Quantised,
        }
    }

    pub(super) fn len(&self) -> usize {
        either!(self, points => points.len())
    }

    pub(super) fn point(&self, i: usize) -> [f32; 4] {
        either!(self, points => points.point(i))
    }

    pub(super) fn normal(&self, i: usize) -> u32 {
        either!(self, points => points.normal(i))
    }

    pub(super) fn color(&self, i: usize) -> Option<[u8; 3]> {
        either!(self, points => points.color(i))
    }

    pub(super) fn has_normals(&self) -> bool {
        either!(self, points => points.has_normals())
    }

    pub(super) fn has_colors(&self) -> bool {
        either!(self, points => points.has_colors())
    }

    /// What the codes of the radii mean.
    pub fn radii(&self) -> Radii {
        either!(self, points => points.radii())
    }

    pub(super) fn streams(&self, range: Range<usize>) -> Streams<'_> {
        either!(self, points => points.streams(range))
    }
}

impl Flat {
    /// The same points in another packing; groups stay. Bounds are those of what is decoded. Packing what was packed otherwise
    /// adds the errors of both.
    pub fn packed(self, packing: Packing) -> Flat {
        if packing == self.packing() {
            return self;
        }
        let full = match self.unpacked() {
            Cow::Owned(full) => full,
            Cow::Borrowed(_) => self,
        };
        let packed = match packing {
            Packing::Full => return full,
            Packing::Exact => Packed::Exact(Exact::pack(&full)),
            Packing::Quantised => Packed::Quantised(Quantised::pack(&full)),
        };
        let radii = packed.radii();
        let finest = full.finest.map(|r| radii.decode(radii.encode(r)).max(r));
        let mut flat = Flat { geometry: Vec::new(), normals: None, colors: None, packed: Some(packed), finest, ..full };
        flat.blocks = super::flat::blocks(flat.len(), |i| flat.point(i as u32));
        flat
    }

    /// The points with all their bytes: for what makes other structures of them.
    pub fn unpacked(&self) -> Cow<'_, Flat> {
        let Some(packed) = &self.packed else { return Cow::Borrowed(self) };
        let all = 0..packed.len();
        let word = |[r, g, b]: [u8; 3]| u32::from_le_bytes([r, g, b, 255]);
        Cow::Owned(Flat {
            geometry: all.clone().map(|i| packed.point(i)).collect(),
            normals: self.has_normals().then(|| all.clone().map(|i| packed.normal(i)).collect()),
            colors: self.has_colors().then(|| all.filter_map(|i| packed.color(i).map(word)).collect()),
            packed: None,
            blocks: self.blocks.clone(),
            groups: self.groups.clone(),
            origin: self.origin,
            closed: self.closed,
            finest: self.finest,
        })
    }

    /// How many bytes a point has.
    pub fn packing(&self) -> Packing {
        self.packed.as_ref().map_or(Packing::Full, Packed::packing)
    }

    /// How far the position of a point may be from what it was before it was packed \[cloud units\]: half a diagonal of its run's
    /// steps, beside the rounding of single floats; 0 but for quantised clouds.
    pub fn position_error(&self, i: u32) -> f32 {
        match &self.packed {
            Some(Packed::Quantised(points)) => points.frames()[i as usize / RUN].half_diagonal(),
            Some(Packed::Exact(_)) | None => 0.0,
        }
    }

    /// What the device takes for a range of points, which begins at a multiple of [`RUN`].
    pub fn streams(&self, range: Range<usize>) -> Streams<'_> {
        match &self.packed {
            Some(packed) => packed.streams(range),
            None => Streams {
                geometry: bytemuck::cast_slice(&self.geometry[range.clone()]),
                normals: self.normals.as_ref().map(|n| bytemuck::cast_slice(&n[range.clone()])),
                colors: self.colors.as_ref().map(|c| bytemuck::cast_slice(&c[range])),
                frames: None,
            },
        }
    }
}

/// 16 bits of the normal of a point of a full cloud.
fn narrow_normal(full: &Flat, i: usize) -> u16 {
    octahedral::narrow(full.normal(i as u32))
}

/// The colour of a point of a full cloud, 0 without.
fn rgb(full: &Flat, i: usize) -> [u8; 3] {
    full.color(i as u32).unwrap_or_default()
}
