//! Which candidates become a node's samples, and how well they cover the rest.
//!
//! Elimination keeps samples apart: candidates in random order are taken where no sample lies within r of them, neither
//! one of the node's nor one of its ancestors', since all are drawn together. Then r shrinks by a sixth and the others are
//! asked again, until there are enough (dart throwing with a shrinking radius: McCool, Fiume: Hierarchical Poisson Disk
//! Sampling Distributions, 1992). What is left over lies within the last r but one of a sample, which is what the
//! spacing is measured by.

use glam::{IVec3, Vec3, Vec4, ivec3};

use crate::rng::Rng;

/// By how much the radius shrinks from one pass to the next: the number of samples it asks for grows by 1.4 on a surface.
const SHRINK: f32 = 0.84;
/// A grid is filled anew once the radius is less than this share of its cells' half width.
const REFILL: f32 = 0.6;
/// After so many passes what is missing is taken as it comes: it lies at a 4000th of the first radius.
const PASSES: usize = 48;
/// Candidates that the coverage is measured at.
const MEASURED: usize = 1024;
/// What the distance of the farthest point from a sample is multiplied by to be a spacing: on a square grid it is the
/// grid's step, which is what a radius means; splats meet three at a point at ¾ of their radii.
const COVER: f32 = std::f32::consts::SQRT_2;

/// Points in a bucket, which is a cache line.
const BUCKET: usize = 4;

/// Some of the points of a cell, or of several that share a slot; a coordinate after the other, unused ones infinitely far.
#[repr(align(64))]
struct Bucket {
    places: [Vec4; 3],
    count: u32,
    /// More of the same slot.
    next: u32,
}

/// Points in cells that are found by hash. Cells are two radii wide, so that a ball reaches eight at most, most of them empty.
struct Grid {
    radius: f32,
    scale: f32,
    heads: Vec<u32>,
    buckets: Vec<Bucket>,
}

const END: u32 = u32::MAX;

impl Grid {
    fn new<'a>(radius: f32, room: usize, points: impl Iterator<Item = &'a Vec3>) -> Grid {
        let slots = (room / 2).next_power_of_two().max(16);
        let mut grid =
            Grid { radius, scale: 0.5 / radius, heads: vec![END; slots], buckets: Vec::with_capacity(room / 2) };
        points.for_each(|p| grid.insert(*p));
        grid
    }

    fn slot(&self, cell: IVec3) -> usize {
        let hash = |v: i32, by: u32| (v as u32).wrapping_mul(by);
        let mixed = hash(cell.x, 0x9e37_79b1) ^ hash(cell.y, 0x85eb_ca77) ^ hash(cell.z, 0xc2b2_ae3d);
        (mixed ^ mixed >> 15) as usize & (self.heads.len() - 1)
    }

    /// Coordinates beyond what integers hold end in one cell, which costs time only.
    fn cell(&self, p: Vec3) -> IVec3 {
        // `floor` is a call where the processor is not known to have an instruction for it.
        let floor = |v: f32| (v as i32).wrapping_sub(((v as i32 as f32) > v) as i32);
        let v = p * self.scale;
        ivec3(floor(v.x), floor(v.y), floor(v.z))
    }

    fn insert(&mut self, p: Vec3) {
        let slot = self.slot(self.cell(p));
        let head = self.heads[slot];
        let full = |b: &Bucket| b.count as usize == BUCKET;
        let at = match self.buckets.get(head as usize).is_none_or(full) {
            true => {
                self.heads[slot] = self.buckets.len() as u32;
                self.buckets.push(Bucket { places: [Vec4::INFINITY; 3], count: 0, next: head });
                self.buckets.len() - 1
            }
            false => head as usize,
        };
        let bucket = &mut self.buckets[at];
        for axis in 0..3 {
            bucket.places[axis][bucket.count as usize] = p[axis];
        }
        bucket.count += 1;
    }

    /// Square of the distance to the nearest point; right if it is at most `radius`, which is at most the grid's. One
    /// that is less than `enough` will do.
    fn nearest(&self, p: Vec3, radius: f32, enough: f32) -> f32 {
        let (low, high, own) = (self.cell(p - radius), self.cell(p + radius), self.cell(p));
        let other = IVec3::select(own.cmpeq(low), high, low);
        let mut best = f32::INFINITY;
        // The point's own cell first: there most of those lie that are near enough.
        for corner in 0..8 {
            let moved = |axis: usize| corner >> axis & 1 == 1;
            if (0..3).any(|axis| moved(axis) && low[axis] == high[axis]) {
                continue;
            }
            let pick = |axis: usize| if moved(axis) { other[axis] } else { own[axis] };
            let mut at = self.heads[self.slot(ivec3(pick(0), pick(1), pick(2)))];
            while at != END {
                let Bucket { places: [x, y, z], next, .. } = &self.buckets[at as usize];
                let (x, y, z) = (*x - p.x, *y - p.y, *z - p.z);
                best = best.min((x * x + y * y + z * z).min_element());
                if best < enough {
                    return best;
                }
                at = *next;
            }
        }
        best
    }
}

