//! Levels of averaged blocks against their definition, point by point: cells by halving and, between, of grids of their own.

use std::collections::{BTreeMap, HashSet};

use glam::{DVec3, DVec4, dvec4};
use surfel::select::{DrawList, Sight};
use surfel::structure::octree::{Options, Preset};
use surfel::structure::{Flat, Octree};

use crate::octree::scan;

/// Of a place's coordinates, in steps of the cube's edge by 2²¹.
type Place = [u64; 3];

const BITS: u32 = 21;

/// A level of a block: cells along its edge, and which points lie in each.
struct Level {
    along: u64,
    cells: Vec<Vec<usize>>,
    /// Points that share no cell.
    alone: HashSet<usize>,
}

/// What is drawn: where, its radius and the least radius, as bits.
type Drawn = [u32; 5];

struct Oracle<'a> {
    flat: &'a Flat,
    places: Vec<Place>,
    side: f32,
    block: usize,
}

impl Oracle<'_> {
    fn new(flat: &Flat, block: usize) -> Oracle<'_> {
        let of = |axis: usize| flat.geometry.iter().map(move |g| g[axis]);
        let low = [0, 1, 2].map(|axis| of(axis).fold(f32::INFINITY, f32::min));
        let high = [0, 1, 2].map(|axis| of(axis).fold(f32::NEG_INFINITY, f32::max));
        let side = [0, 1, 2].map(|axis| high[axis] - low[axis]).into_iter().fold(0.0, f32::max);
        let step = side as f64 / (1u64 << BITS) as f64;
        let place = |g: &[f32; 4]| {
            [0, 1, 2].map(|axis| (((g[axis] as f64 - low[axis] as f64) / step) as u64).min((1 << BITS) - 1))
        };
        Oracle { flat, places: flat.geometry.iter().map(place).collect(), side, block }
    }

    /// Points by cell of a grid over the cell of a depth in which they all lie.
    fn cells(&self, points: &[usize], depth: u32, along: u64) -> Vec<Vec<usize>> {
        let mut cells = BTreeMap::<[u64; 3], Vec<usize>>::new();
        for &i in points {
            let cell = self.places[i].map(|v| (v % (1 << (BITS - depth))) * along / (1 << (BITS - depth)));
            cells.entry(cell).or_default().push(i);
        }
        cells.into_values().collect()
    }

    /// Levels of a block: those of the octree, and one between two where half of the points share cells at the coarser.
    fn levels(&self, points: &[usize], depth: u32) -> Vec<Level> {
        let mut levels: Vec<Level> = Vec::new();
        for half in 0u32.. {
            // The whole number nearest to the root of 2 to that.
            let along = (1 << (half / 2)..).find(|n: &u64| (2 * n + 1).pow(2) > 4 << half).expect("a whole number");
            let cells = self.cells(points, depth, along);
            let alone = cells.iter().filter(|cell| cell.len() == 1).map(|cell| cell[0]).collect();
            let level = Level { along, cells, alone };
            let shared = |level: &Level| points.len() - level.alone.len();
            let crowded = |level: &Level| 2 * shared(level) >= points.len();
            if half.is_multiple_of(2)
                || half > 1 && levels.last().is_some_and(|l| l.along.is_power_of_two() && crowded(l))
            {
                let done = half.is_multiple_of(2) && shared(&level) == 0;
                levels.push(level);
                if done {
                    break;
                }
            }
        }
        levels
    }

    fn point(&self, i: usize, least: f32) -> Drawn {
        let [x, y, z, r] = self.flat.geometry[i];
        [x, y, z, r, least].map(f32::to_bits)
    }

    /// As large as the cell, and as the largest of them.
    fn average(&self, points: &[usize], side: f32, least: f32) -> Drawn {
        let radius = points.iter().map(|&i| self.flat.geometry[i][3]).fold(side, f32::max);
        let sum: DVec3 = points.iter().map(|&i| self.flat.position(i as u32).as_dvec3()).sum();
        let [x, y, z] = (sum / points.len() as f64).as_vec3().to_array();
        [x, y, z, radius, least].map(f32::to_bits)
    }

    /// What is drawn of a cell where cells may be so large. Returns how many grids that are not the octree's were used.
    fn draw(&self, points: &[usize], depth: u32, spacing: f64, out: &mut Vec<Drawn>) -> usize {
        let side = self.side / (1u64 << depth) as f32;
        if side as f64 <= spacing {
            out.push(self.average(points, side, side));
            return 0;
        }
        if points.len() > self.block {
            let children = self.cells(points, depth, 2);
            return children.iter().map(|child| self.draw(child, depth + 1, spacing, out)).sum();
        }
        let levels = self.levels(points, depth);
        let own = |i: usize| levels.iter().rposition(|level| !level.alone.contains(&i)).map_or(0, |last| last + 1);
        let owns: BTreeMap<usize, usize> = points.iter().map(|&i| (i, own(i))).collect();
        let suffices = |level: &Level| side as f64 / level.along as f64 <= spacing;
        let deepest = *owns.values().max().expect("a point");
        let at = levels.iter().position(suffices).unwrap_or(deepest).min(deepest);
        if at == deepest {
            out.extend(points.iter().map(|&i| self.point(i, 0.0)));
            return 0;
        }
        let least = side / levels[at].along as f32;
        let mut stood_for = 0;
        for cell in &levels[at].cells {
            let finer = cell.iter().filter(|i| owns[i] > at).count();
            assert!(finer == cell.len() || cell.len() == 1, "who is not alone is of a finer level");
            stood_for += cell.len();
            out.push(if finer > 0 { self.average(cell, least, least) } else { self.point(cell[0], least) });
        }
        assert_eq!(stood_for, points.len(), "each is stood for once");
        !levels[at].along.is_power_of_two() as usize
    }
}

