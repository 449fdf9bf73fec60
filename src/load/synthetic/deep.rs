//! A town for whatever leaves out what is hidden: its houses are full of rooms, so that a ray at eye height meets more than
//! fifty surfaces, of which the nearest facade hides all others. A town has one shape a seed, and any number of points.
//!
//! Point i is a function of i alone: pieces of any size, on any number of threads, are the same points. They come house by
//! house, so that neighbours in the list mostly are neighbours in space.

use std::ops::Range;

use glam::{DVec3, dvec3};

use super::Builder;
use crate::load::PointCloud;
use crate::par;
use crate::rng::{Rng, hash};

/// Plots along each side of the town.
const PLOTS: i64 = 18;
/// Side of a plot, half the street round its house, side and height of a room \[world units, as if metres\].
const PLOT: f64 = 12.0;
const STREET: f64 = 1.5;
const ROOM: f64 = 3.0;
/// Rooms along each side of a house.
const ROOMS: i64 = 3;
/// Thickness of outer walls: what is inside does not stick out through them as long as splats are no larger.
const WALL: f64 = 0.6;
/// Where a picture is taken if nobody says otherwise: on a street, at the height of eyes.
pub(in crate::load) const EYE: DVec3 = dvec3(0.0, -93.0, 1.7);
/// Points that are made at a time.
const BLOCK: u64 = 1 << 14;
/// Blocks of them that are made side by side before they are joined.
const BATCH: usize = 16;
/// Points lie anywhere in the middle half of their cell, so no place of it is farther than ¾ √2 = 1.06 of its sides. The rest
/// is for cells that are no squares, since rows and points in a row are whole numbers: of faces of a hundred points and more.
const JITTER: f64 = 0.5;
const COVER: f64 = 1.25;
/// Random numbers of a point: two of its place, one of its colour.
const DRAWS: u64 = 3;

const PLASTER: [DVec3; 6] = [
    dvec3(0.86, 0.78, 0.62),
    dvec3(0.80, 0.62, 0.46),
    dvec3(0.88, 0.85, 0.79),
    dvec3(0.70, 0.48, 0.40),
    dvec3(0.66, 0.71, 0.73),
    dvec3(0.83, 0.70, 0.66),
];

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Street,
    Square,
    Facade,
    Roof,
    Floor,
    Inner,
}

/// A rectangle: corner, two edges along axes, normal, what it is, and a number of its own that varies its colour.
#[derive(Debug, Clone)]
struct Face {
    corner: DVec3,
    edges: [DVec3; 2],
    normal: DVec3,
    kind: Kind,
    number: i64,
}

impl Face {
    fn size(&self) -> [f64; 2] {
        self.edges.map(DVec3::length)
    }

    /// sRGB at `at` from the corner along the two edges.
    fn color(&self, at: [f64; 2], seed: u64) -> DVec3 {
        let pick = hash(self.number, 7, seed);
        let [u, v] = at;
        match self.kind {
            Kind::Street => {
                let out = |t: f64| (t - 0.5 * PLOT).abs();
                let pavement = out(u).max(out(v)) < 0.5 * PLOT - 0.55 * STREET;
                if pavement { dvec3(0.60, 0.58, 0.55) } else { dvec3(0.33, 0.33, 0.35) }
            }
            Kind::Square => {
                let tuft = 0.08 * hash((u * 2.0) as i64, (v * 2.0) as i64, seed ^ self.number as u64);
                dvec3(0.34 + tuft, 0.47 + tuft, 0.22)
            }
            Kind::Facade => self.facade(u, v, pick, seed),
            Kind::Roof if pick < 0.6 => dvec3(0.62, 0.34, 0.25),
            Kind::Roof => dvec3(0.45, 0.44, 0.44),
            Kind::Floor => dvec3(0.62, 0.46, 0.30) * (0.85 + 0.3 * pick),
            Kind::Inner => dvec3(0.90, 0.88, 0.83) - 0.12 * dvec3(pick, 0.5 * pick, 1.0 - pick),
        }
    }

