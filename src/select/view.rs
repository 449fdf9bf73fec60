//! A view is two f64 matrices; everything else is derived from them.
//!
//! Eye space is right-handed with the viewer looking along −Z. Clip space is Vulkan's: x right, y down, depth 0 to 1.
//! The linear depth of a point is z = −z_eye \[world units\], for perspective and orthographic views alike.

use glam::{DMat3, DMat4, DVec3, DVec4, dvec3, dvec4};

/// Which end of the depth range is near.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum DepthConvention {
    /// 1 is near, 0 is far; compared with GREATER.
    #[default]
    Reversed,
    /// 0 is near, 1 is far; compared with LESS.
    Standard,
}

impl DepthConvention {
    /// The depth of the near plane.
    pub fn near(self) -> f64 {
        match self {
            DepthConvention::Reversed => 1.0,
            DepthConvention::Standard => 0.0,
        }
    }

    /// The depth of the far plane, and what a depth image is cleared to.
    pub fn far(self) -> f64 {
        1.0 - self.near()
    }
}

/// One viewpoint.
///
/// `projection` may be asymmetric, jittered, mirrored, infinite or orthographic. Its third row must depend on z and w
/// alone (no oblique near plane), its fourth must be (0, 0, −k, 0), k > 0, for perspective or (0, 0, 0, 1) for orthographic
/// views. Engines whose viewer looks along +Z, with (0, 0, k, 0), are drawn too; see [`View::right_handed`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// World to eye: a rotation and a translation.
    pub view: DMat4,
    /// Eye to clip.
    pub projection: DMat4,
    /// Which end of the depth range is near in `projection`.
    pub depth: DepthConvention,
}

