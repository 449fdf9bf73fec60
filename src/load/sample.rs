//! Points spread evenly over the faces of a mesh: any number of them, of any mesh.

use glam::{DVec3, Vec3};

use super::{Mesh, PointCloud};
use crate::color::{decode_table, linear_to_srgb};
use crate::par;
use crate::rng::Rng;

/// Points a task: enough to hide its cost.
const BLOCK: usize = 4096;

/// 2⁶⁴ / ρ and 2⁶⁴ / ρ², ρ³ = ρ + 1: the steps of the two-dimensional Kronecker sequence R₂ (Roberts: The Unreasonable
/// Effectiveness of Quasirandom Sequences, 2018).
const R2: [u64; 2] = [0xC13F_A9A9_02A6_328F, 0x91E1_0DA5_C79E_7B1D];

/// `points` points on the faces of `cloud`, uniform by area; the same for the same seed, whatever the number of threads.
///
/// Faces are laid end to end by area, and points taken at equal steps from a start that the seed chooses: of any faces
/// that follow each other, as of any single one, the share of the points is the share of the area to less than one point. Within
/// a face they follow a low-discrepancy sequence (R₂, any run of which is even), mapped to the triangle by Heitz: A
/// Low-Distortion Map Between Triangle and Square, 2019.
///
/// - Normals are interpolated and normalised. Complete the cloud before (`attributes::complete`) for vertex normals that
///   are weighted by the faces' angles; without, they are the faces'.
/// - Colours are interpolated in linear light, opacity and intensity as they are; classes are the nearest corner's.
/// - Radii are left out. The spacing is √(area / points) on the whole, but where faces are smaller than that their order in
///   the file decides how evenly points lie, and κ with it: `attributes::complete` measures it.
/// - The samples are `closed` if the cloud is and every sample's normal is on its face's outer side, which is what
///   `closed` asks of vertices.
///
/// Faces without area get no point and are counted in the report; where there is no other face the result has no point
/// at all. Takes 32 B a point beside the result.
pub fn sample_mesh(cloud: &PointCloud, points: usize, seed: u64) -> PointCloud {
    let no_faces = Mesh::default();
    let mesh = cloud.mesh.as_ref().unwrap_or(&no_faces);
    let faces = Faces::new(cloud, mesh);
    let mut out = PointCloud {
        origin: cloud.origin,
        up: cloud.up,
        viewpoint: cloud.viewpoint,
        angular_step: cloud.angular_step,
        report: cloud.report.clone(),
        ..Default::default()
    };
    out.report.drop("faces without area", faces.empty);
    let points = if faces.total() > 0.0 { points } else { 0 };
    out.report.assume(format!("{points} points sampled from {} faces, evenly by area", mesh.triangles.len()));

    let places = faces.places(points, seed);
    let each = |f: &(dyn Fn(&Place) -> f64 + Sync)| fill(&places, |p| f(p) as f32);
    out.positions = fill(&places, |p| p.mix(mesh, |i| cloud.positions[i].as_dvec3()).as_vec3());
    let normals = fill(&places, |p| match &cloud.normals {
        Some(normals) => p.mix(mesh, |i| normals[i].as_dvec3()).normalize_or_zero().as_vec3(),
        None => faces.normal(p.face).normalize_or_zero().as_vec3(),
    });
    out.closed = cloud.closed
        && points > 0
        && places.iter().zip(&normals).all(|(p, n)| faces.normal(p.face).dot(n.as_dvec3()) > 0.0);
    out.normals = Some(normals);
    out.colors = cloud.colors.as_ref().map(|colors| {
        let linear = |i: usize| DVec3::from(colors[i].map(|byte| decode_table()[byte as usize]));
        fill(&places, |p| p.mix(mesh, linear).to_array().map(|v| (linear_to_srgb(v) * 255.0).round() as u8))
    });
    out.opacity = cloud.opacity.as_ref().map(|list| each(&|p| p.mix(mesh, |i| DVec3::splat(list[i] as f64)).x));
    out.intensity = cloud.intensity.as_ref().map(|list| each(&|p| p.mix(mesh, |i| DVec3::splat(list[i] as f64)).x));
    out.classes = cloud.classes.as_ref().map(|list| fill(&places, |p| list[p.nearest(mesh)]));
    out
}

