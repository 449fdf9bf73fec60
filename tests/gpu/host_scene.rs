//! What the engine shows: a sphere of splats, and cameras of every kind.

use std::sync::Arc;

use glam::{DMat4, DVec3, Vec3, dvec3};
use surfel::load::PointCloud;
use surfel::select::{DepthConvention, View};
use surfel::structure::Flat;
use surfel::structure::groups::{Groups, Relax};

/// A unit sphere about the origin: `n` points along a spiral, evenly spread, with normals, covering radii and colours.
pub fn sphere(n: usize) -> Arc<Flat> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let normals: Vec<Vec3> = (0..n)
        .map(|i| {
            let y = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
            let (s, c) = (golden * i as f64).sin_cos();
            let ring = (1.0 - y * y).sqrt();
            dvec3(c * ring, y, s * ring).as_vec3()
        })
        .collect();
    // Each point stands for 4π/n; 1.6 for a spiral's unevenness.
    let radius = 1.6 * (4.0 * std::f32::consts::PI / n.max(1) as f32).sqrt();
    let color = |v: f32| (127.5 + 127.0 * v) as u8;
    let mut flat = Flat::new(&PointCloud {
        colors: Some(normals.iter().map(|p| [color(p.x), color(p.y), color(p.z)]).collect()),
        positions: normals.clone(),
        normals: Some(normals),
        radii: Some(vec![radius; n]),
        closed: true,
        ..PointCloud::default()
    });
    flat.groups = Some(Groups::color(&flat, &Relax { factor: 0.6, ..Relax::default() }).expect("groups"));
    Arc::new(flat)
}

/// What is done to a projection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lens {
    Straight,
    /// The axis is off the picture's centre, as for a wall of screens or one eye of a headset.
    Asymmetric,
    /// y points up in clip space, as engines have it that flip the viewport.
    Flipped,
}

/// A camera that sees the sphere: `side` 0 from the front, 1 from the right and above. Infinite far plane.
pub fn camera(side: u32, lens: Lens, depth: DepthConvention, aspect: f64) -> View {
    let near = 0.1;
    let mut projection = View::perspective(50f64.to_radians(), aspect, near);
    if depth == DepthConvention::Standard {
        // depth = 1 − near / z
        (projection.z_axis.z, projection.w_axis.z) = (-1.0, -near);
    }
    match lens {
        Lens::Straight => {}
        Lens::Asymmetric => (projection.z_axis.x, projection.z_axis.y) = (0.3, -0.2),
        Lens::Flipped => projection = DMat4::from_scale(dvec3(1.0, -1.0, 1.0)) * projection,
    }
    let eye = if side == 0 { dvec3(0.3, 0.2, 3.5) } else { dvec3(2.4, 1.8, 1.6) };
    View::look_at(eye, DVec3::ZERO, DVec3::Y, projection, depth)
}
