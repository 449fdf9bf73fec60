//! Which part of the picture a frame can reach: nothing beyond it is folded or resolved.

use ash::vk;
use glam::{DMat4, DVec2, dvec2, dvec3};

use super::params::Camera;
use crate::structure::flat::Block;

/// What rounding and the margins of sprites add to a footprint \[px\]; they are below a half.
const SLACK: f64 = 1.0;

/// A rectangle that grows with everything that is drawn \[px\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    low: DVec2,
    high: DVec2,
}

impl Default for Area {
    fn default() -> Self {
        Area { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY }
    }
}

impl Area {
    const ALL: Area = Area { low: DVec2::NEG_INFINITY, high: DVec2::INFINITY };

    /// Adds the footprints of a block's splats; all of the picture where one may be nearer than the near plane. `radius_scale` takes
    /// stored to drawn radii in cloud units, `margin` is what a footprint covers beyond its radius \[px\].
    ///
    /// The box of the centres, grown by the radius, holds all discs; it lies before the eye, so that its image lies between those of its
    /// corners.
    pub fn add(&mut self, block: &Block, camera: &Camera, eye_from_cloud: &DMat4, radius_scale: f64, margin: f64) {
        if *self == Area::ALL {
            return;
        }
        let r = block.radius as f64 * radius_scale;
        let bounds = [block.min.as_dvec3() - r, block.max.as_dvec3() + r];
        for i in 0..8 {
            let pick = |axis: usize| bounds[i >> axis & 1][axis];
            let p = eye_from_cloud.transform_point3(dvec3(pick(0), pick(1), pick(2)));
            let h = p.extend(1.0);
            let at = dvec2(camera.pixel_x.dot(h), camera.pixel_y.dot(h)) / camera.pixel_w.dot(h);
            // Where a transform or a box is not finite, no comparison holds.
            if !(-p.z >= camera.near && at.is_finite()) {
                *self = Area::ALL;
                return;
            }
            self.low = self.low.min(at - (margin + SLACK));
            self.high = self.high.max(at + (margin + SLACK));
        }
    }

    /// What of a picture of this size it covers; of no pixel where nothing was added.
    pub fn of(&self, extent: vk::Extent2D) -> vk::Rect2D {
        let size = dvec2(extent.width as f64, extent.height as f64);
        let low = self.low.floor().clamp(DVec2::ZERO, size);
        let high = self.high.ceil().clamp(low, size);
        let [width, height] = (high - low).to_array();
        vk::Rect2D {
            offset: vk::Offset2D { x: low.x as i32, y: low.y as i32 },
            extent: vk::Extent2D { width: width as u32, height: height as u32 },
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3, Vec3};

    use super::*;
    use crate::rng::Rng;
    use crate::select::{DepthConvention, View};

    const EXTENT: vk::Extent2D = vk::Extent2D { width: 150, height: 100 };

    fn vector(rng: &mut Rng) -> DVec3 {
        DVec3::new(rng.unit(), rng.unit(), rng.unit()) * 2.0 - 1.0
    }

    #[test]
    fn whatever_is_drawn_lies_within() {
        let mut rng = Rng::new(1);
        let (mut inside, mut whole, mut part) = (0, 0, 0);
        for case in 0..2000 {
            let lens = match case % 2 == 0 {
                true => View::perspective(1.0, 1.5, 0.1),
                false => View::orthographic(4.0, 1.5, 0.1, 20.0),
            };
            let eye = 4.0 * vector(&mut rng);
            let view = View::look_at(eye, vector(&mut rng), DVec3::Z, lens, DepthConvention::Reversed);
            let camera = Camera::new(&view, EXTENT);
            let turn = DQuat::from_scaled_axis(3.0 * vector(&mut rng));
            let transform = DMat4::from_scale_rotation_translation(DVec3::splat(0.5), turn, vector(&mut rng));
            let (matrix, scale) = camera.eye_from_cloud(&transform, DVec3::ZERO);
            let (a, b) = (vector(&mut rng).as_vec3(), vector(&mut rng).as_vec3());
            let block = Block { first: 0, count: 1, min: a.min(b), max: a.max(b), radius: 0.2 * rng.unit() as f32 };
            let mut area = Area::default();
            area.add(&block, &camera, &matrix, 2.0, 1.0);
            let rect = area.of(EXTENT);
            let covers = |at: DVec2| {
                let (x, y) = (at.x.floor() as i64 - rect.offset.x as i64, at.y.floor() as i64 - rect.offset.y as i64);
                (0..rect.extent.width as i64).contains(&x) && (0..rect.extent.height as i64).contains(&y)
            };
            for _ in 0..50 {
                // Often a corner.
                let t = (vector(&mut rng) + 0.5).clamp(DVec3::ZERO, DVec3::ONE);
                let centre = block.min.as_dvec3() + t * (block.max - block.min).as_dvec3();
                // A point of a disc round it, and a pixel beyond.
                let disc =
                    matrix.transform_point3(centre) + vector(&mut rng).normalize() * block.radius as f64 * 2.0 * scale;
                if -disc.z < camera.near {
                    continue;
                }
                let h = disc.extend(1.0);
                let at = dvec2(camera.pixel_x.dot(h), camera.pixel_y.dot(h)) / camera.pixel_w.dot(h);
                let at = at + vector(&mut rng).truncate().normalize();
                let seen = at.cmpge(DVec2::ZERO).all() && at.x < 150.0 && at.y < 100.0;
                assert!(!seen || covers(at), "{at} of {rect:?}");
                inside += usize::from(seen);
            }
            match rect.extent == EXTENT {
                true => whole += 1,
                false => part += 1,
            }
        }
        assert!(inside > 10_000 && whole > 10 && part > 1000, "{inside} {whole} {part}");
    }

    #[test]
    fn a_small_thing_far_away_takes_a_few_pixels() {
        let view = View {
            view: DMat4::IDENTITY,
            projection: View::perspective(std::f64::consts::FRAC_PI_2, 1.5, 0.1),
            depth: DepthConvention::Reversed,
        };
        let camera = Camera::new(&view, EXTENT);
        let around = |z: f32| Block {
            first: 0,
            count: 1,
            min: Vec3::new(-1.0, -1.0, z - 1.0),
            max: Vec3::new(1.0, 1.0, z + 1.0),
            radius: 0.0,
        };
        let of = |blocks: &[Block]| {
            let mut area = Area::default();
            blocks.iter().for_each(|b| area.add(b, &camera, &DMat4::IDENTITY, 1.0, 1.0));
            area.of(EXTENT)
        };
        // 50 px are one unit at distance one: 5 px either side at 10, one of margin and one of slack.
        let rect = of(&[around(-11.0)]);
        assert_eq!((rect.offset.x, rect.offset.y, rect.extent.width, rect.extent.height), (68, 43, 14, 14));
        assert_eq!(of(&[around(-11.0), around(-0.5)]).extent, EXTENT, "one is at the eye");
        assert_eq!(of(&[]).extent, vk::Extent2D::default(), "nothing is drawn");
        assert_eq!(of(&[Block { max: Vec3::NAN, ..around(-11.0) }]).extent, EXTENT);
    }
}
