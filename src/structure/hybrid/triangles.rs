//! A mesh's faces in blocks, largest first.

use glam::{DVec3, Vec3};

use crate::par;
use crate::select::{DrawList, Sight, Span};
use crate::structure::flat::Block;
use crate::structure::morton::Cube;
use crate::structure::{Flat, octahedral};

/// Triangles a block: as many as entries of a list by place, and few enough that boxes are small.
const BLOCK: usize = 4096;

/// Faces, block by block along the Morton curve of their centres, each block by falling size.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangles {
    /// Places, normals and colours of the vertices; radii are of no use here.
    pub vertices: Flat,
    /// Numbers of a face's vertices, counter-clockwise seen from the side that their normals are on.
    pub corners: Vec<[u32; 3]>,
    /// Size of each face \[cloud units\], more than 0: see the module.
    pub sizes: Vec<f32>,
    /// Runs of faces, with boxes of the corners and without a radius.
    pub blocks: Vec<Block>,
}

/// Sizes of faces.
pub(super) fn sizes(vertices: &Flat, faces: &[[u32; 3]]) -> Vec<f32> {
    let side = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|i| vertices.position(i));
        a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a)).sqrt()
    };
    let mut largest = vec![0.0f32; vertices.len()];
    for face in faces {
        let side = side(face);
        face.iter().for_each(|&corner| largest[corner as usize] = largest[corner as usize].max(side));
    }
    faces
        .iter()
        .map(|face| face.map(|corner| largest[corner as usize]).into_iter().fold(f32::INFINITY, f32::min))
        .collect()
}

impl Triangles {
    /// Of faces over these vertices. Those of size 0 are left out.
    pub(super) fn new(vertices: Flat, faces: &[[u32; 3]], sizes: &[f32]) -> Triangles {
        let [low, high] = vertices.bounds().map(|corner| corner.as_vec3());
        let cube = Cube::round(low, high);
        let of = |face: &[u32; 3]| face.map(|i| vertices.position(i));
        let normal =
            |i: u32| vertices.normals.as_ref().and_then(|n| octahedral::decode(n[i as usize])).unwrap_or_default();
        let outside = |face: &[u32; 3]| face.iter().map(|&i| normal(i)).sum::<DVec3>().as_vec3();
        let mut places: Vec<(u64, u32)> = vec![(0, 0); faces.len()];
        par::fill(&mut places, BLOCK, |first, items| {
            for (i, place) in (first..).zip(items) {
                let [a, b, c] = of(&faces[i]);
                *place = (cube.code((a + b + c) / 3.0), i as u32);
            }
        });
        places.retain(|&(_, i)| sizes[i as usize] > 0.0);
        par::sort(&mut places);
        let mut out = Triangles { corners: vec![], sizes: vec![], blocks: vec![], vertices: Flat::default() };
        for run in places.chunks(BLOCK) {
            // Bits of floats from 0 are in their order; ties by number.
            let mut sorted: Vec<(u32, u32)> = run.iter().map(|&(_, i)| (!sizes[i as usize].to_bits(), i)).collect();
            sorted.sort_unstable();
            let first = out.corners.len() as u32;
            let (min, max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            let mut block = Block { first, count: run.len() as u32, min, max, radius: 0.0 };
            for (size, i) in sorted {
                let face = &faces[i as usize];
                let [p, q, r] = of(face);
                for corner in [p, q, r] {
                    (block.min, block.max) = (block.min.min(corner), block.max.max(corner));
                }
                let [a, b, c] = *face;
                let turned = outside(face).dot((q - p).cross(r - p)) < 0.0;
                out.corners.push(if turned { [a, c, b] } else { *face });
                out.sizes.push(f32::from_bits(!size));
            }
            out.blocks.push(block);
        }
        out.vertices = vertices;
        out
    }

    /// Number of faces.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Whether there is no face.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// Bytes of what a device needs: 16 B a face, 20 B a vertex.
    pub fn bytes(&self) -> u64 {
        16 * self.len() as u64 + 20 * self.vertices.len() as u64
    }

    /// Adds what the test of single fragments may let pass: of every block in the picture those faces that are larger than
    /// the threshold somewhere in its box.
    pub fn select(&self, sight: &Sight, instance: u32, list: &mut DrawList) {
        for block in self.blocks.iter().filter(|b| !sight.misses(b.min, b.max, 0.0)) {
            let least = sight.tau * sight.distance(block.min, block.max);
            let sizes = &self.sizes[block.first as usize..][..block.count as usize];
            let count = sizes.partition_point(|size| *size as f64 > least) as u32;
            list.push_triangles(Span { instance, first: block.first, count, least: 0.0 });
        }
    }
}
