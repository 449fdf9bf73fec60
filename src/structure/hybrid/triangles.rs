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
        let (mut sorted_corners, mut sorted_sizes) = (Vec::new(), Vec::new());
        for run in places.chunks(BLOCK) {
            // Bits of floats from 0 are in their order; ties by number.
            let mut sorted: Vec<(u32, u32)> = run.iter().map(|&(_, i)| (!sizes[i as usize].to_bits(), i)).collect();
            sorted.sort_unstable();
            for (size, i) in sorted {
                let face = &faces[i as usize];
                let [p, q, r] = of(face);
                let [a, b, c] = *face;
                let turned = outside(face).dot((q - p).cross(r - p)) < 0.0;
                sorted_corners.push(if turned { [a, c, b] } else { *face });
                sorted_sizes.push(f32::from_bits(!size));
            }
        }
        Triangles::sorted(vertices, sorted_corners, sorted_sizes)
    }

    /// Of faces in their order.
    fn sorted(vertices: Flat, corners: Vec<[u32; 3]>, sizes: Vec<f32>) -> Triangles {
        let block = |(number, run): (usize, &[[u32; 3]])| {
            let (min, max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            let (first, count) = ((number * BLOCK) as u32, run.len() as u32);
            let corners = run.iter().flatten().map(|&i| vertices.position(i));
            let grow = |b: Block, p: Vec3| Block { min: b.min.min(p), max: b.max.max(p), ..b };
            corners.fold(Block { first, count, min, max, radius: 0.0 }, grow)
        };
        let blocks = corners.chunks(BLOCK).enumerate().map(block).collect();
        Triangles { vertices, corners, sizes, blocks }
    }

    /// Of what was stored, if it can have been: a face where it cannot, and why not.
    pub(super) fn stored(
        vertices: Flat,
        corners: Vec<[u32; 3]>,
        sizes: Vec<f32>,
    ) -> Result<Triangles, (usize, &'static str)> {
        if let Some(i) = corners.iter().position(|face| face.iter().any(|&i| i as usize >= vertices.len())) {
            return Err((i, "a face with a corner beyond the last point"));
        }
        for (number, run) in sizes.chunks(BLOCK).enumerate() {
            let falls = |i: usize| run[i] > 0.0 && run[i] < f32::INFINITY && (i == 0 || run[i] <= run[i - 1]);
            if let Some(i) = (0..run.len()).find(|i| !falls(*i)) {
                return Err((number * BLOCK + i, "a face whose size is none, or larger than that before it"));
            }
        }
        Ok(Triangles::sorted(vertices, corners, sizes))
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
