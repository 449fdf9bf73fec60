//! A triangle mesh at which rays are cast: boxes in f32 find the triangles, f64 intersects them.
//!
//! # No ray passes between two neighbours
//! Triangles are tested as Woop, Benthin, Wald: Watertight Ray/Triangle Intersection, 2013, in f64: vertices are sheared
//! and scaled so that the ray becomes the axis z, and signs of three edge functions such as C_x B_y − C_y B_x decide.
//! - A vertex gets the same x and y in every triangle that it belongs to: they depend on the ray and the vertex alone.
//! - Rounding keeps order: from a > b follows fl(a) ≥ fl(b). So the computed sign of a difference of two rounded
//!   products is right or zero, never wrong, for those x and y. Zero counts as inside for both neighbours.
//!
//! So what is decided is the exact overlay of the mesh whose vertices were moved by rounding, all triangles alike, plus
//! points on edges: a surface that is closed stays closed. Left out are triangles whose three functions are all zero,
//! seen edge-on: they cover nothing that their neighbours' edges do not.
//!
//! # No box is missed
//! Boxes are kept in a frame in which the mesh fills −1…1 (longest side), as f32, all sides moved out by [`PAD`]. Rays
//! begin where they enter those bounds (computed in f64), so nothing that traversal computes exceeds 2 + 2⁻¹⁸, however
//! far away eye and origin are. With ε = 2⁻²⁴, and the direction's largest component 1, distances along a ray are at most
//! 2 and the computed place of a box's side is off by at most
//! - ε for the ray's origin and ε for the side, rounded to f32;
//! - 5 ε · 2 for direction, its inverse, difference, product, along 2 units;
//! - 2 · 2 ε because directions below 2⁻²³ are taken as 2⁻²³.
//!
//! Together 16 ε = 2⁻²⁰: a quarter of the pad. The exact test's own rounding, 10⁻¹⁶, is nothing beside the rest. The
//! distance of the best hit is rounded up before boxes are compared with it, so that of equally near triangles all are
//! tested and the first in the mesh wins, whatever the tree.

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use obvhs::ray::{Ray, RayHit};
use obvhs::{Boundable, BvhBuildParams};

use crate::color::decode_table;
use crate::load::PointCloud;

/// How far the sides of boxes are moved out, in units of half the mesh's longest side.
const PAD: f64 = 1.0 / (1 << 18) as f64;

/// A mesh, ready for rays: a copy of the cloud's vertices and faces (27 B and 12 B each) and a tree over the faces (about
/// 60 B a face).
#[derive(Debug)]
pub struct Surface {
    /// World position that everything here is relative to.
    pub(super) origin: DVec3,
    positions: Vec<glam::Vec3>,
    triangles: Vec<[u32; 3]>,
    normals: Option<Vec<glam::Vec3>>,
    colors: Option<Vec<[u8; 3]>>,
    tree: Tree,
}

/// The tree's frame: (x − centre) / half lies in −1…1.
struct Tree {
    bvh: Bvh2,
    centre: DVec3,
    half: f64,
}

impl std::fmt::Debug for Tree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tree").field("nodes", &self.bvh.nodes.len()).finish()
    }
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hit {
    /// In lengths of the ray's direction.
    pub t: f64,
    pub triangle: u32,
    /// Of the corners; they sum to 1.
    pub weights: [f64; 3],
}

/// What a tree is made of.
struct Padded(Aabb);

impl Boundable for Padded {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Surface {
    /// The surface of a cloud with faces; `None` for one without.
    ///
    /// Normals are the cloud's: complete it first (`load::attributes::complete`) for ones that are weighted by the faces'
    /// angles. Without, faces are flat. Runs on one thread, about 1 s for 10⁶ faces.
    pub fn new(cloud: &PointCloud) -> Option<Surface> {
        let triangles = cloud.mesh.as_ref().map(|m| m.triangles.clone()).filter(|t| !t.is_empty())?;
        Some(Surface {
            origin: cloud.origin,
            tree: Tree::new(&cloud.positions, &triangles),
            positions: cloud.positions.clone(),
            normals: cloud.normals.clone(),
            colors: cloud.colors.clone(),
            triangles,
        })
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// The nearest triangle that `accept`s being hit at t ≥ `from`; of equally near ones the first. Ray in the surface's
    /// frame. `stack` is room to work in.
    pub(super) fn nearest(
        &self,
        stack: &mut Vec<u32>,
        origin: DVec3,
        direction: DVec3,
        from: f64,
        accept: impl Fn(&Hit) -> bool,
    ) -> Option<Hit> {
        let start = self.tree.entry(origin, direction, from)?;
        let beam = Beam::new(origin + start * direction, direction);
        let (ray, scale) = self.tree.ray(&beam);
        let mut best: Option<Hit> = None;
        stack.clear();
        self.tree.bvh.ray_traverse_dynamic(stack, ray, &mut RayHit::none(), |node, ray, _| {
            for slot in node.first_index..node.first_index + node.prim_count {
                let triangle = self.tree.bvh.primitive_indices[slot as usize];
                let Some(hit) = self.intersect(&beam, triangle) else { continue };
                let nearer = |best: Hit| (hit.t, triangle) < (best.t, best.triangle);
                if hit.t >= 0.0 && best.is_none_or(nearer) && accept(&hit) {
                    // Twice up: once for the rounding, once because boxes must be nearer, not as near.
                    ray.tmax = ((hit.t * scale) as f32).next_up().next_up();
                    best = Some(hit);
                }
            }
            true
        });
        best.map(|hit| Hit { t: start + hit.t, ..hit })
    }

    /// The triangle's hit, whichever side; `None` where the ray passes beside it or along it.
    fn intersect(&self, beam: &Beam, triangle: u32) -> Option<Hit> {
        let [a, b, c] = self.corners(triangle).map(|p| beam.shear(p));
        let (u, v, w) = (c.x * b.y - c.y * b.x, a.x * c.y - a.y * c.x, b.x * a.y - b.y * a.x);
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let sum = u + v + w;
        let weights = [u / sum, v / sum, w / sum];
        (sum != 0.0).then(|| Hit { t: weights[0] * a.z + weights[1] * b.z + weights[2] * c.z, triangle, weights })
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|i| self.positions[i as usize].as_dvec3())
    }