/// What was chosen.
pub(super) struct Chosen {
    /// Indices into the candidates, ascending.
    pub samples: Vec<u32>,
    /// What 99 of 100 points are covered by \[world units\].
    pub spacing: f32,
    /// What all are covered by that were looked at.
    pub most: f32,
    /// Where children begin: the least distance between samples.
    pub radius: f32,
}

/// Takes `wanted` of more candidates. `above` are the ancestors' samples in the same region, `radius` their least
/// distance; `random` takes any, as published. Coordinates are relative to somewhere in the region.
pub(super) fn choose(
    candidates: &[Vec3],
    above: &[Vec3],
    wanted: usize,
    radius: f32,
    random: bool,
    rng: &mut Rng,
) -> Chosen {
    // With each the square of the distance of a sample that was met: most that are too near one now still are when the radius shrinks.
    let mut left: Vec<(u32, f32)> = (0..candidates.len() as u32).map(|i| (i, f32::INFINITY)).collect();
    // Fisher and Yates; modulo's bias is below 2⁻³².
    for i in (1..left.len()).rev() {
        left.swap(i, (rng.bits() % (i as u64 + 1)) as usize);
    }
    let mut samples: Vec<u32> = Vec::with_capacity(wanted);
    let mut radius = if radius > 1e-18 { radius } else { 1e-18 };
    if !random {
        let fill = |radius, samples: &[u32]| {
            let own = samples.iter().map(|i| &candidates[*i as usize]);
            Grid::new(radius, above.len() + wanted, above.iter().chain(own))
        };
        let mut grid = fill(radius, &samples);
        for _ in 0..PASSES {
            if radius < REFILL * grid.radius {
                grid = fill(radius, &samples);
            }
            let square = radius * radius;
            left.retain_mut(|(i, met)| {
                if samples.len() == wanted || *met < square {
                    return true;
                }
                let p = candidates[*i as usize];
                *met = grid.nearest(p, radius, square);
                let taken = *met >= square;
                if taken {
                    grid.insert(p);
                    samples.push(*i);
                }
                !taken
            });
            if samples.len() == wanted {
                break;
            }
            radius *= SHRINK;
        }
    }
    let missing = wanted - samples.len();
    samples.extend(left.drain(..missing.min(left.len())).map(|(i, _)| i));
    let step = left.len().div_ceil(MEASURED).max(1);
    let asked: Vec<Vec3> = left.iter().step_by(step).map(|(i, _)| candidates[*i as usize]).collect();
    let near: Vec<Vec3> = above.iter().copied().chain(samples.iter().map(|i| candidates[*i as usize])).collect();
    // Elimination left nothing farther than the last radius but one; random samples may be anywhere.
    let start = if random { (near.len() as f32).sqrt().recip() } else { radius / SHRINK };
    let mut distances = distances(&asked, &near, start);
    distances.sort_unstable_by(f32::total_cmp);
    let last = distances.len().saturating_sub(1);
    let at = |i: usize| COVER * distances.get(i).copied().unwrap_or(0.0);
    samples.sort_unstable();
    Chosen { samples, spacing: at((last as f32 * 0.99).ceil() as usize), most: at(last), radius }
}

/// Distance of each point from the nearest of `near`, which is not empty.
fn distances(asked: &[Vec3], near: &[Vec3], radius: f32) -> Vec<f32> {
    let mut out = vec![f32::INFINITY; asked.len()];
    let mut radius = radius;
    let mut open: Vec<usize> = (0..asked.len()).collect();
    // Each time twice as far: 200 steps are more than floats have.
    for _ in 0..200 {
        if open.is_empty() {
            break;
        }
        let grid = Grid::new(radius, near.len(), near.iter());
        open.retain(|&i| {
            let found = grid.nearest(asked[i], radius, 0.0).sqrt();
            out[i] = found;
            found > radius
        });
        radius *= 2.0;
    }
    out
}

