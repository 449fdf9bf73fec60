//! Scenes from formulas: any size, the same bytes for the same seed on every platform.

mod deep;
mod demo;
mod mesh;
mod room;
mod shapes;
mod terrain;

pub(in crate::load) use deep::Deep;
#[cfg(feature = "layered")]
pub(in crate::load) use deep::EYE;
pub use mesh::{sphere_mesh, torus_mesh};

use glam::{DVec3, Vec3};

use super::PointCloud;
use crate::error::{Error, Place, Result};
use crate::rng::Rng;

/// The scenes that [`scene`] makes, each with what it is for.
pub const SCENES: [(&str, &str); 8] = [
    ("demo", "a knot and spheres over a hilly plate: what to look at first (z up)"),
    ("sphere", "a closed unit sphere, evenly sampled, exact normals and radii"),
    ("torus", "a closed torus (radii 1 and 0.4), evenly sampled, exact normals and radii"),
    ("terrain", "a fractal height field, 100 units wide, natural colours (z up)"),
    ("room", "a furnished room of 8 × 6 × 3 units seen from inside (z up, viewpoint given)"),
    ("deep", "a town full of rooms, more than 50 surfaces deep at eye height (z up, viewpoint given)"),
    ("noise", "uniformly random points in a unit cube, without normals"),
    ("coincident", "points on ten places only"),
];

/// How many points `demo` looks best with.
pub const DEMO_POINTS: usize = 1_000_000;

/// Makes a scene with exactly `points` points.
///
/// # Errors
/// [`Error::Data`] if there is no scene of that name, or for no points at all.
pub fn scene(name: &str, points: usize, seed: u64) -> Result<PointCloud> {
    if points == 0 {
        return Err(Error::data(name, Place::File, "a scene needs at least one point"));
    }
    let mut cloud = match name {
        "demo" => demo::demo(points, seed),
        "sphere" => shapes::sphere(points),
        "torus" => shapes::torus(points),
        "terrain" => terrain::terrain(points, seed),
        "room" => room::room(points, seed),
        "deep" => Deep::new(points as u64, seed).points(0..points as u64),
        "noise" => shapes::noise(points, seed),
        "coincident" => shapes::coincident(points, seed),
        _ => {
            let names = SCENES.map(|(name, _)| name).join(", ");
            return Err(Error::data(name, Place::File, format!("there is no such scene; there are {names}")));
        }
    };
    cloud.report.format = format(name, seed);
    cloud.report.points_in_file = points as u64;
    Ok(cloud)
}

/// What reports say of a scene.
pub(in crate::load) fn format(name: &str, seed: u64) -> String {
    format!("synthetic {name}, seed {seed}")
}

/// Collects points that have a normal, a radius and a colour each.
struct Builder(PointCloud);

impl Builder {
    fn new(points: usize) -> Builder {
        Builder(PointCloud {
            positions: Vec::with_capacity(points),
            normals: Some(Vec::with_capacity(points)),
            radii: Some(Vec::with_capacity(points)),
            colors: Some(Vec::with_capacity(points)),
            ..Default::default()
        })
    }

    /// `normal` of any length but zero, `radius` > 0, `color` sRGB from 0 to 1.
    fn push(&mut self, position: DVec3, normal: DVec3, radius: f64, color: DVec3) {
        self.0.positions.push(position.as_vec3());
        if let Some(list) = &mut self.0.normals {
            list.push((normal / normal.length()).as_vec3());
        }
        if let Some(list) = &mut self.0.radii {
            list.push(radius as f32);
        }
        if let Some(list) = &mut self.0.colors {
            list.push(color.to_array().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8));
        }
    }

    fn append(&mut self, other: Builder) {
        fn extend<T: Copy>(to: &mut Option<Vec<T>>, from: Option<Vec<T>>) {
            to.iter_mut().for_each(|to| to.extend_from_slice(from.as_deref().unwrap_or_default()));
        }
        self.0.positions.extend_from_slice(&other.0.positions);
        extend(&mut self.0.normals, other.0.normals);
        extend(&mut self.0.radii, other.0.radii);
        extend(&mut self.0.colors, other.0.colors);
    }

    fn z_up(mut self) -> PointCloud {
        self.0.up = Some(Vec3::Z);
        self.0
    }
}

/// Splits `points` by weights, to the last point.
fn shares(points: usize, weights: &[f64]) -> Vec<usize> {
    let total: f64 = weights.iter().sum();
    let (mut sum, mut given) = (0.0, 0);
    weights
        .iter()
        .enumerate()
        .map(|(i, w)| {
            sum += w;
            let upto = if i + 1 == weights.len() { points } else { (points as f64 * (sum / total)) as usize };
            let share = upto.min(points) - given;
            given += share;
            share
        })
        .collect()
}

/// Parameters (u, v) in 0..1 of point `i` of `n` that cover a `width` × `height` rectangle evenly, shifted by up to
/// `jitter` cells.
struct Lattice {
    columns: usize,
    rows: usize,
    n: usize,
    jitter: f64,
}

impl Lattice {
    fn new(n: usize, width: f64, height: f64, jitter: f64) -> Lattice {
        let columns = ((n as f64 * width / height).sqrt().round() as usize).clamp(1, n.max(1));
        Lattice { columns, rows: n.div_ceil(columns).max(1), n, jitter }
    }

    /// The last row may hold fewer points than the others: they are spread over its whole width.
    fn at(&self, i: usize, rng: &mut Rng) -> (f64, f64) {
        let (row, column) = (i / self.columns, i % self.columns);
        let in_row = (self.n - row * self.columns).min(self.columns);
        let mut shift = || 0.5 + self.jitter * (rng.unit() - 0.5);
        ((column as f64 + shift()) / in_row as f64, (row as f64 + shift()) / self.rows as f64)
    }
}
