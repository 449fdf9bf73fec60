//! A CPU renderer in f64 that the GPU is judged by. It imports nothing of `gpu` or `draw`, and is written from the
//! definitions (`MODEL.md`: splat, low-pass, tolerance, blends), never from the shaders.
//!
//! # The picture, in pseudo-code
//! ```text
//! for every splat of the draw list, in order:
//!     to eye space (f64); invalid? facing away? outside?        → counted, dropped
//!     for every pixel centre that its screen bound holds:
//!         x = ray ∩ plane;  u² = min(|x − p|² / r², |fragment − projected p|² / ρ²)
//!         u ≤ 1 → a fragment: weight 2^(−4u²), z = depth of x, clamped to z_p ± r; none where z < near
//! opaque:    the nearest fragment that is no deeper than the host's depth; of equals the first
//! two-pass:  limit = min(host, min (z + ε));  sums of w, w·c, w·n over z ≤ limit;  c = Σwc / Σw, α = min(1, 2 Σw), or 1
//!            where any fragment lies behind the limit
//! triangles: a fragment of weight 1 at every pixel centre that they cover, exact in depth, where s > τ |x − eye|
//! fuzzy:     zd = ∞, limit = host;  for every fragment in order:
//!                z > limit → hidden;  z + ε < zd → the sums start anew with it, zd = z, limit = min(host, z + ε);
//!                else into the sums, and unless as published zd = min(zd, z), limit = min(limit, z + ε)
//! groups:    of each group's fragments the one of least key; over those as two-pass
//!            key = z, or where groups overlap themselves z + ε u, or as published the slab of z and u
//! light on the normalised Σwn; then eye-dome lighting on the finished depths
//! ```
//! # Where it departs, and why
//! 1. Splats are binned into tiles of 32 × 32 pixels: each tile is one task and walks its splats in draw order, so every
//!    pixel's sum has the same order whatever the number of threads, and the bytes are the same.
//! 2. Two-pass evaluates every fragment twice instead of keeping them: 10⁵ splats on one pixel take no more memory than
//!    one. Groups keep a fragment for each sample of a tile and each group, about 0.1 MiB a group and thread.
//! 3. Rays are parametrised by linear depth: the point of a pixel at depth z is o + z d, for any perspective or
//!    orthographic projection that [`View`] allows.
//! 4. Along with each pixel comes whether f32 arithmetic may decide differently there (see [`Picture::ties`]).
//!
//! 5. A splat is set up once for its bins and once for each of its tiles, never kept: memory is 24 B a splat and 4 B a
//!    tile that it may touch. Rays are computed where they are used.
//!
//! # Truth
//! What splats are measured by has its own ways: [`ray_cast`] where there are faces, [`supersampled`] where there are none.
//!
//! The low-pass follows Botsch, Hornung, Zwicker, Kobbelt: High-Quality Surface Splatting on Today's GPUs, 2005; the exact
//! bounds Sigg, Weyrich, Botsch, Gross: GPU-Based Ray-Casting of Quadratic Surfaces, 2006, in the form for flat disks.
#![forbid(unsafe_code)]

mod bins;
mod bound;
mod camera;
mod face;
mod fragment;
mod fuzzy;
mod groups;
mod mesh;
mod pixel;
mod shade;
mod splat;
mod ties;
mod tiles;
mod tiling;
mod truth;

use glam::DMat4;

pub use mesh::Surface;
pub use truth::{MeshInstance, MeshScene, SAMPLES, ray_cast};

use crate::select::{DrawList, View};
use crate::structure::hybrid::Triangles;
use crate::structure::{Cloud, Flat};
use crate::style::Style;
use crate::technique::Technique;

/// One cloud of the frame.
#[derive(Debug, Clone, Copy)]
pub struct Instance<'a> {
    /// Its points.
    pub flat: &'a Flat,
    /// Its faces, for a hybrid.
    pub triangles: Option<&'a Triangles>,
    /// World from the cloud's frame: a rotation, a uniform scale, a translation.
    pub transform: DMat4,
}

impl<'a> Instance<'a> {
    /// Points alone.
    pub fn points(flat: &'a Flat, transform: DMat4) -> Self {
        Instance { flat, triangles: None, transform }
    }

    /// All that may be drawn of a cloud.
    pub fn of(cloud: &'a Cloud, transform: DMat4) -> Self {
        Instance { flat: cloud.flat(), triangles: cloud.triangles(), transform }
    }
}

