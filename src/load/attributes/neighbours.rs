//! Exact k-nearest neighbours of every point of a cloud at once.
//!
//! A balanced k-d tree (Bentley 1975) with leaves of up to 16 points, split at the median along the longest side, so
//! that neither density (LiDAR: 100 : 1) nor a far outlier costs depth. All points of a leaf are searched together
//! (a block query): from their own leaf upwards, visiting at each level the sibling's subtree while its box is nearer
//! than the worst of the block's k-th distances. Most of the visited leaves are shared by the block, stay in cache and
//! are compared 16 points at a time.
//!
//! 1. Coincident points are merged before the build (one sort of 128-bit keys: three coordinates and the index), so
//!    that a hundred thousand copies of a point cost no more than one, and no distance between two distinct points is
//!    zero (unless its square underflows: spacings below 1e-19).
//! 2. A subtree is skipped when its box is *not nearer* than the k-th neighbour found so far: rounding is monotonic and
//!    both distances are summed in the same order, so this never loses a nearer point. Among neighbours at exactly the
//!    same distance, which ones are kept follows from the tree alone: the same for any number of threads.
//!
//! Memory: about 40 bytes a distinct point, 16 more while building. Distances are f32; squares that overflow count as
//! `f32::MAX`.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

/// Points in a leaf: a power of two, and one cache line a coordinate.
const LEAF: usize = 16;
/// Leaves that one task searches, about 4 ms of work.
const TASK_LEAVES: usize = 128;
/// Below this many points a subtree is built by one thread.
const SERIAL_BUILD: usize = 1 << 13;

/// Most neighbours that a search can be asked for.
pub const MAX_NEIGHBOURS: usize = 32;
/// For up to so many, which is what radii take, there is code of its own.
const FEW: usize = 16;

/// A neighbour: how far, and which distinct point. Ordered by distance, then rank.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Neighbour(u64);

impl Neighbour {
    const NONE: Neighbour = Neighbour((f32::INFINITY.to_bits() as u64) << 32 | u32::MAX as u64);

    /// Non-negative floats order as their bits do, so one integer comparison orders by distance, then rank.
    fn new(distance_squared: f32, rank: usize) -> Self {
        Neighbour((distance_squared.to_bits() as u64) << 32 | rank as u64)
    }

    /// Squared distance [world units²].
    pub fn distance_squared(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    /// Rank of the point in its [`Tree`].
    pub fn rank(self) -> usize {
        self.0 as u32 as usize
    }

    /// The same order again: doubles of these bits are finite and not negative. Of two doubles the lesser is one instruction, for
    /// several pairs at a time, which it is not for integers.
    fn before(self, other: Neighbour) -> bool {
        f64::from_bits(self.0) < f64::from_bits(other.0)
    }

    fn nearer(self, other: Neighbour) -> Neighbour {
        if self.before(other) { self } else { other }
    }

    fn farther(self, other: Neighbour) -> Neighbour {
        if other.before(self) { self } else { other }
    }
}

#[derive(Debug, Clone, Copy)]
struct Item {
    position: [f32; 3],
    id: u32,
}

#[derive(Debug, Clone, Copy)]
struct Bounds {
    min: [f32; 3],
    max: [f32; 3],
}

impl Bounds {
    fn of(items: &[Item]) -> Self {
        let mut b = Bounds { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };
        for item in items {
            for a in 0..3 {
                b.min[a] = b.min[a].min(item.position[a]);
                b.max[a] = b.max[a].max(item.position[a]);
            }
        }
        b
    }

    fn union(&self, o: &Bounds) -> Self {
        Bounds {
            min: std::array::from_fn(|a| self.min[a].min(o.min[a])),
            max: std::array::from_fn(|a| self.max[a].max(o.max[a])),
        }
    }

    fn longest_axis(&self) -> usize {
        let side: [f32; 3] = std::array::from_fn(|a| self.max[a] - self.min[a]);
        if side[0] >= side[1] && side[0] >= side[2] {
            0
        } else if side[1] >= side[2] {
            1
        } else {
            2
        }
    }

