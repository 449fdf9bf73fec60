//! A view and an instance as the shaders take them. All differences of large numbers are taken here, in f64.

use ash::vk;
use glam::{DMat4, DVec3, DVec4, dvec2, dvec3, dvec4};

use super::split::split;
use crate::gpu::layout::{DrawParams, FrameParams, MAX_VIEWS, ViewParams};
use crate::select::View;
use crate::structure::flat::Block;
use crate::style::{EyeDome, Footprint, Shading, Style};

/// What of a view its shaders are specialised to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Lens {
    /// Orthographic otherwise.
    pub perspective: bool,
    /// Projected centres are computed in pairs of floats.
    pub pairs: bool,
}

impl Lens {
    /// The same for what has no centres.
    pub fn single(self) -> Lens {
        Lens { pairs: false, ..self }
    }
}

/// What every cloud in a view shares.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    /// (pixel_x · P) / (pixel_w · P) is the pixel's x of the eye-space point P.
    pub pixel_x: DVec4,
    /// The same for y.
    pub pixel_y: DVec4,
    /// w, scaled so that it is the linear depth (perspective) or 1 (orthographic).
    pub pixel_w: DVec4,
    /// Centre of projection in eye space, see [`View::centre_of_projection`].
    pub eye: DVec4,
    /// Ray of pixel (0, 0) and its change with x and y. Perspective: directions at linear depth 1; orthographic: points
    /// at linear depth 0.
    pub ray: [DVec3; 3],
    /// Internal depth (reversed, 1 at the near plane) from linear depth: (x z + y) / (z z + w).
    pub depth_map: DVec4,
    /// The host's depth from linear depth z: a + b / z (perspective) or a + b z. A quotient of two sums would lose the last
    /// bits of standard depth, of which there are few far away.
    pub host_depth: [f64; 2],
    /// Linear depth of the near plane.
    pub near: f64,
    view: DMat4,
}

impl Camera {
    /// A view of `extent` pixels.
    pub fn new(view: &View, extent: vk::Extent2D) -> Camera {
        let view = &view.right_handed();
        let p = &view.projection;
        let (r0, r1, r2, r3) = (p.row(0), p.row(1), p.row(2), p.row(3));
        let perspective = view.is_perspective();
        // w becomes the linear depth: rows 0, 1 and 3 only count up to a common factor.
        let k = if perspective { -r3.z } else { 1.0 };
        let (w, h) = (extent.width as f64, extent.height as f64);
        let pixel_x = 0.5 * w * (r0 + r3) / k;
        let pixel_y = 0.5 * h * (r1 + r3) / k;
        let eye = view.centre_of_projection();

        // The point with z_eye = −1 (perspective) or 0 (orthographic) that the pixel with clip coordinates (x, y) sees:
        // r0 · P = x w, r1 · P = y w.
        let (z, clip_w) = if perspective { (-1.0, k) } else { (0.0, 1.0) };
        let det = r0.x * r1.y - r0.y * r1.x;
        let at = |x: f64, y: f64| {
            let (b0, b1) = (x * clip_w - r0.z * z - r0.w, y * clip_w - r1.z * z - r1.w);
            let point = dvec3((b0 * r1.y - r0.y * b1) / det, (r0.x * b1 - b0 * r1.x) / det, z);
            if perspective { point - eye.truncate() } else { point }
        };
        let ray_0 = at(-1.0, -1.0);
        let ray = [ray_0, (at(1.0, -1.0) - ray_0) / w, (at(-1.0, 1.0) - ray_0) / h];

        let near = view.near();
        let depth_map = if perspective {
            dvec4(0.0, near, 1.0, 0.0)
        } else {
            let range = view.far() - near;
            dvec4(-1.0 / range, view.far() / range, 0.0, 1.0)
        };
        Camera {
            pixel_x,
            pixel_y,
            pixel_w: r3 / k,
            eye,
            ray,
            depth_map,
            host_depth: if perspective { [-r2.z / -r3.z, r2.w / -r3.z] } else { [r2.w / r3.w, -r2.z / r3.w] },
            near,
            view: view.view,
        }
    }

