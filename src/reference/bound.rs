//! The smallest box on the screen that holds a splat's footprint.

use glam::{DVec2, DVec3, dvec2};

use super::camera::Camera;
use super::splat::{Setup, Shape, Splat};

/// A box in pixels; `min` ≤ `max`, possibly infinite.
#[derive(Debug, Clone, Copy)]
pub struct Bound {
    pub min: DVec2,
    pub max: DVec2,
    /// How far off rounding may be in it \[px\].
    pub error: f64,
}

/// The box of the footprint; `None` if it misses the picture or lies wholly before the near plane.
pub fn footprint(setup: &Setup, splat: &Splat) -> Option<Bound> {
    let camera = &setup.camera;
    let around = |c: DVec2, half: f64| Bound { min: c - half, max: c + half, error: 0.0 };
    let mut bound = match setup.shape {
        Shape::Square { half } => around(splat.screen?, half),
        Shape::Disk { .. } => {
            let disk = disk(camera, splat)?;
            match splat.screen {
                Some(c) if setup.low_pass > 0.0 => disk.union(around(c, setup.low_pass)),
                _ => disk,
            }
        }
    };
    let meets = bound.max.x > 0.0
        && bound.max.y > 0.0
        && bound.min.x < camera.width as f64
        && bound.min.y < camera.height as f64;
    bound.error = pixel_error(setup, splat);
    meets.then_some(bound)
}

/// How far off rounding may be in the projected centre and in the outline about it \[px\]: pixel coordinates by a share of
/// where they are, eye space by a share of the distance.
pub fn pixel_error(setup: &Setup, splat: &Splat) -> f64 {
    if setup.margin == 0.0 {
        return 0.0;
    }
    let camera = &setup.camera;
    let size = (camera.width + camera.height) as f64;
    let (place, w) = match splat.screen {
        Some(c) => (c.x.abs() + c.y.abs(), camera.w(splat.p)),
        None => (0.0, camera.w(DVec3::new(0.0, 0.0, -camera.near))),
    };
    let focal = camera.rows[0].truncate().length().max(camera.rows[1].truncate().length()) / w;
    setup.margin * (size + place + focal * splat.p.length())
}

/// The box of the disk's image alone.
fn disk(camera: &Camera, splat: &Splat) -> Option<Bound> {
    let extent = splat.depth_extent();
    if splat.z + extent < camera.near {
        return None;
    }
    match splat.screen {
        Some(c) if splat.z - extent >= camera.near => Some(conic(camera, splat, c)),
        _ => Some(clipped(camera, splat, extent)),
    }
}

/// Wholly behind the near plane: from the dual conic D = S (r² (1 − n nᵀ) − p pᵀ) Sᵀ, whose lines lᵀ D l = 0 touch the
/// image. With the pixel origin moved to the projected centre c the centre's own part is (0, 0, w), and nothing cancels.
fn conic(camera: &Camera, splat: &Splat, c: DVec2) -> Bound {
    let w = camera.w(splat.p);
    // (1 − n nᵀ) between two vectors is the dot product of their cross products with n.
    let s3 = camera.rows[2].truncate().cross(splat.n) * splat.r;
    let half = |axis: usize| {
        let s = (camera.rows[axis].truncate() - c[axis] * camera.rows[2].truncate()).cross(splat.n) * splat.r;
        if splat.affine.is_some() {
            // The linear map's ellipse: the same without the foreshortening.
            return (-s.length() / w, s.length() / w);
        }
        // e k² − 2 b k + a = 0 with a ≥ 0 > e.
        let (a, b, e) = (s.length_squared(), s.dot(s3), s3.length_squared() - w * w);
        let root = (b * b - a * e).sqrt();
        ((b + root) / e, (b - root) / e)
    };
    let (x, y) = (half(0), half(1));
    Bound { min: c + dvec2(x.0, y.0), max: c + dvec2(x.1, y.1), error: 0.0 }
}

/// Across the near plane: the part behind it is an arc and a chord. Extremes are at the chord's ends or where the image
/// of the arc (A0 + A1 cos φ + A2 sin φ) / (W0 + W1 cos φ + W2 sin φ) has no slope:
/// (A2 W0 − A0 W2) cos φ + (A0 W1 − A1 W0) sin φ + (A2 W1 − A1 W2) = 0. φ = 0 is the deepest point.
fn clipped(camera: &Camera, splat: &Splat, extent: f64) -> Bound {
    let deeper = DVec3::new(0.0, 0.0, -1.0);
    let t1 = (deeper - splat.n * splat.n.dot(deeper)).normalize() * splat.r;
    let t2 = splat.n.cross(t1);
    let terms = |row: usize| {
        let s = camera.rows[row];
        [s.dot(splat.p.extend(1.0)), s.truncate().dot(t1), s.truncate().dot(t2)]
    };
    let w = terms(2);
    let cut = ((camera.near - splat.z) / extent).clamp(-1.0, 1.0);
    let mut bound = Bound { min: DVec2::INFINITY, max: DVec2::NEG_INFINITY, error: 0.0 };
    for axis in 0..2 {
        let a = terms(axis);
        let mut include = |phi: f64| {
            let (sin, cos) = phi.sin_cos();
            if cos >= cut - 1e-12 {
                let at = (a[0] + a[1] * cos + a[2] * sin) / (w[0] + w[1] * cos + w[2] * sin);
                bound.min[axis] = bound.min[axis].min(at);
                bound.max[axis] = bound.max[axis].max(at);
            }
        };
        include(cut.acos());
        include(-cut.acos());
        let (p, q, r) = (a[2] * w[0] - a[0] * w[2], a[0] * w[1] - a[1] * w[0], a[2] * w[1] - a[1] * w[2]);
        let length = p.hypot(q);
        if r.abs() <= length && length > 0.0 {
            let (middle, away) = (q.atan2(p), (-r / length).acos());
            include(middle + away);
            include(middle - away);
        }
    }
    bound
}

impl Bound {
    fn union(self, other: Bound) -> Bound {
        Bound { min: self.min.min(other.min), max: self.max.max(other.max), error: 0.0 }
    }

    /// The pixels whose centres lie in the box or within rounding of it: x0, y0, x1, y1, the last two exclusive.
    pub fn pixels(&self, camera: &Camera) -> [u32; 4] {
        let size = dvec2(camera.width as f64, camera.height as f64);
        // f64 rounds too, by 10⁻¹⁶ of the places inside the picture and of the few steps on the way there.
        let pad = 1e-12 * (size.x + size.y) + 1e-9 + 4.0 * self.error;
        let low = (self.min - 0.5 - pad).ceil().clamp(DVec2::ZERO, size);
        let high = ((self.max - 0.5 + pad).floor() + 1.0).clamp(DVec2::ZERO, size);
        [low.x as u32, low.y as u32, high.x as u32, high.y as u32]
    }
}
