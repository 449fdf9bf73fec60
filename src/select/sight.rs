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
    /// Planes with unit normals, n · p + d ≥ 0 within the picture and what a point covers of pixels round it (low-pass, or
    /// half a square), and beyond the near plane.
    pub planes: [DVec4; 5],
    /// Factor on all radii.
    pub radius_scale: f64,
}

impl Sight {
    /// Of a picture of `extent` pixels. The transform is a similarity, from the cloud's world to the scene's, and `origin`
    /// the cloud's.
    pub fn new(view: &View, extent: [u32; 2], transform: &DMat4, origin: DVec3, style: &Style) -> Sight {
        let margin = style.footprint_margin();
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
        let [wide, high] = extent.map(|n| 1.0 + 2.0 * margin / n as f64);
        let depth = -eye_from_cloud.row(2);
        let unit = |plane: DVec4| plane / plane.truncate().length();
        let planes =
            [wide * w + x, wide * w - x, high * w + y, high * w - y, depth - dvec4(0.0, 0.0, 0.0, view.near())]
                .map(unit);
        let tau = style.threshold as f64 / (view.focal(extent[1] as f64) * per_unit);
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

    /// Greatest distance of the eye from a box; 1 without perspective. Never less than what the test in single floats finds for a
    /// point of the box.
    pub fn farthest(&self, min: Vec3, max: Vec3) -> f64 {
        if self.eye.w == 0.0 {
            return 1.0 + 1e-6;
        }
        let eye = self.eye.truncate();
        let to = (eye - min.as_dvec3()).abs().max((eye - max.as_dvec3()).abs());
        let rounding = (eye.abs().max_element() + 4.0 * to.length()) * f32::EPSILON as f64;
        to.length() + 2.0 * rounding
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::DepthConvention;
    use crate::style::Footprint;

    /// Of 100 × 100 px, 1 px wide at distance 1, from a cloud's origin along −Z.
    fn sight(projection: DMat4, style: &Style, scale: f64) -> Sight {
        let view = View { view: DMat4::IDENTITY, projection, depth: DepthConvention::Reversed };
        Sight::new(&view, [100, 100], &DMat4::from_scale(DVec3::splat(scale)), DVec3::ZERO, style)
    }

    #[test]
    fn errors_are_measured_in_the_cloud_s_units() {
        let style = Style { threshold: 2.0, ..Style::default() };
        // 100 px are 2 units high at distance 1: a focal length of 50 px.
        let lens = View::perspective(std::f64::consts::FRAC_PI_2, 1.0, 0.1);
        for scale in [1.0, 10.0] {
            assert!((sight(lens, &style, scale).tau - 2.0 / 50.0).abs() < 1e-12, "distances scale as well");
            let flat = sight(View::orthographic(2.0, 1.0, 0.1, 9.0), &style, scale);
            assert!((flat.tau - 2.0 / 50.0 / scale).abs() < 1e-12 && flat.eye == dvec4(0.0, 0.0, 1.0, 0.0));
        }
    }

    #[test]
    fn what_reaches_into_the_picture_is_not_missed() {
        let lens = View::perspective(std::f64::consts::FRAC_PI_2, 1.0, 0.1);
        // At distance 10 a pixel is 0.2 wide, the border at 10.
        let at = |x: f32| Vec3::new(x, 0.0, -10.0);
        let misses = |style: &Style, x: f32, reach: f32| sight(lens, style, 1.0).misses(at(x), at(x), reach);
        let splats = Style::default();
        assert!(!misses(&splats, 10.1, 0.0) && misses(&splats, 10.3, 0.0), "a pixel of low-pass");
        assert!(!misses(&splats, 11.0, 1.0) && misses(&splats, 12.0, 1.0), "a radius, at 45 degrees to the plane");
        assert!(!misses(&Style { radius_scale: 3.0, ..splats }, 12.0, 1.0));
        let squares = Style { footprint: Footprint::Pixels(40.0), ..splats };
        assert!(!misses(&squares, 13.9, 0.0) && misses(&squares, 14.1, 0.0), "half a square");
        assert!(sight(lens, &splats, 1.0).misses(-at(0.0), -at(0.0), 1.0), "behind the eye");
    }
}