    /// Cloud coordinates to eye space, and the scale of lengths. `origin` is the cloud's.
    pub fn eye_from_cloud(&self, transform: &DMat4, origin: DVec3) -> (DMat4, f64) {
        let m = self.view * *transform * DMat4::from_translation(origin);
        (m, scale(transform))
    }

    /// The point of cloud coordinates that the shaders take positions from.
    ///
    /// It lies on the ray through the picture's middle, as far away as the nearest corner of `bounds` (centres, cloud
    /// coordinates), so within clouds at the eye. Differences from it are rounded by a share of themselves: what is near the
    /// eye or the middle is placed well however far the cloud's own origin is, and under a long lens what is far away
    /// moves along its ray, not across it.
    fn about(&self, middle: DVec3, eye_from_cloud: &DMat4, bounds: [DVec3; 2]) -> DVec3 {
        let corners = (0..8).map(|i| {
            let pick = |axis: usize| bounds[i >> axis & 1][axis];
            -eye_from_cloud.transform_point3(dvec3(pick(0), pick(1), pick(2))).z
        });
        let nearest = corners.fold(f64::INFINITY, f64::min).max(0.0);
        let at = match self.eye.w != 0.0 {
            true => self.eye.truncate() + nearest * middle,
            false => middle - nearest / self.eye.z * self.eye.truncate(),
        };
        let about = eye_from_cloud.inverse().transform_point3(at);
        // A transform may flatten a cloud.
        if about.is_finite() { about } else { DVec3::ZERO }
    }

    /// The image's rows, pixels counted from the middle of a picture of this size.
    fn middle_rows(&self, extent: vk::Extent2D) -> [DVec4; 3] {
        let middle = 0.5 * dvec2(extent.width as f64, extent.height as f64);
        [self.pixel_x - middle.x * self.pixel_w, self.pixel_y - middle.y * self.pixel_w, self.pixel_w]
    }

    /// What this takes for pictures of `extent` pixels.
    ///
    /// Projected centres must be computed in pairs of floats where weights would not be good within 10⁻⁴ otherwise. In single
    /// floats they are off by up to 3.1·10⁻⁵ px at 960 px from the middle (measured over the stress suite, half a rounding of
    /// that distance), in proportion to that distance and to how far the picture lies off the view's axis; everything else
    /// displaces a footprint by 3.4·10⁻⁶ px. 10⁻⁴ is 5.55 times 1.8·10⁻⁵ px, which leaves 450 px.
    pub fn lens(&self, extent: vk::Extent2D) -> Lens {
        let half = 0.5 * extent.width.max(extent.height) as f64;
        let [x, y, _] = self.middle_rows(extent);
        let reach = half + x.z.abs().max(y.z.abs()).max(x.w.abs()).max(y.w.abs());
        Lens { perspective: self.eye.w != 0.0, pairs: reach > SINGLE_REACH }
    }