    /// Plaster over a plinth, a ledge at every storey, a window before every room, now and then a door instead.
    fn facade(&self, u: f64, z: f64, pick: f64, seed: u64) -> DVec3 {
        let house = self.number >> 8;
        let plaster = PLASTER[(hash(house, 3, seed) * PLASTER.len() as f64) as usize];
        let (column, storey) = ((u / ROOM) as i64, (z / ROOM) as i64);
        let (x, y) = (u - ROOM * column as f64, z - ROOM * storey as f64);
        let room = hash(self.number * 64 + column, storey, seed);
        let door = storey == 0 && column == (pick * ROOMS as f64) as i64;
        // Distance into an opening from its nearest edge, negative outside.
        let into = |x0: f64, x1: f64, y0: f64, y1: f64| (x - x0).min(x1 - x).min((y - y0).min(y1 - y));
        if door {
            let depth = into(0.9, 2.1, -1.0, 2.2);
            if depth > 0.0 {
                return dvec3(0.36, 0.24, 0.16) * (0.8 + 0.4 * room);
            }
        } else {
            let depth = into(0.8, 2.2, 0.9, 2.4);
            if depth > 0.1 {
                return if room > 0.9 { dvec3(0.93, 0.80, 0.52) } else { dvec3(0.17, 0.22, 0.28) * (0.8 + 0.5 * room) };
            }
            if depth > -0.1 {
                return dvec3(0.93, 0.92, 0.90);
            }
        }
        // Dirt of the street reaches a room high.
        let clean = 0.82 + 0.18 * (z / ROOM).min(1.0);
        match () {
            _ if z < 0.5 => dvec3(0.42, 0.40, 0.38),
            _ if storey > 0 && y < 0.2 => 1.08 * plaster,
            _ => clean * plaster,
        }
    }
}

/// The town, and which points lie on which of its faces.
pub(in crate::load) struct Deep {
    faces: Vec<Face>,
    /// One after the last point of each face.
    ends: Vec<u64>,
    /// Side of the square that each point has of the area.
    spacing: f64,
    seed: u64,
}

impl Deep {
    pub fn new(points: u64, seed: u64) -> Deep {
        let faces = town(seed);
        let areas = faces.iter().map(|f| f.size()[0] * f.size()[1]);
        let total: f64 = areas.clone().sum();
        let mut sum = 0.0;
        let mut ends: Vec<u64> = areas
            .map(|area| {
                sum += area;
                ((points as f64 * (sum / total)) as u64).min(points)
            })
            .collect();
        if let Some(last) = ends.last_mut() {
            *last = points;
        }
        Deep { faces, ends, spacing: (total / points as f64).sqrt(), seed }
    }

    /// These points, in order.
    pub fn points(&self, which: Range<u64>) -> PointCloud {
        let mut out = Builder::new((which.end - which.start) as usize);
        let starts: Vec<u64> = which.clone().step_by(BLOCK as usize).collect();
        for batch in starts.chunks(BATCH) {
            let parts = par::map(batch, |start| self.block(*start..which.end.min(start + BLOCK)));
            parts.into_iter().for_each(|part| out.append(part));
        }
        let mut cloud = out.z_up();
        cloud.viewpoint = Some(EYE);
        cloud
    }

    fn block(&self, which: Range<u64>) -> Builder {
        let mut out = Builder::new((which.end - which.start) as usize);
        let mut at = which.start;
        while at < which.end {
            let number = self.ends.partition_point(|end| *end <= at);
            let first = if number == 0 { 0 } else { self.ends[number - 1] };
            let (face, upto) = (&self.faces[number], self.ends[number].min(which.end));
            let [width, height] = face.size();
            let n = self.ends[number] - first;
            // Rows of equally many points but one: the last is no thinner than the others.
            let rows = ((n as f64 * height / width).sqrt().round() as u64).clamp(1, n);
            let start = |row: u64| (row as u128 * n as u128 / rows as u128) as u64;
            for i in at..upto {
                let mut rng = Rng::new(self.seed).after(DRAWS * i);
                let k = i - first;
                let row = (((k + 1) as u128 * rows as u128 - 1) / n as u128) as u64;
                let mut shift = || 0.5 + JITTER * (rng.unit() - 0.5);
                let u = ((k - start(row)) as f64 + shift()) / (start(row + 1) - start(row)) as f64;
                let v = (row as f64 + shift()) / rows as f64;
                let color = face.color([u * width, v * height], self.seed) + 0.03 * (rng.unit() - 0.5);
                let p = face.corner + u * face.edges[0] + v * face.edges[1];
                out.push(p, face.normal, COVER * self.spacing, color);
            }
            at = upto;
        }
        out
    }
}

/// All faces, plot by plot, there and back again.
fn town(seed: u64) -> Vec<Face> {
    let mut faces = Vec::new();
    for y in 0..PLOTS {
        for step in 0..PLOTS {
            let x = if y % 2 == 0 { step } else { PLOTS - 1 - step };
            let corner = PLOT * (dvec3(x as f64, y as f64, 0.0) - 0.5 * PLOTS as f64 * dvec3(1.0, 1.0, 0.0));
            let kind = hash(x, y, seed);
            let storeys = match () {
                _ if kind < 0.04 => 0,
                _ if kind > 0.95 => 9 + (hash(x, y, !seed) * 4.0) as i64,
                _ => 4 + (hash(x, y, !seed) * 4.0) as i64,
            };
            plot(corner, storeys, (y * PLOTS + x) << 8, &mut faces);
        }
    }
    faces
}

