//! Clouds on known surfaces, from a fixed seed.

use glam::Vec3;
use surfel::load::PointCloud;

/// xorshift64 (Marsaglia 2003): uniform in [0, 1), 24 bits.
pub struct Random(pub u64);

impl Random {
    pub fn new() -> Self {
        Random(0x9E37_79B9_7F4A_7C15)
    }

    pub fn next(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Normal distribution, σ = 1 (Box and Muller 1958).
    pub fn gauss(&mut self) -> f32 {
        let r = (-2.0 * (1.0 - self.next()).ln()).sqrt();
        r * (std::f32::consts::TAU * self.next()).cos()
    }
}

pub fn cloud(positions: Vec<Vec3>) -> PointCloud {
    PointCloud { positions, ..Default::default() }
}

/// Points (x, y, 0), uniform in the unit square.
pub fn square(n: usize, random: &mut Random) -> Vec<Vec3> {
    (0..n).map(|_| Vec3::new(random.next(), random.next(), 0.0)).collect()
}

/// `side`² points of spacing `s`, corner at the origin, each moved by up to `jitter` · s / 2 along both axes.
pub fn grid(side: usize, s: f32, jitter: f32, random: &mut Random) -> Vec<Vec3> {
    let mut at = |i: usize| (i as f32 + jitter * (random.next() - 0.5)) * s;
    (0..side * side).map(|i| Vec3::new(at(i % side), at(i / side), 0.0)).collect()
}

/// Even points on the unit sphere (Fibonacci lattice).
pub fn sphere(n: usize) -> Vec<Vec3> {
    let golden = std::f32::consts::PI * (3.0 - 5.0f32.sqrt());
    (0..n)
        .map(|i| {
            let z = 1.0 - (2 * i + 1) as f32 / n as f32;
            let (s, c) = (golden * i as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vec3::new(r * c, r * s, z)
        })
        .collect()
}

/// Random points on a torus about z of radii 2 and 0.7, uniform in the angles, and the true outward normals.
pub fn torus(n: usize, random: &mut Random) -> (Vec<Vec3>, Vec<Vec3>) {
    let tau = std::f32::consts::TAU;
    (0..n)
        .map(|_| {
            let ((s, c), (t, d)) = ((tau * random.next()).sin_cos(), (tau * random.next()).sin_cos());
            let normal = Vec3::new(c * d, s * d, t);
            (Vec3::new(2.0 * c, 2.0 * s, 0.0) + 0.7 * normal, normal)
        })
        .unzip()
}

/// The share of `probes` that lie within no splat (x, y only), by a grid of buckets.
pub fn uncovered(points: &[Vec3], radii: &[f32], probes: &[Vec3]) -> f64 {
    let largest = radii.iter().fold(0.0f32, |a, &b| a.max(b));
    let cell = |x: f32| (x / largest).floor() as i32;
    let mut buckets = std::collections::HashMap::<(i32, i32), Vec<usize>>::new();
    for (i, p) in points.iter().enumerate() {
        buckets.entry((cell(p.x), cell(p.y))).or_default().push(i);
    }
    let covered = |q: &Vec3| {
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy)));
        around
            .filter_map(|(dx, dy)| buckets.get(&(cell(q.x) + dx, cell(q.y) + dy)))
            .flatten()
            .any(|&i| (points[i] - *q).length() <= radii[i])
    };
    probes.iter().filter(|q| !covered(q)).count() as f64 / probes.len() as f64
}
