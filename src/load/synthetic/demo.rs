//! The first thing that a new user sees: a trefoil knot and spheres over a hilly plate. It has silhouettes against
//! near and far, thin and thick things, smooth shading, colours with edges, and ground that reaches the horizon line.

use glam::{DVec3, dvec3};

use super::terrain::{natural, relief, surface};
use super::{Builder, Lattice, shapes, shares};
use crate::load::PointCloud;
use crate::rng::{Rng, sin_cos};

use std::f64::consts::TAU;

/// Half the plate's side, the tube's radius \[world units\].
const HALF: f64 = 6.0;
const TUBE: f64 = 0.42;
const RISE: f64 = 2.6;

/// Centre on the plate, radius, colour of the bright and of the dark bands.
const SPHERES: [(f64, f64, f64, DVec3, DVec3); 5] = [
    (4.1, -3.4, 0.95, dvec3(0.95, 0.77, 0.20), dvec3(0.62, 0.36, 0.07)),
    (-4.3, -2.9, 0.75, dvec3(0.86, 0.29, 0.22), dvec3(0.45, 0.10, 0.12)),
    (-3.6, 4.0, 1.10, dvec3(0.28, 0.62, 0.80), dvec3(0.09, 0.27, 0.48)),
    (3.9, 3.9, 0.60, dvec3(0.92, 0.92, 0.90), dvec3(0.45, 0.45, 0.48)),
    (0.3, -4.9, 0.45, dvec3(0.45, 0.78, 0.45), dvec3(0.13, 0.40, 0.25)),
];

pub(super) fn demo(points: usize, seed: u64) -> PointCloud {
    let mut out = Builder::new(points);
    let knot_area = TAU * TUBE * knot_length();
    let sphere_areas = SPHERES.map(|s| 2.0 * TAU * s.2 * s.2);
    // Ground is wide and dull: it gets a third of the density.
    let mut weights = vec![4.0 * HALF * HALF / 3.0, knot_area];
    weights.extend(sphere_areas);
    let parts = shares(points, &weights);
    ground(&mut out, parts[0], seed);
    knot(&mut out, parts[1], knot_area);
    for ((x, y, radius, bright, dark), n) in SPHERES.into_iter().zip(&parts[2..]) {
        let center = dvec3(x, y, ground_height(x, y, seed) + 0.85 * radius);
        let band = |n: DVec3| if ((n.z + 1.0) * 4.0) as i64 % 2 == 0 { bright } else { dark };
        shapes::sphere_into(&mut out, *n, center, radius, band);
    }
    out.z_up()
}

/// Hills that sink towards the middle, where the knot floats.
fn ground_height(x: f64, y: f64, seed: u64) -> f64 {
    let far = ((x * x + y * y) / (HALF * HALF)).min(1.0);
    RISE * relief(x / 3.0 + 40.0, y / 3.0 + 40.0, 6, seed) * (0.25 + 0.75 * far)
}

fn ground(out: &mut Builder, points: usize, seed: u64) {
    let lattice = Lattice::new(points, 1.0, 1.0, 0.5);
    let mut rng = Rng::new(seed);
    let spacing = 2.0 * HALF / (points.max(1) as f64).sqrt();
    for i in 0..points {
        let (u, v) = lattice.at(i, &mut rng);
        let (x, y) = ((2.0 * u - 1.0) * HALF, (2.0 * v - 1.0) * HALF);
        let (z, normal) = surface(|x, y| ground_height(x, y, seed), x, y, 0.01);
        // A fine dark line each unit shows scale and perspective.
        let near_line = |t: f64| (t - t.round()).abs() < 0.012;
        let shade = if near_line(x) || near_line(y) { 0.72 } else { 1.0 };
        let color = shade * natural(0.12 + z / (1.9 * RISE), normal.z) + 0.03 * (rng.unit() - 0.5);
        out.push(dvec3(x, y, z), normal, 1.25 * spacing / normal.z.max(0.3), color);
    }
}

/// The trefoil's centre line and its derivative by the parameter, t in turns.
fn trefoil(t: f64) -> (DVec3, DVec3) {
    let ((s1, c1), (s2, c2), (s3, c3)) = (sin_cos(t), sin_cos(2.0 * t), sin_cos(3.0 * t));
    let p = dvec3(s1 + 2.0 * s2, c1 - 2.0 * c2, -s3);
    let d = TAU * dvec3(c1 + 4.0 * c2, -s1 + 4.0 * s2, -3.0 * c3);
    (0.95 * p + dvec3(0.0, 0.0, 2.75), 0.95 * d)
}

const STEPS: usize = 3000;

fn knot_length() -> f64 {
    (0..STEPS).map(|i| trefoil((i as f64 + 0.5) / STEPS as f64).1.length()).sum::<f64>() / STEPS as f64
}

/// Rings of equally many points, equally far apart along the line; each is half a step turned against the one before.
fn knot(out: &mut Builder, points: usize, area: f64) {
    if points == 0 {
        return;
    }
    let spacing = (area / points as f64).sqrt();
    let around = ((TAU * TUBE / spacing).round() as usize).clamp(1, points);
    let rings = points.div_ceil(around);
    let total = knot_length();
    let (mut t, mut walked) = (0.0, 0.0);
    for i in 0..points {
        let (ring, k) = (i / around, i % around);
        if k == 0 && ring > 0 {
            // On by one ring's distance, in small steps of equal parameter.
            let goal = total * ring as f64 / rings as f64;
            while walked < goal {
                let step = ((goal - walked) / trefoil(t).1.length()).min(1.0 / STEPS as f64);
                walked += trefoil(t + 0.5 * step).1.length() * step;
                t += step;
                if step < 1e-9 {
                    break;
                }
            }
        }
        let (center, along) = trefoil(t);
        let along = along / along.length();
        // Any frame will do: rings are closed. The line is never vertical, so its side is never undefined.
        let side = along.cross(DVec3::Z);
        let side = side / side.length();
        let above = side.cross(along);
        let in_ring = around.min(points - ring * around);
        let (sin, cos) = sin_cos((k as f64 + 0.5 * (ring % 2) as f64) / in_ring as f64);
        let normal = cos * side + sin * above;
        let hue = sin_cos(t);
        let stripe = if ((t * 48.0) as i64) % 2 == 0 { 1.0 } else { 0.86 };
        let color = dvec3(0.62 + 0.33 * hue.0, 0.48 - 0.22 * hue.0 * hue.1, 0.62 + 0.30 * hue.1) * stripe;
        out.push(center + TUBE * normal, normal, spacing * 1.1, color);
    }
}
