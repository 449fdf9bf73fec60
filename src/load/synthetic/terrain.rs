//! A height field of fractal value noise.

use glam::{DVec3, dvec3};

use super::{Builder, Lattice};
use crate::load::PointCloud;
use crate::rng::{Rng, hash};

/// Side \[world units\].
const SIDE: f64 = 100.0;
/// From the lowest to the highest possible point, before the flattening of valleys.
const HEIGHT: f64 = 30.0;
/// Points lie anywhere in the middle 60 % of their cell, so neighbours may be 1.6 cells apart.
const JITTER: f64 = 0.6;

pub(super) fn terrain(points: usize, seed: u64) -> PointCloud {
    let mut out = Builder::new(points);
    let lattice = Lattice::new(points, 1.0, 1.0, JITTER);
    let mut rng = Rng::new(seed);
    let spacing = SIDE / (points as f64).sqrt();
    for i in 0..points {
        let (u, v) = lattice.at(i, &mut rng);
        let (x, y) = ((u - 0.5) * SIDE, (v - 0.5) * SIDE);
        let height = |x: f64, y: f64| HEIGHT * relief(x / 40.0, y / 40.0, 7, seed);
        let (z, normal) = surface(height, x, y, 0.25 * spacing.min(1.0));
        let speckle = 0.04 * (rng.unit() - 0.5);
        let color = natural(z / HEIGHT, normal.z) + speckle;
        // The slope stretches cells; 1.3 covers the jitter.
        out.push(dvec3(x, y, z), normal, 1.3 * spacing / normal.z.max(0.3), color);
    }
    out.z_up()
}

/// Height and unit normal of a height field, by central differences over 2 `step`.
pub(super) fn surface(height: impl Fn(f64, f64) -> f64, x: f64, y: f64, step: f64) -> (f64, DVec3) {
    let dx = height(x + step, y) - height(x - step, y);
    let dy = height(x, y + step) - height(x, y - step);
    let n = dvec3(-dx, -dy, 2.0 * step);
    (height(x, y), n / n.length())
}

/// Mountains with flat valleys, 0 to 1; `octaves` layers, each half the size of the one before.
pub(super) fn relief(x: f64, y: f64, octaves: u64, seed: u64) -> f64 {
    let (mut sum, mut total, mut scale, mut share) = (0.0, 0.0, 1.0, 1.0);
    for octave in 0..octaves {
        sum += share * value_noise(x * scale, y * scale, seed.wrapping_add(octave));
        total += share;
        scale *= 2.0;
        share *= 0.47;
    }
    let h = sum / total;
    // Steeper towards the top.
    h * h * (1.5 - 0.5 * h)
}

fn value_noise(x: f64, y: f64, seed: u64) -> f64 {
    let (cx, cy) = (x.floor(), y.floor());
    // Quintic, so that slopes and their changes are continuous.
    let ease = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (ease(x - cx), ease(y - cy));
    let corner = |dx: i64, dy: i64| hash(cx as i64 + dx, cy as i64 + dy, seed);
    let low = corner(0, 0) + u * (corner(1, 0) - corner(0, 0));
    let high = corner(0, 1) + u * (corner(1, 1) - corner(0, 1));
    low + v * (high - low)
}

/// Sand, grass, rock and snow by height (0 to 1) and steepness (z of the normal).
pub(super) fn natural(height: f64, up: f64) -> DVec3 {
    let blend = |from: f64, to: f64, t: f64| {
        let t = ((t - from) / (to - from)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let (sand, grass) = (dvec3(0.79, 0.71, 0.53), dvec3(0.36, 0.50, 0.22));
    let (rock, snow) = (dvec3(0.47, 0.44, 0.41), dvec3(0.95, 0.96, 0.98));
    let ground = sand.lerp(grass, blend(0.12, 0.2, height));
    let steep = ground.lerp(rock, 1.0 - blend(0.72, 0.88, up));
    steep.lerp(rock, blend(0.42, 0.52, height)).lerp(snow, blend(0.55, 0.66, height) * blend(0.6, 0.8, up))
}