/// What a frame is made of.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The clouds that `list` refers to.
    pub instances: &'a [Instance<'a>],
    /// Which triangles and points, in which order: an instance's triangles come before its points. Every span must lie within
    /// its cloud; at most 2³² − 1 of both together.
    pub list: &'a DrawList,
    /// From where.
    pub view: &'a View,
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// How fragments are combined; structure, selection, primitive and order are settled by `list`.
    pub technique: Technique,
    /// How splats look.
    pub style: &'a Style,
    /// The host's depth buffer in the view's convention, row by row from the top, `width · height` values; the clear
    /// value hides nothing.
    pub host_depth: Option<&'a [f32]>,
}

/// The finished picture: rows from the top, `width · height` pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// Linear light, premultiplied by the coverage in the fourth component.
    pub rgba: Vec<[f64; 4]>,
    /// Linear view depth of the front \[world units\]; infinite where nothing is.
    pub depth: Vec<f64>,
    /// Whether the pixel lies within the rounding margin given to [`render`] of a decision (a rim, a depth or tolerance
    /// comparison, which splat a group shows, the near plane, a square's border, a splat seen edge-on, or a neighbour of such a pixel with eye-dome
    /// lighting), so that rounding may change it by more than rounding. All false for a margin of 0.
    pub ties: Vec<bool>,
    /// How fast a channel changes at most where all splats move against the pixel, each its own way \[1/px\], to first
    /// order and without light: what a displacement of the splats' images by rounding is multiplied by. 0 for `opaque`, and for a margin of 0.
    pub sensitivity: Vec<f64>,
    /// What became of the splats.
    pub counts: Counts,
}

/// Submitted = drawn + everything culled. A splat counts once: as invalid, else as facing away, else as outside.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Points in the draw list.
    pub submitted: u64,
    /// The bound of the footprint meets the picture, pixel centres or not.
    pub drawn: u64,
    /// Bound outside the picture or wholly before the near plane.
    pub culled_frustum: u64,
    /// Facing away, where the style drops those.
    pub culled_cone: u64,
    /// Non-finite centre or radius, or a radius that is not positive.
    pub culled_invalid: u64,
}

/// Renders the scene.
///
/// `margin` is the relative rounding error that [`Picture::ties`] allows for: an arithmetic that places eye-space
/// positions within `margin` · distance, unit vectors within `margin`, and pixel positions within `margin` · (picture size +
/// offset) decides as f64 does everywhere but at ties. A chain of k roundings in f32 has at most k · 2⁻²⁴; 16 of them
/// ([`MARGIN_F32`]) is what transforming and intersecting takes. The picture itself does not depend on it.
///
/// # Panics
/// If a span lies outside its cloud, or `host_depth` has a wrong length. For [`Blend::Groups`] if the cloud of any
/// instance, drawn or not, has no groups, or if those do not number all its points below their count.
///
/// [`Blend::Groups`]: crate::technique::Blend::Groups
pub fn render(scene: &Scene, margin: f64) -> Picture {
    finished(scene, 1, margin)
}

/// The same picture from `factor` × `factor` samples a pixel, box-filtered: truth where there is no surface (8 in
/// `docs/MEASURING.md`).
///
/// The mean of the samples' premultiplied linear light, coverage included, is the pixel. Its depth is the lower median
/// of the depths of those samples that are covered, infinite where none is. The picture of samples is never held: beside
/// the splats' numbers by tile (4 B for each tile of 32 × 32 samples that a splat may touch) a thread has one tile.
///
/// What the scene measures in pixels:
/// - `low_pass` (ρ) is in samples: it is there against aliasing, which more samples do not have. With it go the
///   widening of the tolerance on slopes and the bounds.
/// - The side of [`Footprint::Pixels`](crate::style::Footprint::Pixels) is in final pixels: squares keep their size.
/// - The eye-dome's radius is in final pixels: it is applied to the folded colours and depths.
/// - `host_depth` has a value a final pixel, which all samples of the pixel share.
///
/// [`Picture::counts`] are those of the picture of samples, [`Picture::ties`] all false.
///
/// # Panics
/// If `factor` is not 1, 2, 4, 8, 16 or 32, a side of the picture times `factor` exceeds 2³² − 1, or as [`render`].
pub fn supersampled(scene: &Scene, factor: u32) -> Picture {
    assert!(factor > 0 && bins::TILE.is_multiple_of(factor), "a factor that divides 32");
    assert!(scene.width.max(scene.height).checked_mul(factor).is_some(), "at most 2³² − 1 samples along a side");
    finished(scene, factor, 0.0)
}

fn finished(scene: &Scene, factor: u32, margin: f64) -> Picture {
    let setup = splat::Setup::new(scene, factor, margin);
    let mut picture = tiles::draw(scene, &setup, factor);
    if let Some(eye_dome) = scene.style.eye_dome {
        shade::eye_dome(&mut picture, eye_dome);
    }
    picture
}

/// Sixteen roundings of f32, for [`render`].
pub const MARGIN_F32: f64 = 16.0 / (1u32 << 24) as f64;