    fn distance_squared(&self, o: &Bounds) -> f32 {
        let d: [f32; 3] = std::array::from_fn(|a| (self.min[a] - o.max[a]).max(o.min[a] - self.max[a]).max(0.0));
        length_squared(d)
    }

    fn distance_squared_to(&self, p: &[f32; 3]) -> f32 {
        let d: [f32; 3] = std::array::from_fn(|a| (self.min[a] - p[a]).max(p[a] - self.max[a]).max(0.0));
        length_squared(d)
    }
}

fn length_squared(d: [f32; 3]) -> f32 {
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).min(f32::MAX)
}

/// The coordinates of a leaf's points, side by side; lanes past the leaf's length hold zeros.
#[derive(Debug, Clone, Copy)]
struct Leaf([[f32; LEAF]; 3]);

/// A cloud's distinct points in tree order: neighbours in space are mostly neighbours in rank.
#[derive(Debug)]
pub struct Tree {
    items: Vec<Item>,
    leaves: Vec<Leaf>,
    /// Heap order: the root is 1, the children of i are 2i and 2i + 1, leaf l is `leaves.len() + l`.
    bounds: Vec<Bounds>,
    copies: Vec<[u32; 2]>,
}

impl Tree {
    /// Builds the tree in O(n log n). Positions are finite and fewer than 2³¹.
    pub fn new(positions: &[Vec3]) -> Self {
        assert!(positions.len() < 1 << 31, "a tree holds fewer than 2^31 points");
        let (mut items, copies) = distinct(positions);
        let n = items.len();
        let depth = n.div_ceil(LEAF).next_power_of_two().trailing_zeros();
        if n > 0 {
            split(&mut items, n, 0, 0, depth);
        }
        let count = 1usize << depth;
        let range = |l: usize| part(n, depth, l)..part(n, depth, l + 1);
        let leaves = (0..count)
            .into_par_iter()
            .map(|l| {
                let mut leaf = Leaf([[0.0; LEAF]; 3]);
                for (i, item) in items[range(l)].iter().enumerate() {
                    for a in 0..3 {
                        leaf.0[a][i] = item.position[a];
                    }
                }
                leaf
            })
            .collect();
        let mut bounds = vec![Bounds::of(&[]); 2 * count];
        bounds[count..].par_iter_mut().enumerate().for_each(|(l, b)| *b = Bounds::of(&items[range(l)]));
        for level in (0..depth).rev() {
            let (upper, lower) = bounds.split_at_mut(2 << level);
            let parents = upper[1 << level..].par_iter_mut();
            parents.zip(lower.par_chunks(2)).for_each(|(p, c)| *p = c[0].union(&c[1]));
        }
        Tree { items, leaves, bounds, copies }
    }

    /// Number of distinct points.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether there is no point at all.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// Position of the point of this rank [as given].
    pub fn position(&self, rank: usize) -> Vec3 {
        self.items[rank].position.into()
    }

    /// Index in the cloud of the point of this rank: of coincident points, the first.
    pub fn index(&self, rank: usize) -> usize {
        self.items[rank].id as usize
    }

    /// The coincident points that were merged: [index of the copy, index of the first], sorted by place, then index.
    pub fn copies(&self) -> &[[u32; 2]] {
        &self.copies
    }

    /// Frees what only the search needs (half of the memory); `search` must not be called again.
    pub(super) fn end_search(&mut self) {
        self.leaves = Vec::new();
        self.bounds = Vec::new();
    }