/// `f` of every place, in order.
fn fill<T: Copy + Default + Send>(places: &[Place], f: impl Fn(&Place) -> T + Sync + Send) -> Vec<T> {
    let mut out = vec![T::default(); places.len()];
    par::fill(&mut out, BLOCK, |first, items| {
        for (item, place) in items.iter_mut().zip(&places[first..]) {
            *item = f(place);
        }
    });
    out
}

/// A place on a mesh: a face and the weights of its corners, which sum to 1.
#[derive(Clone, Copy, Default)]
struct Place {
    face: usize,
    weights: [f64; 3],
}

impl Place {
    fn mix(&self, mesh: &Mesh, of: impl Fn(usize) -> DVec3) -> DVec3 {
        mesh.triangles[self.face].iter().zip(self.weights).map(|(&i, weight)| weight * of(i as usize)).sum()
    }

    /// The corner of the greatest weight.
    fn nearest(&self, mesh: &Mesh) -> usize {
        let [a, b, c] = self.weights;
        let corner = if a >= b && a >= c { 0 } else { 1 + (c > b) as usize };
        mesh.triangles[self.face][corner] as usize
    }
}

/// The faces laid end to end.
struct Faces<'a> {
    positions: &'a [Vec3],
    mesh: &'a Mesh,
    /// Where each face ends, in twice its area \[world units²\].
    ends: Vec<f64>,
    /// How many have no area.
    empty: u64,
    /// The last that has.
    last: usize,
}

impl<'a> Faces<'a> {
    fn new(cloud: &'a PointCloud, mesh: &'a Mesh) -> Faces<'a> {
        let mut faces = Faces { positions: &cloud.positions, mesh, ends: vec![], empty: 0, last: 0 };
        let mut end = 0.0;
        faces.ends.reserve_exact(mesh.triangles.len());
        for face in 0..mesh.triangles.len() {
            let before = end;
            end += faces.normal(face).length();
            // So small that it does not move the end either.
            if end == before {
                faces.empty += 1;
            } else {
                faces.last = face;
            }
            faces.ends.push(end);
        }
        faces
    }

    fn total(&self) -> f64 {
        self.ends.last().copied().unwrap_or(0.0)
    }

    /// Normal of a face, twice its area long.
    fn normal(&self, face: usize) -> DVec3 {
        let [a, b, c] = self.mesh.triangles[face].map(|i| self.positions[i as usize].as_dvec3());
        (b - a).cross(c - a)
    }

    fn places(&self, points: usize, seed: u64) -> Vec<Place> {
        let mut rng = Rng::new(seed);
        let (start, shift) = (rng.unit(), [rng.bits(), rng.bits()]);
        let step = self.total() / points as f64;
        let mut places = vec![Place::default(); points];
        par::fill(&mut places, BLOCK, |first, items| {
            for (i, place) in (first..).zip(items) {
                // The first face that ends beyond; rounding must not lead beyond the last.
                let at = (i as f64 + start) * step;
                place.face = self.ends.partition_point(|&end| end <= at).min(self.last);
                let unit = |axis: usize| {
                    let bits = (i as u64).wrapping_mul(R2[axis]).wrapping_add(shift[axis]);
                    (bits >> 11) as f64 / (1u64 << 53) as f64
                };
                place.weights = triangle(unit(0), unit(1));
            }
        });
        places
    }
}

/// The unit square onto a triangle's weights, equal areas to equal areas (Heitz 2019).
fn triangle(x: f64, y: f64) -> [f64; 3] {
    let (a, b) = if y > x { (0.5 * x, y - 0.5 * x) } else { (x - 0.5 * y, 0.5 * y) };
    [a, b, 1.0 - a - b]
}