    /// The shaders' block of one cloud with this origin and these bounds.
    pub fn draw_params(
        &self,
        extent: vk::Extent2D,
        transform: &DMat4,
        (origin, bounds): (DVec3, &Block),
        style: &Style,
        disc: bool,
        sprite_limit: f32,
    ) -> DrawParams {
        let (mut eye_from_cloud, scale) = self.eye_from_cloud(transform, origin);
        let bounds = [bounds.min, bounds.max].map(|p| p.as_dvec3());
        // Pixels count from the middle.
        let middle = 0.5 * dvec2(extent.width as f64, extent.height as f64);
        let ray_middle = self.ray[0] + middle.x * self.ray[1] + middle.y * self.ray[2];
        let pixel = self.middle_rows(extent);
        let about = self.about(ray_middle, &eye_from_cloud, bounds);
        let from_cloud = eye_from_cloud.transpose();
        let split = split(pixel.map(|row| from_cloud * row), about, bounds);
        eye_from_cloud.w_axis = eye_from_cloud.transform_point3(split.about.as_dvec3()).extend(1.0);
        let row = |v: DVec4| v.as_vec4().to_array();
        let base = style.base_color.map(|c| crate::color::srgb_to_linear(c as f64 / 255.0) as f32);
        DrawParams {
            eye_from_cloud: [0, 1, 2].map(|i| row(eye_from_cloud.row(i))),
            about: split.about.extend(split.rounder).to_array(),
            pixel_hi: split.hi,
            pixel_lo: split.lo,
            pixel_x: row(pixel[0]),
            pixel_y: row(pixel[1]),
            pixel_w: row(self.pixel_w),
            eye: row(self.eye),
            ray_0: row(ray_middle.extend(0.0)),
            ray_x: row(self.ray[1].extend(0.0)),
            ray_y: row(self.ray[2].extend(0.0)),
            depth_map: row(self.depth_map),
            base_color: [base[0], base[1], base[2], 1.0],
            middle: middle.as_vec2().to_array(),
            near: self.near as f32,
            radius_scale: style.radius_scale * scale as f32 * if disc { std::f32::consts::FRAC_1_SQRT_2 } else { 1.0 },
            tolerance_absolute: style.tolerance.absolute,
            tolerance_relative: style.tolerance.relative,
            low_pass: style.low_pass,
            sprite_limit,
            pixel_size: match style.footprint {
                Footprint::Pixels(size) => size,
                Footprint::Splat => 0.0,
            },
            slab_near: 0.0,
            slab_thickness: 1.0,
            slab_count: 1.0,
            test_eye: [0.0, 0.0, 0.0, 1.0],
            tau: 0.0,
            radius_most: 0,
            radius_step: 0,
            slot_shift: 0,
            padding: [0; 32],
        }
    }

    fn view_params(&self) -> ViewParams {
        let row = |v: DVec4| v.as_vec4().to_array();
        ViewParams {
            eye: row(self.eye),
            ray_0: row(self.ray[0].extend(0.0)),
            ray_x: row(self.ray[1].extend(0.0)),
            ray_y: row(self.ray[2].extend(0.0)),
            depth_map: row(self.depth_map),
            host_depth: [self.host_depth[0] as f32, self.host_depth[1] as f32, 0.0, 0.0],
            padding: [],
        }
    }
}

/// Farthest from the picture's middle and the view's axis that centres in single floats are good enough \[px\].
const SINGLE_REACH: f64 = 400.0;

/// The uniform scale of a similarity.
pub fn scale(transform: &DMat4) -> f64 {
    transform.determinant().abs().cbrt()
}

/// The full-screen passes' block.
pub fn frame_params(cameras: &[Camera], extent: vk::Extent2D, offset: vk::Offset2D, style: &Style) -> FrameParams {
    let mut views = [cameras[0].view_params(); MAX_VIEWS];
    for (to, camera) in views.iter_mut().zip(cameras) {
        *to = camera.view_params();
    }
    let (light, ambient, specular, shininess) = match style.shading {
        Shading::None => (glam::Vec3::Z, 1.0, 0.0, 1.0),
        Shading::Headlight { ambient } => (glam::Vec3::Z, ambient, 0.0, 1.0),
        Shading::Phong { light, ambient, specular, shininess } => {
            (light.normalize_or(glam::Vec3::Z), ambient, specular, shininess)
        }
    };
    let dome = style.eye_dome.unwrap_or(EyeDome { strength: 0.0, radius: 1.0 });
    FrameParams {
        views,
        light: light.extend(shininess).to_array(),
        offset: [offset.x as f32, offset.y as f32],
        extent: [extent.width as i32, extent.height as i32],
        ambient,
        specular,
        edl_strength: dome.strength,
        edl_radius: dome.radius,
        padding: [],
    }
}
