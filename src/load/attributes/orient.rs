//! One side for all normals.
//!
//! Toward the scanner where its place is known. Otherwise propagated over the neighbour graph along a minimum spanning
//! tree of weights 1 − |n·n'| (Hoppe et al. 1992), and each connected component then turned as a whole: upward
//! where its area faces mostly up or down, else outward.
//!
//! The tree is Kruskal's (1956) on edges counted into 256 classes of angle, with a union-find that carries for each
//! point whether it is flipped against its parent: the tree itself is never stored nor walked. About 0.1 µs an edge on
//! one core; by far most edges join what is joined already.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::radii::{K, NO_ONE};

/// What orientation needs of a point.
pub(super) trait Facing: Sync + Send {
    /// Unit normal, or zero.
    fn normal(&self) -> Vec3;
    /// Turns it round.
    fn flip(&mut self);
    /// Up to [`K`] ranks, then [`NO_ONE`].
    fn near(&self) -> &[u32; K];
}

/// Turns each normal to the side that `viewpoint` [same frame as `position`] sees.
pub(super) fn toward<T: Facing>(points: &mut [T], position: impl Fn(usize) -> Vec3 + Sync, viewpoint: DVec3) {
    points.par_iter_mut().enumerate().for_each(|(i, p)| {
        if (viewpoint - position(i).as_dvec3()).dot(p.normal().as_dvec3()) < 0.0 {
            p.flip();
        }
    });
}

/// Makes neighbours agree and turns each component upward or outward. `area` is each point's share of the surface, in
/// any unit. Returns the number of components.
pub(super) fn propagate<T: Facing>(
    points: &mut [T],
    position: impl Fn(usize) -> Vec3 + Sync,
    area: impl Fn(usize) -> f32 + Sync,
    up: Option<Vec3>,
) -> usize {
    let mut forest = Forest::new(points.len());
    for edge in sorted_edges(points) {
        let (i, slot) = (edge as usize / K, edge as usize % K);
        let j = points[i].near()[slot] as usize;
        forest.join(i, j, points[i].normal().dot(points[j].normal()) < 0.0);
    }
    // Component numbers in order of their first point; a root is always its component's first point.
    let mut component = vec![0u32; points.len()];
    let mut sums: Vec<Sums> = Vec::new();
    for i in 0..points.len() {
        let (root, flipped) = forest.find(i);
        if root == i {
            component[i] = sums.len() as u32;
            sums.push(Sums::default());
        } else {
            component[i] = component[root];
        }
        if flipped {
            points[i].flip();
        }
        sums[component[i] as usize].add(position(i).as_dvec3(), points[i].normal().as_dvec3(), f64::from(area(i)));
    }
    drop(forest);
    let turn: Vec<bool> = sums.iter().map(|s| s.faces_inward(up)).collect();
    points.par_iter_mut().zip(&component).for_each(|(p, c)| {
        if turn[*c as usize] {
            p.flip();
        }
    });
    sums.len()
}

/// Each edge of the graph once or twice, as 8 i + slot, flattest first.
fn sorted_edges<T: Facing>(points: &[T]) -> Vec<u32> {
    const NONE: u8 = 255;
    // 4 Gi / 8 points; beyond, the neighbours in the last slots are left out of the graph by the caller's limit.
    assert!(points.len() <= (u32::MAX as usize) / K, "orientation holds up to 2^29 points");
    let class: Vec<[u8; K]> = (0..points.len())
        .into_par_iter()
        .map(|i| {
            let mut class = [NONE; K];
            let n = points[i].normal();
            for (class, &j) in class.iter_mut().zip(points[i].near()) {
                if j == NO_ONE {
                    break;
                }
                let (j, o) = (j as usize, points[j as usize].normal());
                // An edge that both ends know is taken from the smaller rank.
                let twice = j < i && points[j].near().contains(&(i as u32));
                if !twice && n != Vec3::ZERO && o != Vec3::ZERO {
                    // √(1 − cos) is proportional to the angle for small ones: 255 classes of about 0.3 degrees.
                    *class = ((1.0 - n.dot(o).abs()).max(0.0).sqrt() * 254.0) as u8;
                }
            }
            class
        })
        .collect();
    let mut starts = [0usize; 256];
    for c in class.as_flattened() {
        starts[*c as usize] += 1;
    }
    let mut total = 0;
    for s in &mut starts[..NONE as usize] {
        total += std::mem::replace(s, total);
    }
    let mut edges = vec![0u32; total];
    for (at, c) in class.as_flattened().iter().enumerate() {
        if *c != NONE {
            edges[starts[*c as usize]] = at as u32;
            starts[*c as usize] += 1;
        }
    }
    edges
}

/// Disjoint sets with a sign: each entry is (parent << 1) | whether it is flipped against its parent.
struct Forest(Vec<u32>);

impl Forest {
    fn new(n: usize) -> Self {
        Forest((0..n as u32).map(|i| i << 1).collect())
    }

    /// The root, and whether `i` is flipped against it. Halves the path.
    fn find(&mut self, i: usize) -> (usize, bool) {
        let (mut at, mut flipped) = (i, 0);
        loop {
            let up = self.0[at];
            let parent = (up >> 1) as usize;
            if parent == at {
                return (at, flipped == 1);
            }
            let grand = self.0[parent];
            self.0[at] = grand ^ (up & 1);
            flipped ^= self.0[at] & 1;
            at = (grand >> 1) as usize;
        }
    }

    fn join(&mut self, i: usize, j: usize, opposed: bool) {
        let ((a, flip_a), (b, flip_b)) = (self.find(i), self.find(j));
        if a != b {
            let flip = u32::from(flip_a ^ flip_b ^ opposed);
            self.0[a.max(b)] = (a.min(b) as u32) << 1 | flip;
        }
    }
}

/// Area-weighted sums over a component.
#[derive(Default)]
struct Sums {
    area: f64,
    normal: DVec3,
    place: DVec3,
    square: f64,
    flux: f64,
}

impl Sums {
    fn add(&mut self, position: DVec3, normal: DVec3, area: f64) {
        self.area += area;
        self.normal += normal * area;
        self.place += position * area;
        self.square += position.length_squared() * area;
        self.flux += normal.dot(position) * area;
    }

    fn faces_inward(&self, up: Option<Vec3>) -> bool {
        // A quarter of the area net upward or downward: terrain, roofs; not a closed shape.
        let upward = up.map_or(0.0, |up| self.normal.dot(up.as_dvec3()));
        if upward.abs() > 0.25 * self.area {
            return upward < 0.0;
        }
        // Flux of the offset from the centre: for a closed shape three times its volume, whatever the centre.
        let centre = self.place / self.area;
        let spread = (self.square / self.area - centre.length_squared()).max(0.0).sqrt();
        let outward = self.flux - self.normal.dot(centre);
        if outward.abs() > 1e-3 * self.area * spread {
            return outward < 0.0;
        }
        // A plane: neither side is outside, take the positive one.
        let n = self.normal;
        n[n.abs().max_position()] < 0.0
    }
}
