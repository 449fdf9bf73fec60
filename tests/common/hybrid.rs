//! A mesh that both test binaries draw: a torus whose faces are of two sizes.

use std::f32::consts::TAU;

use glam::vec3;
use surfel::load::attributes::{self, Options};
use surfel::load::{Mesh, PointCloud};

/// Radii 1 and 0.4 about the axis z, `around` by `across` quads of two triangles, in smooth colours; a quarter of it finer.
pub fn torus(around: u32, across: u32) -> PointCloud {
    let mut cloud = PointCloud::default();
    let (mut normals, mut colors) = (Vec::new(), Vec::new());
    for i in 0..around {
        // Steps of a third in the first quarter of the indices.
        let t = i as f32 / around as f32;
        let t = if t < 0.25 { t / 3.0 } else { 0.25 / 3.0 + (t - 0.25) * (1.0 - 0.25 / 3.0) / 0.75 };
        let (sin, cos) = (TAU * t).sin_cos();
        for j in 0..across {
            let (up, out) = (TAU * j as f32 / across as f32).sin_cos();
            let normal = vec3(cos * out, sin * out, up);
            cloud.positions.push(vec3(cos, sin, 0.0) + 0.4 * normal);
            normals.push(normal);
            colors.push(normal.to_array().map(|v| (127.5 + 100.0 * v) as u8));
        }
    }
    let at = |i: u32, j: u32| i % around * across + j % across;
    let quad = |k: u32| {
        let (i, j) = (k / across, k % across);
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    cloud.mesh = Some(Mesh { triangles: (0..around * across).flat_map(quad).collect() });
    (cloud.normals, cloud.colors) = (Some(normals), Some(colors));
    attributes::complete(&mut cloud, &Options::default());
    cloud
}