    /// Normal of the face, of any length: counter-clockwise seen from its tip.
    pub(super) fn face_normal(&self, triangle: u32) -> DVec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// Normal at a hit, interpolated, of any length; zero where the vertices have none, or where they cancel.
    pub(super) fn normal(&self, hit: &Hit) -> DVec3 {
        match &self.normals {
            Some(normals) => self.interpolate(hit, |i| normals[i].as_dvec3()),
            None => self.face_normal(hit.triangle),
        }
    }

    /// Colour at a hit, interpolated in linear light; `None` where the cloud has none.
    pub(super) fn color(&self, hit: &Hit) -> Option<DVec3> {
        let (colors, table) = (self.colors.as_ref()?, decode_table());
        Some(self.interpolate(hit, |i| DVec3::from(colors[i].map(|byte| table[byte as usize]))))
    }

    fn interpolate(&self, hit: &Hit, of: impl Fn(usize) -> DVec3) -> DVec3 {
        let corners = self.triangles[hit.triangle as usize];
        corners.iter().zip(hit.weights).map(|(&i, weight)| weight * of(i as usize)).sum()
    }
}

/// A ray for exact tests: the shear that makes it the axis z, with `direction` of length 1 there.
struct Beam {
    origin: DVec3,
    direction: DVec3,
    /// The order of axes that makes the direction's largest component the third.
    axes: [usize; 3],
    shear: DVec3,
}

impl Beam {
    fn new(origin: DVec3, direction: DVec3) -> Beam {
        let z = direction.abs().max_position();
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let d = axes.map(|axis| direction[axis]);
        Beam { origin, direction, axes, shear: DVec3::new(d[0] / d[2], d[1] / d[2], 1.0 / d[2]) }
    }

    fn shear(&self, p: DVec3) -> DVec3 {
        let p = p - self.origin;
        let [x, y, z] = self.axes.map(|axis| p[axis]);
        DVec3::new(x - self.shear.x * z, y - self.shear.y * z, self.shear.z * z)
    }
}

impl Tree {
    fn new(positions: &[glam::Vec3], triangles: &[[u32; 3]]) -> Tree {
        let used = || triangles.iter().flatten().map(|&i| positions[i as usize].as_dvec3());
        let min = used().fold(DVec3::INFINITY, DVec3::min);
        let max = used().fold(DVec3::NEG_INFINITY, DVec3::max);
        let centre = 0.5 * (min + max);
        let half = (0.5 * (max - min).max_element()).max(f64::MIN_POSITIVE);
        let boxes: Vec<Padded> = triangles
            .iter()
            .map(|corners| {
                let corners = corners.map(|i| (positions[i as usize].as_dvec3() - centre) / half);
                let min = corners.into_iter().fold(DVec3::INFINITY, DVec3::min) - PAD;
                let max = corners.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max) + PAD;
                Padded(Aabb::new(min.as_vec3a(), max.as_vec3a()))
            })
            .collect();
        Tree { bvh: bvh(&boxes), centre, half }
    }

    /// The first t ≥ `from` within the bounds; `None` if the ray misses them.
    fn entry(&self, origin: DVec3, direction: DVec3, from: f64) -> Option<f64> {
        let bounds = self.bvh.nodes[0].aabb();
        let (mut start, mut end) = (from, f64::INFINITY);
        for axis in 0..3 {
            // Wider by the pad once more, for the rounding here.
            let sides = [bounds.min[axis] as f64 - PAD, bounds.max[axis] as f64 + PAD];
            let [low, high] = sides.map(|side| self.centre[axis] + self.half * side - origin[axis]);
            if direction[axis] != 0.0 {
                let (a, b) = (low / direction[axis], high / direction[axis]);
                (start, end) = (start.max(a.min(b)), end.min(a.max(b)));
            } else if low > 0.0 || high < 0.0 {
                return None;
            }
        }
        (start <= end).then_some(start)
    }

    /// The beam in the tree's frame, and its lengths there per length of the beam's direction.
    fn ray(&self, beam: &Beam) -> (Ray, f64) {
        let longest = beam.direction.abs().max_element();
        let origin: Vec3A = ((beam.origin - self.centre) / self.half).as_vec3a();
        (Ray::new_inf(origin, (beam.direction / longest).as_vec3a()), longest / self.half)
    }
}

/// The tree over these boxes: as `obvhs` builds it, without its check, which recurses as deep as the tree, in debug builds:
/// thousands of equal boxes make a chain.
fn bvh(boxes: &[Padded]) -> Bvh2 {
    let settings = BvhBuildParams::medium_build();
    let numbers = (0..boxes.len() as u32).collect();
    let mut bvh = PlocBuilder::with_capacity(boxes.len()).build(
        settings.ploc_search_distance,
        boxes,
        numbers,
        settings.sort_precision,
        settings.search_depth_threshold,
    );
    let mut optimizer = ReinsertionOptimizer::default();
    optimizer.run(&mut bvh, settings.reinsertion_batch_ratio, None);
    collapse(&mut bvh, settings.max_prims_per_leaf, settings.collapse_traversal_cost);
    bvh
}

#[cfg(test)]
#[path = "mesh_tests.rs"]
mod tests;
