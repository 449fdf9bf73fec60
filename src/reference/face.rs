//! A triangle of a mesh: at every pixel that it covers a fragment with w = 1, u = 0 and exact depth, where its size is
//! larger than the threshold (Dachsbacher, Vogelgsang, Stamminger: Sequential Point Trees, 2003, section 3.8).

use glam::{DVec2, DVec3, dvec2};

use super::bound::Bound;
use super::camera::Ray;
use super::fragment::{Fragment, SNAP};
use super::splat::{Look, Setup, Splat, tolerance};

/// A triangle in eye space.
pub struct Face {
    pub corners: [DVec3; 3],
    /// Unit.
    normal: DVec3,
    /// From the eye, in the cloud's units; of length 1 without perspective.
    places: [DVec3; 3],
    /// \[cloud units\]
    size: f64,
    /// τ, and what takes cloud units to drawn radii.
    tau: f64,
    scale: f64,
    /// Unit normals, 0 where there is none; linear colours.
    normals: [DVec3; 3],
    colors: [DVec3; 3],
}

/// What is to be known of a face before it is seen.
pub struct Corners {
    pub eye_space: [DVec3; 3],
    /// From the eye, in the cloud's frame and units.
    pub places: [DVec3; 3],
    pub normals: [DVec3; 3],
    pub colors: [DVec3; 3],
    pub size: f32,
}

impl Face {
    /// In eye space.
    pub fn new(of: Corners, tau: f64, scale: f64) -> Face {
        let [a, b, c] = of.eye_space;
        Face {
            corners: of.eye_space,
            normal: (b - a).cross(c - a).normalize_or_zero(),
            places: of.places,
            size: of.size as f64,
            tau,
            scale,
            normals: of.normals,
            colors: of.colors,
        }
    }

    /// The box of its image; `None` if it lies wholly before the near plane.
    pub fn bound(&self, setup: &Setup) -> Option<Bound> {
        let camera = &setup.camera;
        let mut bound = Bound { min: DVec2::INFINITY, max: DVec2::NEG_INFINITY, error: SNAP };
        let mut include = |p: DVec3| {
            let at = camera.project(p);
            (bound.min, bound.max) = (bound.min.min(at), bound.max.max(at));
        };
        let [a, b, c] = self.corners;
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let (from, to) = (-p.z - camera.near, -q.z - camera.near);
            if from >= 0.0 {
                include(p);
            }
            if from * to < 0.0 {
                include(p + (q - p) * (from / (from - to)));
            }
        }
        let size = dvec2(camera.width as f64, camera.height as f64);
        let meets = bound.max.cmpgt(DVec2::ZERO).all() && bound.min.cmplt(size).all();
        meets.then_some(bound)
    }

    /// Twice the volumes of the tetrahedra between the ray and each side: their signs say on which side the ray passes, and
    /// two faces with a common side have the same value for it, of opposite sign.
    fn volumes(&self, ray: &Ray) -> [f64; 3] {
        let [a, b, c] = self.corners.map(|p| p - ray.origin);
        [b.cross(c), c.cross(a), a.cross(b)].map(|across| across.dot(ray.direction))
    }

    fn weights(&self, ray: &Ray) -> [f64; 3] {
        let volumes = self.volumes(ray);
        let sum: f64 = volumes.iter().sum();
        volumes.map(|v| v / sum)
    }

    /// The fragment at a pixel centre as a splat that has no other; `None` where the face has none there and rounding could not
    /// make one.
    pub fn fragment(&self, setup: &Setup, at: DVec2) -> Option<(Splat, Look, Fragment)> {
        let (camera, margin) = (&setup.camera, setup.margin);
        let ray = camera.ray(at);
        let volumes = self.volumes(&ray);
        let covered = volumes.iter().all(|v| *v >= 0.0) || volumes.iter().all(|v| *v <= 0.0);
        // Within rounding of a side, or of the border where faces end \[px\].
        let (mut sure, mut perhaps) = (covered, covered);
        let [right, down] = [dvec2(1.0, 0.0), dvec2(0.0, 1.0)].map(|step| camera.ray(at + step));
        if margin > 0.0 {
            let border = SNAP + margin * (camera.width + camera.height) as f64;
            let (x, y) = (self.volumes(&right), self.volumes(&down));
            let sign = volumes.iter().sum::<f64>().signum();
            // Linear in the pixel, so these are distances from the three sides, positive within.
            let inside = (0..3).map(|i| sign * volumes[i] / (x[i] - volumes[i]).hypot(y[i] - volumes[i]));
            let least = inside.fold(f64::INFINITY, f64::min);
            (sure, perhaps) = (least > border, least > -border);
        }
        if !perhaps {
            return None;
        }
        let weights = self.weights(&ray);
        let mix = |of: &[DVec3; 3], weights: [f64; 3]| weights[0] * of[0] + weights[1] * of[1] + weights[2] * of[2];
        let p = mix(&self.corners, weights);
        let place = mix(&self.places, weights);
        let reach = self.tau * place.length();
        let z = -p.z;
        let dz = match margin > 0.0 {
            true => {
                let [x, y] = [&right, &down].map(|r| -mix(&self.corners, self.weights(r)).z - z);
                SNAP * (x.abs() + y.abs()) + margin * p.length()
            }
            false => 0.0,
        };
        let there = self.size > reach;
        sure &= (self.size - reach).abs() > 4.0 * margin * reach && z - dz >= camera.near;
        let inside = covered && there && z >= camera.near;
        if !(inside || margin > 0.0 && self.size > reach * (1.0 - 4.0 * margin) && z + dz >= camera.near) {
            return None;
        }
        let n = mix(&self.normals, weights).try_normalize().unwrap_or(self.normal);
        let n = if n.dot(camera.towards_viewer(p)) < 0.0 { -n } else { n };
        let r = reach * self.scale;
        let splat = Splat { p, n, r, z, screen: Some(at), affine: None, drawn: true, sure: true };
        let (epsilon, d_epsilon) = tolerance(setup, &splat);
        let look = Look { epsilon, d_epsilon, color: mix(&self.colors, weights) };
        Some((splat, look, Fragment { z, dz, u2: 0.0, du: 0.0, inside, sure, slope: 0.0 }))
    }
}
