//! Depth in slabs, for the published Voronoi depth of `groups`.

use glam::{DMat4, DVec3};

use super::View;
use crate::structure::Flat;
use crate::style::Style;

/// Most slabs: with 2¹⁶, eight bits of a float's 24 are left for what lies within a slab.
pub const MOST: u32 = 1 << 16;

/// The frame's range of linear depth, cut into equal slabs (Zhang and Pajarola 2006, eq. 6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slabs {
    /// Linear depth where the first one begins \[world units\].
    pub near: f64,
    /// Of one slab \[world units\].
    pub thickness: f64,
    /// n, at least 1 and at most [`MOST`].
    pub count: u32,
}

impl Slabs {
    /// Slabs as thick as the typical tolerance of what is drawn, the median over blocks of 16,384 points of their largest
    /// radius: thicker where that would be more than [`MOST`].
    pub fn new<'a>(view: &View, style: &Style, drawn: impl IntoIterator<Item = (&'a Flat, DMat4)>) -> Slabs {
        let (view, near_plane) = (view.right_handed(), view.right_handed().near());
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut radii = Vec::new();
        for (flat, transform) in drawn {
            let eye = view.view * transform * DMat4::from_translation(flat.origin);
            let scale = transform.determinant().abs().cbrt() * style.radius_scale as f64;
            for block in flat.blocks.iter().filter(|b| b.radius > 0.0) {
                let r = block.radius as f64 * scale;
                radii.push(r);
                for corner in 0..8 {
                    let pick = |axis: usize| [block.min, block.max][corner >> axis & 1][axis] as f64;
                    let z = -eye.transform_point3(DVec3::new(pick(0), pick(1), pick(2))).z;
                    (low, high) = (low.min(z - r), high.max(z + r));
                }
            }
        }
        let low = low.max(near_plane);
        if radii.is_empty() || high.partial_cmp(&low) != Some(std::cmp::Ordering::Greater) {
            return Slabs { near: near_plane, thickness: 1.0, count: 1 };
        }
        let middle = radii.len() / 2;
        let median = *radii.select_nth_unstable_by(middle, f64::total_cmp).1;
        let tolerance = (style.tolerance.absolute as f64).max(style.tolerance.relative as f64 * median);
        let count = ((high - low) / tolerance).ceil().clamp(1.0, MOST as f64) as u32;
        Slabs { near: low, thickness: (high - low) / count as f64, count }
    }

    /// What is compared instead of depth, from 1 (near) to 0: 1 − (floor(t n) + u) / n (eq. 10, reversed), t the linear
    /// depth's place in the range and u the distance from the splat's centre in radii.
    pub fn key(&self, z: f64, u: f64) -> f64 {
        let slab = ((z - self.near) / self.thickness).floor().clamp(0.0, (self.count - 1) as f64);
        1.0 - (slab + u.clamp(0.0, 1.0)) / self.count as f64
    }
}
