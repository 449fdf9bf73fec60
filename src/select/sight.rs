//! A view as a structure sees it: from within its own coordinates.

use glam::{DMat4, DVec3, DVec4, Vec3, dvec4};

use super::View;
use crate::structure::nodes::Test;
use crate::style::Style;

/// A view of one instance, in the coordinates of its cloud, relative to the cloud's origin. Lengths are in cloud units.
#[derive(Debug, Clone, PartialEq)]
pub struct Sight {
    /// The eye and 1, or the unit direction towards the viewer and 0.
    pub eye: DVec4,
    /// An error e passes at distance r where e ≤ τ r; without perspective where e ≤ τ. τ = threshold / focal length.
    pub tau: f64,
    /// Planes with unit normals, n · p + d ≥ 0 within the picture and the low-pass round it, and beyond the near plane.
    pub planes: [DVec4; 5],
    /// Factor on all radii.
    pub radius_scale: f64,
}

impl Sight {
    /// Of a picture of `extent` pixels. The transform is a similarity, from the cloud's world to the scene's, and `origin`
    /// the cloud's.
    pub fn new(view: &View, extent: [u32; 2], transform: &DMat4, origin: DVec3, style: &Style) -> Sight {
        let (threshold, low_pass) = (style.threshold as f64, style.low_pass as f64);
        let view = view.right_handed();
        let eye_from_cloud = view.view * *transform * DMat4::from_translation(origin);
        let eye = eye_from_cloud.inverse() * view.centre_of_projection();
        let scale = transform.determinant().abs().cbrt();
        let (eye, per_unit) = if view.is_perspective() {
            ((eye.truncate() / eye.w).extend(1.0), 1.0)
        } else {
            (eye.truncate().normalize().extend(0.0), scale)
        };
        let clip = view.projection * eye_from_cloud;
        let (x, y, w) = (clip.row(0), clip.row(1), clip.row(3));
        let [wide, high] = extent.map(|n| 1.0 + 2.0 * low_pass / n as f64);
        let depth = -eye_from_cloud.row(2);
        let unit = |plane: DVec4| plane / plane.truncate().length();
        let planes =
            [wide * w + x, wide * w - x, high * w + y, high * w - y, depth - dvec4(0.0, 0.0, 0.0, view.near())]
                .map(unit);
        let tau = threshold / (view.focal(extent[1] as f64) * per_unit);
        Sight { eye, tau, planes, radius_scale: style.radius_scale as f64 }
    }

    /// As the point-by-point test takes it.
    pub fn test(&self) -> Test {
        Test { eye: self.eye.as_vec4().to_array(), tau: self.tau as f32 }
    }

    /// Least distance of the eye from a box, what τ is multiplied by; 1 without perspective. Never more than what the test
    /// in single floats finds for a point of the box.
    pub fn distance(&self, min: Vec3, max: Vec3) -> f64 {
        if self.eye.w == 0.0 {
            return 1.0 - 1e-6;
        }
        let eye = self.eye.truncate();
        let to = eye.clamp(min.as_dvec3(), max.as_dvec3()) - eye;
        // The test rounds the eye, a difference, and a sum of three squares.
        let rounding = (eye.abs().max_element() + 4.0 * to.length()) * f32::EPSILON as f64;
        (to.length() - 2.0 * rounding).max(0.0)
    }

    /// Whether no splat with its centre in the box and a radius of at most `reach` can be seen.
    pub fn misses(&self, min: Vec3, max: Vec3, reach: f32) -> bool {
        let (min, max) = (min.as_dvec3(), max.as_dvec3());
        self.planes.iter().any(|plane| {
            let n = plane.truncate();
            let most = DVec3::select(n.cmpge(DVec3::ZERO), max, min);
            // A plane through nothing (a picture that a transform flattens) hides nothing.
            n.dot(most) + plane.w < -(reach as f64 * self.radius_scale) - 1e-6 * most.length()
        })
    }
}
