//! A room seen from inside: walls that face inwards, furniture that hides things.

use glam::{DVec3, dvec3};

use super::{Builder, Lattice, shares};
use crate::load::PointCloud;
use crate::rng::Rng;

const SIZE: DVec3 = dvec3(8.0, 6.0, 3.0);

/// A rectangle: corner, two edges at right angles, normal, colour, and side of its checks (0: plain).
struct Wall {
    corner: DVec3,
    edges: [DVec3; 2],
    normal: DVec3,
    color: DVec3,
    check: f64,
}

/// The six sides of a box; `outwards` is −1 for one that is seen from inside.
fn sides(min: DVec3, max: DVec3, outwards: f64, color: impl Fn(DVec3) -> (DVec3, f64), out: &mut Vec<Wall>) {
    let size = max - min;
    for axis in 0..3 {
        let mut edges = [DVec3::ZERO; 2];
        edges[0][(axis + 1) % 3] = size[(axis + 1) % 3];
        edges[1][(axis + 2) % 3] = size[(axis + 2) % 3];
        for side in [-1.0, 1.0] {
            let mut corner = min;
            let mut normal = DVec3::ZERO;
            normal[axis] = side * outwards;
            if side > 0.0 {
                corner[axis] = max[axis];
            }
            let (color, check) = color(normal);
            out.push(Wall { corner, edges, normal, color, check });
        }
    }
}

pub(super) fn room(points: usize, seed: u64) -> PointCloud {
    let mut walls = Vec::new();
    let inside = |n: DVec3| match n {
        DVec3::Z => (dvec3(0.55, 0.42, 0.30), 0.5),
        DVec3::NEG_Z => (dvec3(0.93, 0.93, 0.91), 0.0),
        DVec3::X => (dvec3(0.80, 0.72, 0.62), 0.0),
        DVec3::NEG_X => (dvec3(0.58, 0.68, 0.76), 0.0),
        _ => (dvec3(0.86, 0.85, 0.80), 0.0),
    };
    sides(DVec3::ZERO, SIZE, -1.0, inside, &mut walls);
    let boxes = [
        // Cupboard, table and its leg, bench, crates on one another.
        (dvec3(0.0, 0.0, 0.0), dvec3(0.6, 2.2, 2.2), dvec3(0.52, 0.33, 0.20)),
        (dvec3(3.2, 2.3, 0.72), dvec3(5.2, 3.5, 0.78), dvec3(0.70, 0.52, 0.34)),
        (dvec3(4.1, 2.8, 0.0), dvec3(4.3, 3.0, 0.72), dvec3(0.25, 0.25, 0.27)),
        (dvec3(3.2, 5.3, 0.0), dvec3(6.2, 6.0, 0.45), dvec3(0.30, 0.45, 0.40)),
        (dvec3(7.0, 0.3, 0.0), dvec3(7.8, 1.1, 0.8), dvec3(0.75, 0.30, 0.25)),
        (dvec3(7.1, 0.4, 0.8), dvec3(7.6, 0.9, 1.3), dvec3(0.80, 0.62, 0.25)),
    ];
    for (min, max, color) in boxes {
        sides(min, max, 1.0, |_| (color, 0.0), &mut walls);
    }
    let areas: Vec<f64> = walls.iter().map(|w| w.edges[0].length() * w.edges[1].length()).collect();
    let spacing = (areas.iter().sum::<f64>() / points as f64).sqrt();
    let mut out = Builder::new(points);
    let mut rng = Rng::new(seed);
    for (wall, n) in walls.iter().zip(shares(points, &areas)) {
        let (width, height) = (wall.edges[0].length(), wall.edges[1].length());
        let lattice = Lattice::new(n, width, height, 0.5);
        for i in 0..n {
            let (u, v) = lattice.at(i, &mut rng);
            let odd = wall.check > 0.0 && ((u * width / wall.check) as i64 + (v * height / wall.check) as i64) % 2 == 1;
            let color = if odd { 0.72 * wall.color } else { wall.color };
            let p = wall.corner + u * wall.edges[0] + v * wall.edges[1];
            out.push(p, wall.normal, 1.25 * spacing, color + 0.03 * (rng.unit() - 0.5));
        }
    }
    let mut cloud = out.z_up();
    cloud.viewpoint = Some(dvec3(6.4, 4.4, 1.7));
    cloud
}
