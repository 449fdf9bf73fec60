//! Which blocks may hold splats that a sprite cannot: those near the eye, or wider than the device's point size limit.
//!
//! The vertex stage decides for every splat; this only proves for most blocks that it finds none, so that they are not
//! processed a second time. The bound is conservative: a splat of radius r whose box, grown by r, lies at linear depths of
//! at least z > 0 covers at most 2 r g / z pixels along x, g the greatest |pixel_x − x pixel_w| over the pixels x that
//! the grown box reaches.

use ash::vk;
use glam::{DMat4, DVec3, DVec4, dvec3};

use super::params::Camera;
use crate::structure::flat::Block;

/// A picture smaller than this on both sides has no footprint beyond the limit: boxes are clipped to the picture. The
/// quarter is the sprite's margin in `glsl/shared/splat.glsl`.
fn fits_any(extent: vk::Extent2D, sprite_limit: f64) -> bool {
    extent.width.max(extent.height) as f64 + 0.25 <= sprite_limit
}

/// Eye-space box of a block's splats: its centres' box, grown by `r`.
fn eye_box(block: &Block, eye_from_cloud: &DMat4, r: f64) -> (DVec3, DVec3) {
    let (min, max) = (block.min.as_dvec3(), block.max.as_dvec3());
    let corners = (0..8).map(|i| {
        let pick = |bit: usize, a: f64, b: f64| if i >> bit & 1 == 0 { a } else { b };
        eye_from_cloud.transform_point3(dvec3(pick(0, min.x, max.x), pick(1, min.y, max.y), pick(2, min.z, max.z)))
    });
    let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), c| (l.min(c), h.max(c)));
    (low - r, high + r)
}

/// Whether all of a cloud lies beyond the near plane: only then is what faces away from the eye hidden by a closed
/// surface, since the eye is outside it and the near plane opens it nowhere.
pub fn whole_in_front(
    blocks: impl IntoIterator<Item = Block>,
    camera: &Camera,
    eye_from_cloud: &DMat4,
    radius_scale: f64,
) -> bool {
    blocks.into_iter().all(|b| -eye_box(&b, eye_from_cloud, b.radius as f64 * radius_scale).1.z >= camera.near)
}

/// Whether a block may hold such a splat. `radius_scale` takes stored to drawn radii.
pub fn may_hold_large(
    block: &Block,
    camera: &Camera,
    eye_from_cloud: &DMat4,
    radius_scale: f64,
    low_pass: f64,
    extent: vk::Extent2D,
    sprite_limit: f64,
) -> bool {
    let r = block.radius as f64 * radius_scale;
    let (low, high) = eye_box(block, eye_from_cloud, r);
    let (nearest, farthest) = (-high.z, -low.z);
    if farthest < camera.near {
        return false;
    }
    let perspective = camera.eye.w != 0.0;
    // `near_eye` of the shader, for the nearest centre (at depth nearest + r) with the largest radius.
    let limit = if perspective { camera.near.max(0.1 * (nearest + r)) } else { camera.near };
    // A millionth more for the shader's rounding.
    if nearest < limit + 1e-6 * (nearest.abs() + r) {
        return true;
    }
    if fits_any(extent, sprite_limit) {
        return false;
    }
    // Pixels that the grown box reaches, along one axis.
    let reach = |axis: DVec4| {
        let mut range = (f64::INFINITY, f64::NEG_INFINITY);
        for i in 0..8 {
            let pick = |bit: usize, a: f64, b: f64| if i >> bit & 1 == 0 { a } else { b };
            let p = dvec3(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z)).extend(1.0);
            let x = axis.dot(p) / camera.pixel_w.dot(p);
            range = (range.0.min(x), range.1.max(x));
        }
        range
    };
    let (x, y) = (reach(camera.pixel_x), reach(camera.pixel_y));
    if x.1 < -low_pass
        || y.1 < -low_pass
        || x.0 > extent.width as f64 + low_pass
        || y.0 > extent.height as f64 + low_pass
    {
        return false;
    }
    let stretch = |axis: DVec4, at: f64| (axis - at * camera.pixel_w).truncate().length();
    let g = [
        stretch(camera.pixel_x, x.0),
        stretch(camera.pixel_x, x.1),
        stretch(camera.pixel_y, y.0),
        stretch(camera.pixel_y, y.1),
    ]
    .into_iter()
    .fold(0.0, f64::max);
    let depth = if perspective { nearest } else { 1.0 };
    (2.0 * r * g / depth).max(2.0 * low_pass) * 1.001 + 0.25 > sprite_limit
}
