//! A splat at one pixel centre.

use glam::DVec2;

use super::bound::pixel_error;
use super::camera::Ray;
use super::splat::{Setup, Shape, Splat};

/// What a splat contributes to a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Fragment {
    /// Linear depth.
    pub z: f64,
    /// How far off rounding may be in it.
    pub dz: f64,
    /// Weight, 1 for the opaque blend.
    pub weight: f64,
    /// Covers the pixel; fragments that do not are there because rounding may say so.
    pub inside: bool,
    /// Rounding cannot decide otherwise.
    pub sure: bool,
    /// How fast the weight changes with the fragment's place \[1/px\].
    pub slope: f64,
}

/// Snapping of sprite positions \[px\]: Vulkan promises at least 4 bits below the pixel, all known devices have 8.
const SNAP: f64 = 1.0 / 256.0;

/// The splat's fragment at this pixel centre; `None` where it has none and rounding could not make one.
pub fn fragment(setup: &Setup, splat: &Splat, at: DVec2, ray: &Ray) -> Option<Fragment> {
    match setup.shape {
        Shape::Square { half } => square(setup, splat, at, half),
        Shape::Disk { hard } => disk(setup, splat, at, ray, hard),
    }
}

fn disk(setup: &Setup, splat: &Splat, at: DVec2, ray: &Ray, hard: bool) -> Option<Fragment> {
    let (margin, near) = (setup.margin, setup.camera.near);
    // Squared distance in the disk, depth, and the cosine between ray and normal; infinite and z_p without a hit.
    let (mut object, mut z, cosine) = match splat.affine {
        None => {
            let slope = splat.n.dot(ray.direction);
            let t = splat.n.dot(splat.p - ray.origin) / slope;
            let hit = t.is_finite() && (t > 0.0 || !setup.camera.perspective);
            let x = ray.origin + t * ray.direction - splat.p;
            (if hit { x.length_squared() } else { f64::INFINITY }, if hit { t } else { splat.z }, slope / ray.length)
        }
        // First order about the centre: the pixel's offset at the centre's depth, along the centre's ray onto the plane.
        Some(direction) => {
            let offset = ray.origin + splat.z * ray.direction - splat.p;
            let slope = splat.n.dot(direction);
            let t = splat.n.dot(offset) / slope;
            let x = (offset - t * direction).length_squared();
            let hit = x.is_finite();
            let cosine = slope / direction.length();
            (if hit { x } else { f64::INFINITY }, if hit { splat.z - t } else { splat.z }, cosine)
        }
    };
    object /= splat.r * splat.r;
    let screen = match splat.screen {
        Some(c) if setup.low_pass > 0.0 => c.distance_squared(at) / (setup.low_pass * setup.low_pass),
        _ => f64::INFINITY,
    };
    let u2 = object.min(screen);
    let hit_depth = z;
    z = z.clamp(splat.z - splat.r, splat.z + splat.r);
    let covered = u2 <= 1.0;
    let mut fragment = Fragment {
        z,
        dz: 0.0,
        weight: if hard || !covered { 1.0 } else { (-4.0 * u2).exp2() },
        inside: splat.drawn && covered && z >= near,
        sure: true,
        slope: 0.0,
    };
    if !hard && covered {
        // d w / d u = 8 ln 2 · u w; u changes by 1/ρ a pixel, or by a pixel's width on the plane over r.
        let per_pixel = if object < screen {
            setup.camera.pixel_width(hit_depth) / (splat.r * cosine.abs())
        } else {
            1.0 / setup.low_pass
        };
        fragment.slope = 8.0 * std::f64::consts::LN_2 * u2.sqrt() * fragment.weight * per_pixel;
    }
    if margin == 0.0 {
        return fragment.inside.then_some(fragment);
    }

    // Positions are off by margin · |p|, normals by margin, so that the hit moves within the plane by
    // (margin |p| + margin |x − p|) / cosine.
    let cosine = cosine.abs().max(f64::MIN_POSITIVE);
    let distance = splat.p.length();
    let moved = margin * (distance / splat.r + object.sqrt().min(f64::MAX)) / cosine;
    // 2 u δu + δu² about the rim, u = 1.
    let d_object = moved * (2.0 + moved);
    let d_screen = match splat.screen {
        Some(_) if screen.is_finite() => {
            let moved = pixel_error(setup, splat) / setup.low_pass;
            moved * (2.0 + moved)
        }
        _ => 0.0,
    };
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
    (inside || !sure).then_some(Fragment { z: splat.z, dz, weight: 1.0, inside, sure, slope: 0.0 })
}
