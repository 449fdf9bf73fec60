//! Normals and radii from a mesh's faces, and whether it is closed.
//!
//! Normals are weighted by the faces' angles at the vertex (Thürmer and Wüthrich, *Computing Vertex Normals from
//! Polygonal Facets*, 1998): unlike area weights they do not depend on how a flat part is cut into triangles.
//!
//! Radii: r = max(¾ · longest edge at the vertex, √(a third of the area around it)).
//! - The first term covers. Let v be the vertex of a triangle that is nearest to a point x of it, and q the longer of
//!   the triangle's two sides at v. Then |x − v| ≤ q / √2: the worst x is the circumcentre (acute: its radius is
//!   q / (2 sin) of the second-largest angle, which is at least 45°) or lies on the far side (obtuse at v; less than for
//!   the right angle, where it is √(p² + q²) / 2). The margin up to ¾ keeps the worst x off the rim: u ≤ 0.943.
//! - The second is the density spacing of evenly sampled meshes, at which the weights of neighbours sum to about 1.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::load::Mesh;

/// What the faces say of one vertex.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Vertex {
    /// Angle-weighted unit normal; zero without a face that has an area.
    pub normal: Vec3,
    /// Covering radius \[world units\]; 0 without a face that has an edge.
    pub radius: f32,
}

/// Gathers, for each vertex, the faces around it; always in the order of the faces, so that sums never depend on
/// threads.
pub(super) fn vertices(positions: &[Vec3], mesh: &Mesh) -> Vec<Vertex> {
    let (starts, corners) = corners(positions.len(), mesh);
    (0..positions.len())
        .into_par_iter()
        .map(|v| {
            let p = positions[v].as_dvec3();
            let (mut normal, mut longest, mut area) = (DVec3::ZERO, 0.0f64, 0.0);
            for &corner in &corners[starts[v] as usize..starts[v + 1] as usize] {
                let [a, b] = edges(positions, mesh, corner, p);
                let cross = a.cross(b);
                let twice = cross.length();
                longest = longest.max(a.length()).max(b.length());
                area += twice / 6.0;
                if twice > 0.0 {
                    normal += cross / twice * twice.atan2(a.dot(b));
                }
            }
            Vertex { normal: normal.normalize_or_zero().as_vec3(), radius: (0.75 * longest).max(area.sqrt()) as f32 }
        })
        .collect()
}

/// Edge vectors from vertex `p`, which is corner `corner % 3` of face `corner / 3`, to the next corner and the last.
fn edges(positions: &[Vec3], mesh: &Mesh, corner: u32, p: DVec3) -> [DVec3; 2] {
    let t = mesh.triangles[corner as usize / 3];
    let c = corner as usize % 3;
    [t[(c + 1) % 3], t[(c + 2) % 3]].map(|i| positions[i as usize].as_dvec3() - p)
}

/// For each vertex the corners (3 · face + corner) that lie at it: where they start, and all of them.
fn corners(n: usize, mesh: &Mesh) -> (Vec<u32>, Vec<u32>) {
    let indices = mesh.triangles.as_flattened();
    assert!(u32::try_from(indices.len()).is_ok(), "a mesh holds fewer than 2^32 / 3 faces");
    let mut starts = vec![0u32; n + 1];
    for &v in indices {
        starts[v as usize] += 1;
    }
    let mut total = 0;
    for s in &mut starts {
        total += std::mem::replace(s, total);
    }
    let mut corners = vec![0u32; indices.len()];
    for (corner, &v) in indices.iter().enumerate() {
        corners[starts[v as usize] as usize] = corner as u32;
        starts[v as usize] += 1;
    }
    // Each start has moved to its end: the start of the next.
    starts.copy_within(0..n, 1);
    starts[0] = 0;
    (starts, corners)
}

/// Whether what faces away is always hidden: every point has a face, every edge exactly two, once in each direction,
/// every connected part encloses a positive volume, and every normal is on its faces' outer side.
pub(super) fn closed(positions: &[Vec3], mesh: &Mesh, normals: &[Vec3], vertices: &[Vertex]) -> bool {
    let along = |v: usize| normals[v].dot(vertices[v].normal) > 0.0;
    if mesh.triangles.is_empty() || positions.len() >= 1 << 31 || !(0..positions.len()).into_par_iter().all(along) {
        return false;
    }
    // Smaller end, larger end, direction: the two directions of an edge are neighbours once sorted.
    let mut edges: Vec<u64> = mesh
        .triangles
        .par_iter()
        .flat_map_iter(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        .map(|(a, b)| u64::from(a.min(b)) << 33 | u64::from(a.max(b)) << 1 | u64::from(a > b))
        .collect();
    edges.par_sort_unstable();
    let (pairs, rest) = edges.as_chunks::<2>();
    let paired = pairs.par_iter().all(|&[a, b]| a & 1 == 0 && b == a + 1);
    let distinct = pairs.par_windows(2).all(|w| w[0][1] != w[1][1]);
    rest.is_empty() && paired && distinct && parts_enclose(positions, pairs, mesh)
}

/// Whether each connected part's signed volume is positive, by more than rounding.
fn parts_enclose(positions: &[Vec3], edges: &[[u64; 2]], mesh: &Mesh) -> bool {
    let mut parent: Vec<u32> = (0..positions.len() as u32).collect();
    fn find(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for [edge, _] in edges {
        let a = find(&mut parent, (edge >> 33) as u32);
        let b = find(&mut parent, (edge >> 1) as u32);
        parent[a.max(b) as usize] = a.min(b);
    }
    let mut volume = vec![(0.0f64, 0.0f64); positions.len()];
    for t in &mesh.triangles {
        let root = find(&mut parent, t[0]) as usize;
        // About a vertex of the part itself, so that its distance from the origin cancels nothing.
        let [a, b, c] = t.map(|i| positions[i as usize].as_dvec3() - positions[root].as_dvec3());
        let (signed, sum) = &mut volume[root];
        *signed += a.cross(b).dot(c);
        *sum += a.length() * b.length() * c.length();
    }
    // A sheet seen from both sides encloses nothing; its sum's rounding is far below this.
    mesh.triangles.iter().all(|t| {
        let (signed, sum) = volume[find(&mut parent, t[0]) as usize];
        signed > 1e-12 * sum
    })
}
