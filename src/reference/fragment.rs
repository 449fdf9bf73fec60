//! A splat at one pixel centre.

use glam::DVec2;

use super::bound::pixel_error;
use super::camera::Ray;
use super::splat::{Setup, Shape, Splat};
use super::ties::Ties;

/// What a splat contributes to a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Fragment {
    /// Linear depth.
    pub z: f64,
    /// How far off rounding may be in it.
    pub dz: f64,
    /// u²: squared distance from the centre in units of the radius, or of ρ where that is less; 0 in squares.
    pub u2: f64,
    /// How far off rounding may be in u; 0 where ties are not kept.
    pub du: f64,
    /// Covers the pixel; fragments that do not are there because rounding may say so.
    pub inside: bool,
    /// Rounding cannot decide otherwise.
    pub sure: bool,
    /// How fast the weight changes with the fragment's place \[1/px\]; 0 where ties are not kept.
    pub slope: f64,
}

impl Fragment {
    /// The Gaussian weight 2^(−4u²).
    pub fn weight(&self) -> f64 {
        (-4.0 * self.u2).exp2()
    }
}

/// Snapping of sprite positions \[px\]: Vulkan promises at least 4 bits below the pixel, all known devices have 8.
pub const SNAP: f64 = 1.0 / 256.0;

/// The splat's fragment at this pixel centre; `None` where it has none and rounding, where ties are kept, could
/// not make one.
#[inline(always)]
pub fn fragment<T: Ties>(setup: &Setup, splat: &Splat, at: DVec2, ray: &Ray) -> Option<Fragment> {
    match setup.shape {
        Shape::Square { half } => square(setup, splat, at, half),
        Shape::Disk { .. } => disk::<T>(setup, splat, at, ray),
    }
}

#[inline(always)]
fn disk<T: Ties>(setup: &Setup, splat: &Splat, at: DVec2, ray: &Ray) -> Option<Fragment> {
    let (margin, near) = (setup.margin, setup.camera.near);
    // Squared distance in the disk [world units²], depth, and slope and length of the ray for its cosine with the
    // normal; infinite and z_p without a hit.
    let (object, z, [slope, length]) = match splat.affine {
        None => {
            let slope = splat.n.dot(ray.direction);
            let t = splat.n.dot(splat.p - ray.origin) / slope;
            let hit = t.is_finite() && (t > 0.0 || !setup.camera.perspective);
            let x = ray.origin + t * ray.direction - splat.p;
            (if hit { x.length_squared() } else { f64::INFINITY }, if hit { t } else { splat.z }, [slope, ray.length])
        }
        // First order about the centre: the pixel's offset at the centre's depth, along the centre's ray onto the plane.
        Some(direction) => {
            let offset = ray.origin + splat.z * ray.direction - splat.p;
            let slope = splat.n.dot(direction);
            let t = splat.n.dot(offset) / slope;
            let x = (offset - t * direction).length_squared();
            let hit = x.is_finite();
            let length = if T::KEPT { direction.length() } else { 1.0 };
            (if hit { x } else { f64::INFINITY }, if hit { splat.z - t } else { splat.z }, [slope, length])
        }
    };
    // Squared distance on the screen [px²].
    let screen = match splat.screen {
        Some(c) if setup.low_pass > 0.0 => c.distance_squared(at),
        _ => f64::INFINITY,
    };
    let (r2, low_pass2) = (splat.r * splat.r, setup.low_pass * setup.low_pass);
    // u ≤ 1 without a division: two of three places in a bound are outside.
    let covered = object <= r2 || screen <= low_pass2;
    if !T::KEPT && !covered {
        return None;
    }
    let (object, screen) = (object / r2, screen / low_pass2);
    let hit_depth = z;
    let z = z.clamp(splat.z - splat.r, splat.z + splat.r);
    let inside = splat.drawn && covered && z >= near;
    let mut fragment = Fragment { z, dz: 0.0, u2: object.min(screen), du: 0.0, inside, sure: true, slope: 0.0 };
    if !T::KEPT {
        return fragment.inside.then_some(fragment);
    }

    let cosine = (slope / length).abs().max(f64::MIN_POSITIVE);
    if covered {
        // d w / d u = 8 ln 2 · u w; u changes by 1/ρ a pixel, or by a pixel's width on the plane over r.
        let per_pixel =
            if object < screen { setup.camera.width_at(hit_depth) / (splat.r * cosine) } else { 1.0 / setup.low_pass };
        fragment.slope = 8.0 * std::f64::consts::LN_2 * fragment.u2.sqrt() * fragment.weight() * per_pixel;
    }
    // Positions are off by margin · |p|, normals by margin, so that the hit moves within the plane by
    // (margin |p| + margin |x − p|) / cosine.
    let distance = splat.p.length();
    let u = object.sqrt();
    let moved = margin * (distance / splat.r + u.min(f64::MAX)) / cosine;
    let moved_screen = if screen.is_finite() { pixel_error(setup, splat) / setup.low_pass } else { 0.0 };
    // 2 u δu + δu² about the rim, u = 1.
    let (d_object, d_screen) = (moved * (2.0 + moved), moved_screen * (2.0 + moved_screen));
    // The lesser of two that both move; a ray along the disk has no u on it, and no difference of infinities counts.
    let (u_screen, least) = (screen.sqrt(), fragment.u2.sqrt());
    let (low, high) = ((u - moved).min(u_screen - moved_screen), (u + moved).min(u_screen + moved_screen));
    fragment.du = (least - low.max(0.0)).max(high - least);
    let surely_covered = object + d_object <= 1.0 || screen + d_screen <= 1.0;
    let perhaps_covered = object - d_object <= 1.0 || screen - d_screen <= 1.0;
    fragment.dz = margin * distance + (moved * splat.r).min(2.0 * splat.r);
    if !perhaps_covered || z + fragment.dz < near {
        return fragment.inside.then_some(fragment);
    }
    fragment.sure = splat.sure && surely_covered && z - fragment.dz >= near;
    Some(fragment)
}

fn square(setup: &Setup, splat: &Splat, at: DVec2, half: f64) -> Option<Fragment> {
    let (c, margin) = (splat.screen?, setup.margin);
    let d = at - c;
    // Half-open, so that a side of one pixel covers exactly one centre.
    let inside = d.x >= -half && d.x < half && d.y >= -half && d.y < half;
    let dz = margin * splat.p.length();
    let border = if margin == 0.0 { 0.0 } else { SNAP + pixel_error(setup, splat) };
    let reach = d.abs().max_element();
    if !inside && reach >= half + border {
        return None;
    }
    let sure = margin == 0.0 || (splat.sure && reach < half - border && splat.z - dz >= setup.camera.near);
    let inside = inside && splat.drawn;
    (inside || !sure).then_some(Fragment { z: splat.z, dz, u2: 0.0, du: 0.0, inside, sure, slope: 0.0 })
}