impl View {
    /// A view of `target` from `eye`, `up` upwards.
    ///
    /// The three must not be collinear; `eye` ≠ `target`.
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3, projection: DMat4, depth: DepthConvention) -> View {
        View::facing(eye, (eye - target).normalize(), up, projection, depth)
    }

    /// A view from `eye` against the unit vector `back`, `up` upwards: exact wherever the eye is, while the difference of
    /// two far points is not.
    ///
    /// `back` and `up` must not be collinear.
    pub fn facing(eye: DVec3, back: DVec3, up: DVec3, projection: DMat4, depth: DepthConvention) -> View {
        let right = up.cross(back).normalize();
        let rotation = DMat3::from_cols(right, back.cross(right), back).transpose();
        View { view: DMat4::from_mat3(rotation) * DMat4::from_translation(-eye), projection, depth }
    }

    /// Perspective with reversed, infinite depth. `fov_y` \[rad\] is vertical, `aspect` is width / height, `near` \[world units\] > 0.
    pub fn perspective(fov_y: f64, aspect: f64, near: f64) -> DMat4 {
        let f = 1.0 / (0.5 * fov_y).tan();
        DMat4::from_cols(
            dvec4(f / aspect, 0.0, 0.0, 0.0),
            dvec4(0.0, -f, 0.0, 0.0),
            dvec4(0.0, 0.0, 0.0, -1.0),
            dvec4(0.0, 0.0, near, 0.0),
        )
    }

    /// Orthographic with reversed depth: `height` \[world units\] over the picture's height, depths from `near` to `far`.
    pub fn orthographic(height: f64, aspect: f64, near: f64, far: f64) -> DMat4 {
        let s = 2.0 / height;
        // z_clip = (far − z) / (far − near), z = −z_eye.
        let d = 1.0 / (far - near);
        DMat4::from_cols(
            dvec4(s / aspect, 0.0, 0.0, 0.0),
            dvec4(0.0, -s, 0.0, 0.0),
            dvec4(0.0, 0.0, d, 0.0),
            dvec4(0.0, 0.0, far * d, 1.0),
        )
    }

    /// The same picture with the viewer looking along −Z: mirrors the eye space of views that look along +Z. What follows
    /// from the matrices below (depths, planes, the centre of projection) is meant for that form.
    pub fn right_handed(&self) -> View {
        if self.projection.row(3).z <= 0.0 {
            return *self;
        }
        let mirror = DMat4::from_scale(dvec3(1.0, 1.0, -1.0));
        View { view: mirror * self.view, projection: self.projection * mirror, depth: self.depth }
    }

    /// Whether rays diverge from an eye point.
    pub fn is_perspective(&self) -> bool {
        self.projection.row(3).z != 0.0
    }

    /// The eye in world space; for orthographic views the direction towards the viewer with w = 0.
    pub fn eye(&self) -> DVec4 {
        self.view.inverse() * self.centre_of_projection()
    }

    /// The point of eye space through which all rays pass, homogeneous: (x, y, z, 1), or (x, y, z, 0) for a direction
    /// towards the viewer.
    pub fn centre_of_projection(&self) -> DVec4 {
        let (r0, r1, r3) = (self.projection.row(0), self.projection.row(1), self.projection.row(3));
        if r3.z != 0.0 {
            // w = 0 is the plane z_eye = 0; there x and y vanish where the rows' constants do.
            let det = r0.x * r1.y - r0.y * r1.x;
            let (b0, b1) = (-r0.w, -r1.w);
            dvec4((b0 * r1.y - r0.y * b1) / det, (r0.x * b1 - b0 * r1.x) / det, 0.0, 1.0)
        } else {
            let d = r0.truncate().cross(r1.truncate()).normalize();
            (if d.z < 0.0 { -d } else { d }).extend(0.0)
        }
    }

    /// Linear depth \[world units\] of a depth-buffer value.
    pub fn linear_depth(&self, depth: f64) -> f64 {
        let (r2, r3) = (self.projection.row(2), self.projection.row(3));
        // depth = (r2.z z_eye + r2.w) / (r3.z z_eye + r3.w)
        -((r2.w - depth * r3.w) / (depth * r3.z - r2.z))
    }

    /// Linear depth \[world units\] of the near plane: below it nothing is drawn.
    pub fn near(&self) -> f64 {
        self.linear_depth(self.depth.near())
    }

    /// Linear depth \[world units\] of the far plane; infinite where the projection is.
    pub fn far(&self) -> f64 {
        let z = self.linear_depth(self.depth.far());
        if z.is_finite() && z > self.near() { z } else { f64::INFINITY }
    }

    /// Pixels that a length of one world unit covers at linear depth 1 in the picture's centre, vertically, when the
    /// picture is `height` pixels high. Orthographic views have it at every depth.
    pub fn focal(&self, height: f64) -> f64 {
        let r1 = self.projection.row(1);
        let scale = if self.is_perspective() { self.projection.row(3).z.abs() } else { 1.0 };
        0.5 * height * dvec3(r1.x, r1.y, 0.0).length() / scale
    }

    /// How many times as long as in the picture's centre, at the same distance from the eye, a length appears at most: 1/cos²θ in
    /// the corner that lies farthest off the axis, since a ray's angle φ meets the picture at f tan φ. Thresholds hold in the
    /// centre; elsewhere errors are up to so many times as large. 1 without perspective.
    pub fn off_axis(&self) -> f64 {
        let view = self.right_handed();
        if !view.is_perspective() {
            return 1.0;
        }
        let [r0, r1, r3] = [0, 1, 3].map(|i| view.projection.row(i).truncate());
        let corner = |x: f64, y: f64| {
            let ray = (r0 - x * r3).cross(r1 - y * r3);
            ray.length_squared() / (ray.z * ray.z)
        };
        [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(x, y)| corner(x, y)).into_iter().fold(1.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_stretch_lengths() {
        let view = |projection| View { view: DMat4::IDENTITY, projection, depth: DepthConvention::Reversed };
        // tan θ = √2 tan 30°, so cos² θ = 3/5; twice as wide, tan² θ = 5/3.
        let lens = |aspect| View::perspective(60f64.to_radians(), aspect, 0.1);
        assert!((view(lens(1.0)).off_axis() - 5.0 / 3.0).abs() < 1e-12);
        assert!((view(lens(2.0)).off_axis() - 8.0 / 3.0).abs() < 1e-12);
        let mut shifted = lens(1.0);
        // A picture whose left side is the axis: twice as far off it as the right.
        shifted.z_axis.x += shifted.z_axis.w;
        assert!((view(shifted).off_axis() - (1.0 + 5.0 / 3.0)).abs() < 1e-12);
        assert_eq!(view(View::orthographic(2.0, 1.0, 0.1, 9.0)).off_axis(), 1.0);
    }

    #[test]
    fn depths_and_focal_lengths_come_back_out_of_the_matrices() {
        let p = View {
            view: DMat4::IDENTITY,
            projection: View::perspective(60f64.to_radians(), 1.5, 0.25),
            depth: DepthConvention::Reversed,
        };
        assert!((p.near() - 0.25).abs() < 1e-12);
        assert_eq!(p.far(), f64::INFINITY);
        assert!((p.focal(100.0) - 50.0 / 30f64.to_radians().tan()).abs() < 1e-9);
        let o = View { projection: View::orthographic(4.0, 1.0, 1.0, 9.0), ..p };
        assert!((o.near() - 1.0).abs() < 1e-12 && (o.far() - 9.0).abs() < 1e-12);
        assert!((o.focal(100.0) - 25.0).abs() < 1e-12);
        assert_eq!(o.centre_of_projection(), dvec4(0.0, 0.0, 1.0, 0.0));
        // The textbook's standard depth: z_clip = far/(far − near)·(z − near).
        let (near, far) = (0.5, 50.0);
        let mut standard = p.projection;
        standard.z_axis.z = -far / (far - near);
        standard.w_axis.z = -far * near / (far - near);
        let s = View { projection: standard, depth: DepthConvention::Standard, ..p };
        assert!((s.near() - 0.5).abs() < 1e-9 && (s.far() - 50.0).abs() < 1e-6);
    }

    #[test]
    fn the_eye_is_where_it_was_put() {
        let eye = dvec3(6e6, -3.0, 2.0);
        let v = View::look_at(
            eye,
            eye + dvec3(1.0, 2.0, 0.5),
            DVec3::Z,
            View::perspective(1.0, 1.0, 0.1),
            Default::default(),
        );
        assert!((v.eye().truncate() - eye).length() < 1e-8);
    }
}