    /// Finds the `k` ≤ [`MAX_NEIGHBOURS`] nearest other distinct points of every point, or as many as there are, sorted
    /// by distance. `visit` gets each point's rank, its neighbours, and its own element of `out` (as long as the tree,
    /// in order of rank). `done` is told now and then how many more points are finished.
    ///
    /// All cores; neither the order of visits nor the thread count can be seen in `out` if `visit` is pure.
    pub fn search<T: Send>(
        &self,
        k: usize,
        out: &mut [T],
        visit: impl Fn(usize, &[Neighbour], &mut T) + Sync,
        done: impl Fn(usize) + Sync,
    ) {
        assert!((1..=MAX_NEIGHBOURS).contains(&k) && out.len() == self.len());
        if !self.is_empty() {
            self.search_leaves(0, self.leaves.len(), k, out, &visit, &done);
        }
    }

    fn search_leaves<T: Send>(
        &self,
        first: usize,
        last: usize,
        k: usize,
        out: &mut [T],
        visit: &(impl Fn(usize, &[Neighbour], &mut T) + Sync),
        done: &(impl Fn(usize) + Sync),
    ) {
        if last - first > TASK_LEAVES {
            let middle = first.midpoint(last);
            let (a, b) = out.split_at_mut(self.start(middle) - self.start(first));
            rayon::join(
                || self.search_leaves(first, middle, k, a, visit, done),
                || self.search_leaves(middle, last, k, b, visit, done),
            );
            return;
        }
        if k <= FEW {
            self.search_blocks::<T, FEW>(first..last, k, out, visit)
        } else {
            self.search_blocks::<T, MAX_NEIGHBOURS>(first..last, k, out, visit)
        }
        done(out.len());
    }

    /// `N` is at least `k`.
    fn search_blocks<T, const N: usize>(
        &self,
        leaves: Range<usize>,
        k: usize,
        out: &mut [T],
        visit: &(impl Fn(usize, &[Neighbour], &mut T) + Sync),
    ) {
        let mut block = Block::<N>::new(k);
        let base = self.start(leaves.start);
        for l in leaves {
            let (start, end) = (self.start(l), self.start(l + 1));
            block.search(self, l);
            for rank in start..end {
                visit(rank, block.found(rank - start), &mut out[rank - base]);
            }
        }
    }

    fn start(&self, leaf: usize) -> usize {
        part(self.len(), self.leaves.len().trailing_zeros(), leaf)
    }
}

/// First rank of node `m` of the 2^depth nodes at this depth: n points shared out evenly, and every node's range is
/// the union of its children's.
fn part(n: usize, depth: u32, m: usize) -> usize {
    ((m as u64 * n as u64) >> depth) as usize
}

/// The distinct positions, and the coincident points merged into them.
fn distinct(positions: &[Vec3]) -> (Vec<Item>, Vec<[u32; 2]>) {
    // Adding zero turns −0 into +0, which is the same place.
    let bits = |x: f32| u128::from((x + 0.0).to_bits());
    let mut keys: Vec<u128> = positions
        .par_iter()
        .enumerate()
        .map(|(i, p)| bits(p.x) << 96 | bits(p.y) << 64 | bits(p.z) << 32 | i as u128)
        .collect();
    keys.par_sort_unstable();
    let mut items: Vec<Item> = Vec::with_capacity(keys.len());
    let mut copies = Vec::new();
    let mut place = None;
    for key in keys {
        let id = key as u32;
        if place == Some(key >> 32) {
            copies.push([id, items[items.len() - 1].id]);
        } else {
            place = Some(key >> 32);
            let f = |shift: u32| f32::from_bits((key >> shift) as u32);
            items.push(Item { position: [f(96), f(64), f(32)], id });
        }
    }
    (items, copies)
}

/// Orders `items`, node `m` at `depth`, so that every node of the tree below has its range.
fn split(items: &mut [Item], n: usize, depth: u32, m: usize, leaf_depth: u32) {
    if depth == leaf_depth {
        return;
    }
    let axis = Bounds::of(items).longest_axis();
    let middle = part(n, depth + 1, 2 * m + 1) - part(n, depth, m);
    if middle < items.len() {
        // A total order, so that which points fall on each side is a property of the points.
        items
            .select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]).then(a.id.cmp(&b.id)));
    }
    let serial = items.len() <= SERIAL_BUILD;
    let (a, b) = items.split_at_mut(middle);
    let mut left = || split(a, n, depth + 1, 2 * m, leaf_depth);
    let mut right = || split(b, n, depth + 1, 2 * m + 1, leaf_depth);
    if serial {
        left();
        right();
    } else {
        rayon::join(left, right);
    }
}

