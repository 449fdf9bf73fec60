//! The tree against all triangles, and whether anything leaks.

use glam::{DVec3, Vec3, dvec3};

use super::*;
use crate::load::{Mesh, PointCloud};

/// Uniform in −1…1 (PCG's multiplier, upper bits).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as f64 / (1u64 << 30) as f64 - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        dvec3(self.next(), self.next(), self.next())
    }
}

fn surface(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Surface {
    Surface::new(&PointCloud { positions, mesh: Some(Mesh { triangles }), ..Default::default() }).unwrap()
}

/// The same question put to every triangle. Returns how many of them are hit, too.
fn all(surface: &Surface, origin: DVec3, direction: DVec3, from: f64) -> (Option<Hit>, usize) {
    let Some(start) = surface.tree.entry(origin, direction, from) else { return (None, 0) };
    let beam = Beam::new(origin + start * direction, direction);
    let hits = (0..surface.triangles() as u32).filter_map(|t| surface.intersect(&beam, t)).filter(|h| h.t >= 0.0);
    let hits: Vec<Hit> = hits.collect();
    // min_by keeps the first of equals.
    let best = hits.iter().min_by(|a, b| a.t.total_cmp(&b.t)).map(|h| Hit { t: start + h.t, ..*h });
    (best, hits.len())
}

/// Soups of all sizes and places: wide triangles, needles, points, some on each other, in tiny, huge and flat boxes.
#[test]
fn the_tree_finds_what_all_triangles_find() {
    let mut random = Random(1);
    let (mut hit, mut missed) = (0, 0);
    for (scale, offset, flat) in
        [(1.0, 0.0, 1.0), (1e-6, 0.0, 1.0), (1e6, 0.0, 1.0), (3.0, 1e4, 1.0), (1.0, 0.0, 0.0), (1e-15, 0.0, 1e-3)]
    {
        let place = |v: DVec3| (offset + scale * v * dvec3(1.0, 1.0, flat)).as_vec3();
        let mut positions = vec![];
        for i in 0..300 {
            let (centre, size) = (random.vector(), 10f64.powf(2.0 * random.next() - 1.5));
            let long = random.vector();
            for _ in 0..3 {
                let away = if i % 3 == 0 { long * random.next() + 1e-4 * random.vector() } else { random.vector() };
                positions.push(place(centre + size * away));
            }
        }
        let mut triangles: Vec<[u32; 3]> = (0..300).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        triangles.extend((0..20).map(|i| [6 * i + 1, 6 * i + 2, 6 * i]));
        triangles.extend([[5, 5, 5], [7, 8, 7]]);
        let surface = surface(positions, triangles);
        for i in 0..1500 {
            // From near and from 10⁴ times as far; axis-parallel directions too, where inverses are infinite.
            let from = offset + scale * if i % 2 == 0 { 2.0 } else { 1e4 } * random.vector();
            let mut to = offset + scale * random.vector() * dvec3(1.0, 1.0, flat);
            match i % 5 {
                0 => (to.y, to.z) = (from.y, from.z),
                1 => to.x = from.x,
                _ => {}
            }
            let start = if i % 7 == 0 { 0.9 } else { 0.0 };
            let (expected, _) = all(&surface, from, to - from, start);
            let found = surface.nearest(&mut vec![], from, to - from, start, |_| true);
            assert_eq!(found, expected, "scale {scale}, offset {offset}, ray {i}");
            hit += expected.is_some() as u32;
            missed += expected.is_none() as u32;
        }
    }
    assert!(hit > 2000 && missed > 1000, "{hit} hit, {missed} missed");
}

/// A bumpy closed surface about the centre, `rings` × `sectors`, with needles at the poles.
fn closed(rings: u32, sectors: u32) -> Surface {
    let sphere = crate::load::synthetic::sphere_mesh(rings, sectors);
    let mut random = Random(2);
    let positions = sphere.positions.iter().map(|p| *p * (1.0 + 0.2 * random.next()) as f32).collect();
    surface(positions, sphere.mesh.unwrap().triangles)
}

/// From the centre every ray must meet the surface, also exactly through its vertices and along its edges.
#[test]
fn no_ray_leaves_a_closed_surface() {
    let surface = closed(100, 200);
    let mut random = Random(3);
    let mut stack = vec![];
    let vertices = surface.positions.clone();
    for i in 0..60_000 {
        let (a, b) = (vertices[i % vertices.len()].as_dvec3(), vertices[(i + 1) % vertices.len()].as_dvec3());
        // Anywhere; at a vertex; on an edge and a rounding beside it.
        let direction = match i % 4 {
            0 => random.vector(),
            1 => a,
            2 => a + (b - a) * (0.5 + 0.5 * random.next()),
            _ => a + 1e-16 * random.vector(),
        };
        let eye = if i % 3 == 0 { 1e-3 * random.vector() } else { DVec3::ZERO };
        assert!(surface.nearest(&mut stack, eye, direction, 0.0, |_| true).is_some(), "ray {i} along {direction}");
    }
}

/// A ray from afar that meets a closed surface enters as often as it leaves.
#[test]
fn what_enters_leaves() {
    let surface = closed(20, 30);
    let mut random = Random(4);
    let mut through = 0;
    for i in 0..3000 {
        let (eye, target) = (1e3 * random.vector(), 0.4 * random.vector());
        let (nearest, hits) = all(&surface, eye, target - eye, 0.0);
        assert!(nearest.is_some() && hits % 2 == 0, "ray {i}: {hits} hits");
        through += hits;
    }
    assert!(through > 6000);
}

/// The tie rule: the same triangle many times over, deep trees of equal boxes.
#[test]
fn of_equally_near_triangles_the_first_is_hit() {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.0, 0.0, -0.5)];
    let surface = surface(positions, vec![[0, 1, 3]].into_iter().chain(vec![[0, 1, 2]; 3000]).collect());
    let hit = surface.nearest(&mut vec![], dvec3(0.25, 0.25, 3.0), dvec3(0.0, 0.0, -2.0), 0.0, |_| true).unwrap();
    assert_eq!((hit.t, hit.triangle, hit.weights), (1.5, 1, [0.5, 0.25, 0.25]));
    let hit = surface.nearest(&mut vec![], dvec3(0.25, 0.25, 3.0), dvec3(0.0, 0.0, -2.0), 0.0, |h| h.triangle > 4);
    assert_eq!(hit.unwrap().triangle, 5);
}

#[test]
fn a_cloud_without_faces_is_no_surface() {
    assert!(Surface::new(&PointCloud { positions: vec![Vec3::ZERO], ..Default::default() }).is_none());
}
