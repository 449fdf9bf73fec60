//! Rays and projections of a view, in eye space and pixels.

use glam::{DMat3, DMat4, DVec2, DVec3, DVec4, dvec2, dvec3, dvec4};

use crate::select::View;

/// A view for pictures of one size. Eye space looks along −Z; linear depth is −z.
pub struct Camera {
    /// The view, with eye space turned round where the host's looks along +Z.
    view: View,
    /// World to eye without the translation.
    pub rotation: DMat3,
    /// Homogeneous pixel coordinates (x, y, w) of an eye-space point: rows to multiply with (x, y, z, 1).
    pub rows: [DVec4; 3],
    /// Inverse of the rows' 2 × 2 part, row by row.
    inverse: [DVec2; 2],
    /// Linear depth of the near plane.
    pub near: f64,
    pub perspective: bool,
    /// The eye, or for orthographic views the unit direction towards the viewer.
    centre: DVec3,
    pub width: u32,
    pub height: u32,
}

/// What a pixel sees: the point at linear depth z is `origin` + z · `direction`, so `direction.z` = −1.
#[derive(Clone, Copy)]
pub struct Ray {
    pub origin: DVec3,
    pub direction: DVec3,
    /// Length of `direction`.
    pub length: f64,
}

impl Camera {
    pub fn new(view: &View, width: u32, height: u32) -> Camera {
        let mut view = *view;
        if view.projection.row(3).z > 0.0 {
            // A left-handed host: w = +z. Mirroring eye space on both sides leaves their product alone.
            let mirror = DMat4::from_diagonal(dvec4(1.0, 1.0, -1.0, 1.0));
            view.view = mirror * view.view;
            view.projection *= mirror;
        }
        let (r0, r1, r3) = (view.projection.row(0), view.projection.row(1), view.projection.row(3));
        // ndc −1…1 → 0…size.
        let rows = [0.5 * width as f64 * (r0 + r3), 0.5 * height as f64 * (r1 + r3), r3];
        let [s0, s1, _] = rows;
        let det = s0.x * s1.y - s0.y * s1.x;
        let mut camera = Camera {
            near: view.near(),
            centre: DVec3::ZERO,
            perspective: view.is_perspective(),
            rotation: DMat3::from_mat4(view.view),
            rows,
            inverse: [dvec2(s1.y, -s0.y) / det, dvec2(-s1.x, s0.x) / det],
            view,
            width,
            height,
        };
        let ray = camera.ray(DVec2::ZERO);
        camera.centre = if camera.perspective { ray.origin } else { -ray.direction / ray.length };
        camera
    }

    /// Eye-space position of a world position.
    pub fn eye(&self, world: DVec3) -> DVec3 {
        self.view.view.transform_point3(world)
    }

    /// The ray through a place in the picture \[px\].
    ///
    /// With w = s3.w − s3.z z the two equations s·(x, y, −z, 1) = f w are linear in (x, y) and in z.
    #[inline(always)]
    pub fn ray(&self, fragment: DVec2) -> Ray {
        let [s0, s1, s3] = self.rows;
        let solve = |b: DVec2| dvec2(self.inverse[0].dot(b), self.inverse[1].dot(b));
        let origin = solve(fragment * s3.w - dvec2(s0.w, s1.w)).extend(0.0);
        let direction = solve(dvec2(s0.z, s1.z) - fragment * s3.z).extend(-1.0);
        Ray { origin, direction, length: direction.length() }
    }

    /// w of an eye-space point.
    pub fn w(&self, p: DVec3) -> f64 {
        self.rows[2].dot(p.extend(1.0))
    }

    /// Width of a pixel at a linear depth, across the picture's centre, the wider of its two sides \[world units\].
    pub fn width_at(&self, depth: f64) -> f64 {
        let [x, y] = [0, 1].map(|i| dvec2(self.rows[i].x, self.rows[i].y).length());
        let focal = x.min(y);
        self.w(DVec3::new(0.0, 0.0, -depth)).abs() / focal
    }

    /// Where an eye-space point appears \[px\]; only for w > 0.
    pub fn project(&self, p: DVec3) -> DVec2 {
        let h = p.extend(1.0);
        dvec2(self.rows[0].dot(h), self.rows[1].dot(h)) / self.w(p)
    }

    /// Side of the square across the ray at `p` whose image has the area of a pixel \[world units\]; `at` is where `p`
    /// appears \[px\] and `viewer` the unit vector from there towards the viewer.
    ///
    /// The image x_k = s_k·h / w has the derivative J_k = (s_k − x_k s_3) / w, and two unit vectors a, b across the ray
    /// span (J_0·a)(J_1·b) − (J_0·b)(J_1·a) = (J_0 × J_1)·(a × b), where a × b is the ray's own direction.
    pub fn pixel_width(&self, p: DVec3, at: DVec2, viewer: DVec3) -> f64 {
        let [s0, s1, s3] = self.rows.map(|row| row.truncate());
        let area = (s0 - at.x * s3).cross(s1 - at.y * s3).dot(viewer);
        self.w(p) / area.abs().sqrt()
    }

    /// From an eye-space point to the viewer, unit length; +Z from the eye itself.
    pub fn towards_viewer(&self, p: DVec3) -> DVec3 {
        if !self.perspective {
            return self.centre;
        }
        (self.centre - p).try_normalize().unwrap_or(dvec3(0.0, 0.0, 1.0))
    }

    /// Linear depth of a value in the host's depth buffer: infinite where it is clear.
    pub fn host_depth(&self, value: f32) -> f64 {
        let value = value as f64;
        if value == self.view.depth.far() { f64::INFINITY } else { self.view.linear_depth(value) }
    }
}