/// Street and house of one plot; without storeys a square.
fn plot(corner: DVec3, storeys: i64, number: i64, out: &mut Vec<Face>) {
    let mut next = number;
    let mut face = |corner: DVec3, edges: [DVec3; 2], normal: DVec3, kind: Kind| {
        out.push(Face { corner, edges, normal, kind, number: next });
        next += 1;
    };
    let ground = if storeys == 0 { Kind::Square } else { Kind::Street };
    face(corner, [PLOT * DVec3::X, PLOT * DVec3::Y], DVec3::Z, ground);
    if storeys == 0 {
        return;
    }
    let (side, top) = (ROOM * ROOMS as f64, ROOM * storeys as f64);
    let low = corner + dvec3(STREET, STREET, 0.0);
    // Two walls across the house, `at` from its corner, that leave out `inset` at their ends.
    let mut walls = |at: f64, inset: f64, normal: f64, kind: Kind| {
        for (across, along) in [(DVec3::X, DVec3::Y), (DVec3::Y, DVec3::X)] {
            let edges = [(side - 2.0 * inset) * along, (top - inset) * DVec3::Z];
            face(low + at * across + inset * along, edges, normal * across, kind);
        }
    };
    walls(0.0, 0.0, -1.0, Kind::Facade);
    walls(side, 0.0, 1.0, Kind::Facade);
    walls(WALL, WALL, 1.0, Kind::Inner);
    walls(side - WALL, WALL, -1.0, Kind::Inner);
    (1..ROOMS).for_each(|i| walls(ROOM * i as f64, WALL, 1.0, Kind::Inner));
    for storey in 1..=storeys {
        let (kind, inset) = if storey == storeys { (Kind::Roof, 0.0) } else { (Kind::Floor, WALL) };
        let at = dvec3(inset, inset, ROOM * storey as f64);
        face(low + at, [DVec3::X, DVec3::Y].map(|axis| (side - 2.0 * inset) * axis), DVec3::Z, kind);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::merge;

    /// Faces that a ray meets, at any distance.
    fn depth(faces: &[Face], eye: DVec3, ray: DVec3) -> usize {
        let meets = |face: &Face| {
            let t = face.normal.dot(face.corner - eye) / face.normal.dot(ray);
            let at = eye + t * ray - face.corner;
            let within = |edge: DVec3| (0.0..=edge.length_squared()).contains(&at.dot(edge));
            t > 0.0 && t.is_finite() && face.edges.into_iter().all(within)
        };
        faces.iter().filter(|face| meets(face)).count()
    }

    #[test]
    fn more_than_fifty_surfaces_lie_behind_most_pixels() {
        for seed in [1, 2] {
            let faces = town(seed);
            // From streets of three sides into the town, over 60° of width, from the horizon to 10° above it.
            for (eye, along) in [
                (EYE, DVec3::Y),
                (dvec3(-84.0, 24.0, 1.7), DVec3::X),
                (dvec3(48.0, 80.0, 1.7), DVec3::NEG_Y),
                (dvec3(-60.0, -72.0, 1.7), (DVec3::X + DVec3::Y).normalize()),
            ] {
                let right = along.cross(DVec3::Z);
                let pixels = (0..24).flat_map(|x| (0..8).map(move |y| (x, y)));
                let ray = |(x, y): (i32, i32)| {
                    let across = 0.577 * (f64::from(x) + 0.5 - 12.0) / 12.0;
                    along + across * right + 0.176 * (f64::from(y) + 0.5) / 8.0 * DVec3::Z
                };
                let mut depths: Vec<usize> = pixels.map(|pixel| depth(&faces, eye, ray(pixel))).collect();
                depths.sort_unstable();
                let median = depths[depths.len() / 2];
                assert!(median > 50, "seed {seed}, from {eye} along {along}: {depths:?}");
            }
        }
    }

    #[test]
    fn pieces_of_any_size_are_the_same_points() {
        let town = Deep::new(100_000, 3);
        let whole = town.points(0..100_000);
        let cuts = [0, 1, 17, 16_384, 40_000, 99_999, 100_000];
        let joined = merge(cuts.windows(2).map(|cut| town.points(cut[0]..cut[1])).collect());
        assert_eq!(whole.positions, joined.positions);
        assert!(whole.normals == joined.normals && whole.colors == joined.colors && whole.radii == joined.radii);
    }

    #[test]
    fn radii_close_the_surface() {
        let points = 400_000;
        let town = Deep::new(points, 1);
        let cloud = town.points(0..points);
        let radius = cloud.radii.expect("radii")[0] as f64;
        let mut rng = Rng::new(9);
        let mut first = 0;
        for (face, end) in town.faces.iter().zip(&town.ends) {
            let own = &cloud.positions[first as usize..*end as usize];
            first = *end;
            for _ in 0..20 {
                let at = face.corner + rng.unit() * face.edges[0] + rng.unit() * face.edges[1];
                let nearest = own.iter().map(|p| p.as_dvec3().distance(at)).fold(f64::INFINITY, f64::min);
                assert!(nearest <= radius, "{at}: {nearest} of {radius}");
            }
        }
    }
}