fn drawn(octree: &Octree, spacing: f64) -> Vec<Drawn> {
    // Without perspective all are as far away.
    let mut sight = Sight { eye: dvec4(0.0, 0.0, 1.0, 0.0), tau: 1.0, planes: [DVec4::W; 5], radius_scale: 1.0 };
    sight.tau = spacing / sight.distance(glam::Vec3::ZERO, glam::Vec3::ONE);
    let mut list = DrawList::default();
    octree.select(&sight, 0, &mut list);
    let entries = |span: &surfel::select::Span| {
        let least = span.least;
        (span.first..span.first + span.count).map(move |i| (i, least)).collect::<Vec<_>>()
    };
    let of = |(i, least): (u32, f32)| {
        let [x, y, z, r] = octree.flat.geometry[i as usize];
        [x, y, z, r, least].map(f32::to_bits)
    };
    list.spans.iter().flat_map(entries).map(of).collect()
}

/// Points of many sizes, with others very near by, which cells part at one level and join at the next.
fn pairs(n: usize, seed: u64) -> Flat {
    let mut flat = scan(n, seed);
    flat.geometry.iter_mut().enumerate().for_each(|(i, g)| g[3] *= (i * i % 17) as f32 + 0.5);
    for i in (0..n - 1).step_by(7) {
        let near = flat.geometry[i].map(|v| v + 1e-4 * (1 + i % 13) as f32);
        flat.geometry[i + 1][..3].copy_from_slice(&near[..3]);
    }
    flat
}

#[test]
fn what_is_drawn_of_a_block_is_what_the_definition_says() {
    for (flat, block) in [(scan(1500, 21), 4000), (scan(3000, 22), 200), (pairs(2000, 23), 300)] {
        let octree = Octree::build(&flat, &Options { block: block as u32, ..Options::new(Preset::Espt) });
        let oracle = Oracle::new(&flat, block);
        let all: Vec<usize> = (0..flat.len()).collect();
        let (mut between, mut submitted) = (0, Vec::new());
        for step in 0..60 {
            // No spacing is a cell's side.
            let spacing = oracle.side as f64 * 1.37 * (-0.2 * step as f64).exp2();
            let (mut expected, mut found) = (Vec::new(), drawn(&octree, spacing));
            between += oracle.draw(&all, 0, spacing, &mut expected);
            expected.sort_unstable();
            found.sort_unstable();
            assert!(found == expected, "{block}, {spacing}: {} drawn and {}", found.len(), expected.len());
            submitted.push(found.len());
        }
        assert!(between > 3, "{block}: {between}");
        assert!(submitted[0] == 1 && submitted[59] > flat.len() * 9 / 10, "{submitted:?}");
    }
}

#[test]
fn levels_of_points_are_those_they_are_drawn_at() {
    let flat = pairs(2000, 24);
    let octree = Octree::build(&flat, &Options { block: 5000, ..Options::new(Preset::Espt) });
    let oracle = Oracle::new(&flat, 5000);
    let all: Vec<usize> = (0..flat.len()).collect();
    let levels = oracle.levels(&all, 0);
    // In half octaves.
    let number = |level: &Level| (2.0 * (level.along as f64).log2()).round() as u8;
    let colors = octree.flat.colors.as_ref().expect("colours");
    let of = octree.levels();
    let mut odd = 0;
    for (i, color) in colors.iter().enumerate().rev().take(flat.len()) {
        let point = (color & 0x00ff_ffff) as usize;
        let last = levels.iter().rposition(|level| !level.alone.contains(&point));
        let expected = last.map_or(0, |last| number(&levels[last + 1]));
        assert_eq!(of[i], expected, "point {point}");
        odd += of[i] as usize % 2;
    }
    assert!(odd > 200, "{odd}");
}