/// The search state of one leaf's points, with room for `N` neighbours of each.
struct Block<const N: usize> {
    k: usize,
    points: [[f32; 3]; LEAF],
    len: usize,
    start: usize,
    /// The k best so far of each point, sorted.
    best: [[Neighbour; N]; LEAF],
    /// The worst k-th distance of the block.
    reach: f32,
    stack: Vec<usize>,
}

impl<const N: usize> Block<N> {
    fn new(k: usize) -> Self {
        let best = [[Neighbour::NONE; N]; LEAF];
        Block { k, points: [[0.0; 3]; LEAF], len: 0, start: 0, best, reach: 0.0, stack: Vec::with_capacity(64) }
    }

    fn found(&self, i: usize) -> &[Neighbour] {
        let best = &self.best[i][..self.k];
        let count = best.iter().rposition(|&n| n != Neighbour::NONE).map_or(0, |last| last + 1);
        &best[..count]
    }

    fn search(&mut self, tree: &Tree, leaf: usize) {
        self.start = tree.start(leaf);
        self.len = tree.start(leaf + 1) - self.start;
        for i in 0..self.len {
            self.points[i] = tree.items[self.start + i].position;
            self.best[i] = [Neighbour::NONE; N];
        }
        self.compare(tree, leaf);
        let count = tree.leaves.len();
        let own = tree.bounds[count + leaf];
        let mut node = count + leaf;
        while node > 1 {
            self.stack.push(node ^ 1);
            while let Some(top) = self.stack.pop() {
                if own.distance_squared(&tree.bounds[top]) >= self.reach {
                    continue;
                }
                if top >= count {
                    self.compare(tree, top - count);
                    continue;
                }
                let near = |child: usize| own.distance_squared(&tree.bounds[child]);
                let nearer = 2 * top + usize::from(near(2 * top + 1) < near(2 * top));
                self.stack.push(nearer ^ 1);
                self.stack.push(nearer);
            }
            node >>= 1;
        }
    }

    /// Compares all points of the block with all points of a leaf.
    fn compare(&mut self, tree: &Tree, leaf: usize) {
        let start = tree.start(leaf);
        let len = tree.start(leaf + 1) - start;
        let bounds = &tree.bounds[tree.leaves.len() + leaf];
        let Leaf([x, y, z]) = &tree.leaves[leaf];
        let k = self.k;
        let mut reach = 0.0f32;
        for q in 0..self.len {
            let p = self.points[q];
            let best = &mut self.best[q];
            let limit = best[k - 1].distance_squared();
            if bounds.distance_squared_to(&p) < limit {
                let d: [f32; LEAF] = std::array::from_fn(|i| length_squared([x[i] - p[0], y[i] - p[1], z[i] - p[2]]));
                let mut nearer = 0u32;
                for (i, d) in d.iter().enumerate() {
                    nearer |= u32::from(*d < limit) << i;
                }
                nearer &= (1 << len) - 1;
                if start == self.start {
                    nearer &= !(1 << q);
                }
                while nearer != 0 {
                    let i = nearer.trailing_zeros() as usize;
                    nearer &= nearer - 1;
                    insert(best, Neighbour::new(d[i], start + i));
                }
            }
            reach = reach.max(best[k - 1].distance_squared());
        }
        self.reach = reach;
    }
}

/// Puts `new` into its place among the sorted; what was last falls out. All places at once and without a branch: a search for the
/// place is guessed wrong at nearly every neighbour.
fn insert<const N: usize>(best: &mut [Neighbour; N], new: Neighbour) {
    let old = *best;
    best[0] = old[0].nearer(new);
    for at in 1..N {
        best[at] = old[at].nearer(old[at - 1].farther(new));
    }
}
