//! Closed shapes with exact normals, and clouds that are no surface at all.

use glam::{DVec3, dvec3};

use super::Builder;
use crate::load::PointCloud;
use crate::rng::{Rng, golden, hash, sin_cos};

use std::f64::consts::TAU;

/// Fibonacci lattice: point i on the circle of height z = 1 − (2i + 1)/n, a golden turn after the one before.
pub(super) fn sphere(points: usize) -> PointCloud {
    let mut out = Builder::new(points);
    sphere_into(&mut out, points, DVec3::ZERO, 1.0, |n| 0.5 + 0.5 * n);
    out.0.closed = true;
    out.0
}

/// `color` of the unit normal.
pub(super) fn sphere_into(
    out: &mut Builder,
    points: usize,
    center: DVec3,
    radius: f64,
    color: impl Fn(DVec3) -> DVec3,
) {
    // Each point's share of the area is a square of this side.
    let spacing = radius * (2.0 * TAU / points.max(1) as f64).sqrt();
    for i in 0..points {
        let z = 1.0 - (2 * i + 1) as f64 / points as f64;
        let across = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = sin_cos(golden(i));
        let n = dvec3(across * cos, across * sin, z);
        out.push(center + radius * n, n, spacing, color(n));
    }
}

const TUBE: f64 = 0.4;

pub(super) fn torus(points: usize) -> PointCloud {
    let mut out = Builder::new(points);
    // 4π² R r.
    let spacing = (TAU * TAU * TUBE / points as f64).sqrt();
    for i in 0..points {
        // Area grows with the distance from the axis: invert v + r sin(v)/2π = t by Newton's method, in turns.
        let t = (i as f64 + 0.5) / points as f64;
        let mut v = t;
        for _ in 0..12 {
            let (sin, cos) = sin_cos(v);
            v -= (v + TUBE * sin / TAU - t) / (1.0 + TUBE * cos);
        }
        let (sv, cv) = sin_cos(v);
        let (su, cu) = sin_cos(golden(i));
        let n = dvec3(cv * cu, cv * su, sv);
        out.push(dvec3(cu, su, 0.0) + TUBE * n, n, spacing, 0.5 + 0.5 * n);
    }
    out.0.closed = true;
    out.0
}

pub(super) fn noise(points: usize, seed: u64) -> PointCloud {
    let mut rng = Rng::new(seed);
    let mut cloud = PointCloud::default();
    let mut colors = Vec::with_capacity(points);
    cloud.positions.reserve_exact(points);
    for _ in 0..points {
        let p = dvec3(rng.unit(), rng.unit(), rng.unit());
        cloud.positions.push(p.as_vec3());
        colors.push((p * 255.0).round().to_array().map(|v| v as u8));
    }
    cloud.colors = Some(colors);
    cloud
}

pub(super) fn coincident(points: usize, seed: u64) -> PointCloud {
    let place = |k: i64| dvec3(hash(k, 0, seed), hash(k, 1, seed), hash(k, 2, seed)).as_vec3();
    PointCloud { positions: (0..points).map(|i| place((i % 10) as i64)).collect(), ..Default::default() }
}