/// Spacing of points that nothing refines, ascending, of a few of them: what MODEL calls the radius from data, h = d₈ √(π/8) times 1
/// for even samplings to 1.6 for random ones. `own` are among `all`. Empty where they are at one place.
pub(super) fn spacings(own: &[Vec3], all: &[Vec3]) -> Vec<f32> {
    const ASKED: usize = 48;
    const K: usize = 8;
    const CHUNK: usize = 32;
    let step = own.len().div_ceil(ASKED).max(1);
    let mut found: Vec<f32> = Vec::with_capacity(ASKED);
    // A plane a coordinate: distances are computed several at a time.
    let planes = [0, 1, 2].map(|axis| all.iter().map(|q| q[axis]).collect::<Vec<f32>>());
    let chunks = || planes[0].chunks(CHUNK).zip(planes[1].chunks(CHUNK)).zip(planes[2].chunks(CHUNK));
    for p in own.iter().step_by(step) {
        let mut best = [f32::INFINITY; K];
        let mut squares = [0.0; CHUNK];
        for ((x, y), z) in chunks() {
            for (((d, x), y), z) in squares.iter_mut().zip(x).zip(y).zip(z) {
                *d = (x - p.x) * (x - p.x) + (y - p.y) * (y - p.y) + (z - p.z) * (z - p.z);
            }
            // No branch, so that several are compared at a time.
            if !squares[..x.len()].iter().fold(false, |any, d| any | (*d < best[K - 1])) {
                continue;
            }
            for &d in &squares[..x.len()] {
                // Itself and its copies say nothing.
                if d > 0.0 && d < best[K - 1] {
                    let mut at = K - 1;
                    while at > 0 && best[at - 1] > d {
                        best[at] = best[at - 1];
                        at -= 1;
                    }
                    best[at] = d;
                }
            }
        }
        let there = best.iter().filter(|d| d.is_finite()).count();
        if there > 0 {
            let far = best[there - 1].sqrt();
            let h = if there < K { far } else { far * (std::f32::consts::PI / K as f32).sqrt() };
            found.push(h * (2.2 - 1.2 * best[0].sqrt() / h).clamp(1.0, 1.6));
        }
    }
    found.sort_unstable_by(f32::total_cmp);
    found
}

/// The median of [`spacings`]; 0 where there are none.
pub(super) fn density(own: &[Vec3], all: &[Vec3]) -> f32 {
    let found = spacings(own, all);
    found.get(found.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(n: usize, seed: u64) -> Vec<Vec3> {
        let mut rng = Rng::new(seed);
        (0..n).map(|_| Vec3::new(rng.unit() as f32, rng.unit() as f32, 0.0)).collect()
    }

    #[test]
    fn elimination_keeps_samples_apart_and_covers_the_rest() {
        let points = square(4000, 1);
        let chosen = choose(&points, &[], 1000, 1.0, false, &mut Rng::new(2));
        assert_eq!(chosen.samples.len(), 1000);
        let of = |i: &u32| points[*i as usize];
        let pairs = chosen.samples.iter().flat_map(|i| chosen.samples.iter().map(move |j| (i, j)));
        let least = pairs.filter(|(i, j)| i < j).map(|(i, j)| of(i).distance(of(j))).fold(f32::INFINITY, f32::min);
        assert_eq!(least, least.max(chosen.radius), "as far apart as it says");
        // Fewer than 1000 discs of the radius before covered all points, and with them 99 % of the square.
        assert!(chosen.radius > SHRINK * (0.99 / (1000.0 * std::f32::consts::PI)).sqrt(), "{}", chosen.radius);
        let covered = |p: &Vec3| chosen.samples.iter().map(|i| of(i).distance(*p)).fold(f32::INFINITY, f32::min);
        let most = points.iter().map(covered).fold(0.0, f32::max);
        assert!(chosen.most <= COVER * most && chosen.spacing <= chosen.most, "never more than there is");
        let beyond = points.iter().filter(|p| covered(p) > chosen.spacing).count();
        assert!(beyond <= 40, "{beyond} of 4000 are not covered");
        let random = choose(&points, &[], 1000, 1.0, true, &mut Rng::new(2));
        assert!(random.spacing > 1.3 * chosen.spacing, "{} {}", random.spacing, chosen.spacing);
    }

    #[test]
    fn samples_keep_away_from_those_above() {
        let above = square(500, 3);
        let points = square(2000, 4);
        let chosen = choose(&points, &above, 300, 0.05, false, &mut Rng::new(5));
        let near = |i: &u32| above.iter().map(|p| p.distance(points[*i as usize])).fold(f32::INFINITY, f32::min);
        let least = chosen.samples.iter().map(near).fold(f32::INFINITY, f32::min);
        assert!(least >= chosen.radius && chosen.radius > 0.01, "{least} {}", chosen.radius);
    }

    #[test]
    fn points_at_one_place_end() {
        let points = vec![Vec3::ONE; 100];
        let chosen = choose(&points, &[], 10, 1.0, false, &mut Rng::new(1));
        assert_eq!((chosen.samples.len(), chosen.spacing), (10, 0.0));
        assert_eq!(density(&points, &points), 0.0);
    }

    #[test]
    fn density_of_a_grid_is_that_of_its_eight_neighbours() {
        let points: Vec<Vec3> = (0..400).map(|i| Vec3::new((i % 20) as f32, (i / 20) as f32, 0.0)).collect();
        let found = density(&points, &points);
        // The eighth lies at √2, and the first so far that the sampling is even: √2 √(π/8).
        assert!((found - 0.5 * std::f32::consts::PI.sqrt()).abs() < 1e-5, "{found}");
    }
}
