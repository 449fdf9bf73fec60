//! Sequential point trees (Dachsbacher, Vogelgsang, Stamminger: Sequential Point Trees, 2003): a tree of disks, kept as
//! one list in which a view's cut is found point by point, without the tree.
//!
//! The tree is an octree over the points, chains of single children skipped. An inner node averages what is below it and
//! has a disk that holds all disks below, and an [error](ErrorRule). An entry is in the cut of a view where it
//! [passes](crate::structure::nodes::Test::passes) and its parent does not. The list is sorted by falling
//! [key](Sequential::key), so the cut lies in a prefix.
//!
//! # One entry a path
//!
//! A path from the root to a leaf has exactly one entry in the cut where passing is inherited: leaves pass (e = 0), nothing
//! stands for the root, and between them the first that passes is the only one whose parent does not. Errors are made so that
//! for every eye and every τ ≤ τ_max a parent that passes implies its children. Let Δ = |p_c − p| for a child at p_c with
//! error e_c, and r, r_c their distances from the eye, r_c ≥ r − Δ.
//!
//! *One error.* e ≥ e_c + τ_max Δ. Then e ≤ τ r gives e_c ≤ τ r − τ Δ ≤ τ r_c. Disks hold their children's, d ≥ d_c + 2 Δ,
//! so neither this nor the errors need more than the diameter d (τ_max ≤ 1/2).
//!
//! *Split.* With v from eye to node, G(v) = e_p |v × n| + e_t |v · n|, a node passes where G(v) ≤ τ r² and
//! A = √(e_p² + e_t²) ≤ K τ r ([`SPLIT_REACH`](crate::structure::nodes::SPLIT_REACH)). Let θ be the angle between the
//! lines of the two normals. Seen along the parent's v, the child's error is that of a vector (e_t, e_p) turned by at most θ;
//! the parent's components are at least the largest that such a turn makes of each, which bounds it in every direction
//! between normal and plane. The child's own v differs by Δ, which adds at most A_c Δ ≤ K τ r Δ to G_c, and takes at most
//! 2 τ r Δ from τ r². Both components are I = (K + 2) τ_max Δ larger, and |sin| + |cos| ≥ 1, so G(v) has I r to spare: enough.
//! A ≥ A_c + I gives the second condition. Where A would be more than d, or there is no normal, or colours vary, the node has
//! no direction: its normal is 0, and its error d from everywhere, in which case the argument is that of one error. By
//! induction A ≤ d, since A_c + I ≤ d_c + 2 Δ ≤ d for τ_max ≤ 1/2.
//!
//! *Rounding.* The test is in single floats. Stored errors are rounded up by 2⁻¹⁷, more than it loses; e_t has e_p / 256 to
//! spare, since the sine from 1 − cos² is only good to 10⁻³ near 0; and no error is less than 10⁻¹⁷. (Fourth powers of
//! lengths leave the range of floats in `Split` below about 10⁻⁹ and beyond 10⁹ units: there, passing need not be
//! inherited.)
//!
//! Without perspective all distances are 1, and the same holds for every τ. For τ > τ_max each path still has at least one
//! entry in the cut: the first that passes has no parent that does.

mod error;
mod file;
mod list;
mod node;
mod tree;
mod trim;

use glam::Vec3;

use crate::par;
use crate::structure::file::fingerprint;
use crate::structure::flat::blocks;
use crate::structure::nodes::{ErrorRule, NONE, Node, Nodes};
use crate::structure::{Flat, Packing};

pub(super) use file::Body;
pub use list::{CLUSTERS, Cone, List};
use tree::Tree;

/// Coordinates and radii beyond this have squares whose sums leave the range of floats.
const FARTHEST: f32 = 1e15;

/// How a tree is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// What the errors are.
    pub rule: ErrorRule,
    /// Passing is inherited for τ = threshold / focal length up to this one, more than 0 and at most 1/2. Views with a
    /// larger τ submit more.
    pub tau_max: f32,
    /// A list for each of [`CLUSTERS`] ranges of normals, so that those that face away are not submitted.
    pub clusters: bool,
    /// A list for each part of the octree with at most so many points, below 2²⁴, as nearly as cells have it, and one for all that is above them: parts
    /// outside the picture are not submitted, and each has its own least distance (SPTsR; unprocessed scans, 2006, section
    /// 4.2). 0: no such lists.
    pub blocks: u32,
    /// Spread of colours beyond which a node's error is its diameter: the largest difference of a leaf below it from its own
    /// colour, in the worst channel, in linear light from 0 to 1. 1 and more: colours do not matter.
    pub color_error: f32,
    /// Errors over the disks of the children at face value, as published, which do not bound what is further below. Passing is
    /// inherited all the same.
    pub published_errors: bool,
}

impl Default for Options {
    /// Geometric errors, τ_max = 1/32, one list, a spread of 0.1.
    fn default() -> Self {
        Options {
            rule: ErrorRule::Geometric,
            tau_max: 1.0 / 32.0,
            clusters: false,
            blocks: 0,
            color_error: 0.1,
            published_errors: false,
        }
    }
}

/// A sequential point tree.
#[derive(Debug, Clone)]
pub struct Sequential {
    /// An entry a node, inner nodes (half the diameter for a radius) and leaves, list after list.
    pub flat: Flat,
    /// Errors.
    pub nodes: Nodes,
    /// Runs of `flat` that are sorted. What cannot be tested (a place that is no number or too far, no radius) is one of its
    /// own, the first, and always submitted.
    pub lists: Vec<List>,
    /// Steps from the root, an entry each.
    pub levels: Vec<u8>,
    /// Points of the cloud: entries that are no inner nodes.
    pub leaves: u32,
    /// How it was made.
    pub options: Options,
    /// Fingerprint of the cloud that it was made of.
    pub cloud: u64,
    /// What a prefix is searched in, see [`list`].
    steps: Vec<f32>,
}

impl Sequential {
    /// The tree of a cloud. Same input, same bytes, whatever the number of threads.
    ///
    /// At most 2³¹ − 1 points. Memory is in proportion to their number, about 150 B each at worst.
    ///
    /// # Panics
    /// Where `tau_max` or `blocks` is out of its range, or lists are asked for by normal and by place.
    pub fn build(flat: &Flat, options: &Options) -> Sequential {
        Self::with(flat, options, None)
    }

    /// The tree of a cloud whose points have errors of their own, without what is never drawn then: see [`trim`].
    pub(super) fn under(flat: &Flat, options: &Options, errors: &[f32]) -> Sequential {
        Self::with(flat, options, Some(errors))
    }

    fn with(flat: &Flat, options: &Options, errors: Option<&[f32]>) -> Sequential {
        assert!(options.tau_max > 0.0 && options.tau_max <= 0.5, "tau_max {}: 0 to 1/2", options.tau_max);
        assert!(options.blocks < 1 << 24 && !(options.blocks > 0 && options.clusters), "lists: {options:?}");
        assert!(flat.len() < 1 << 31, "{} points: too many for a tree", flat.len());
        let full = flat.unpacked();
        let flat = &*full;
        let usable = |&[x, y, z, r]: &[f32; 4]| {
            let p = Vec3::new(x, y, z).abs();
            p.max_element() <= FARTHEST && p.is_finite() && r > 0.0 && r <= FARTHEST
        };
        let (leaves, odd): (Vec<u32>, Vec<u32>) =
            (0..flat.len() as u32).partition(|&i| usable(&flat.geometry[i as usize]));
        let tree = Tree::new(flat, leaves, options);
        let tree = match errors {
            Some(errors) => tree.trim(flat, options, errors),
            None => tree,
        };
        Entries { flat, options, tree, odd }.list()
    }

    /// The same tree over [packed](Flat::packed) points. Nodes, and with them the test of single entries, stay as they are.
    pub fn packed(mut self, packing: Packing) -> Sequential {
        if packing == self.flat.packing() {
            return self;
        }
        let before = self.flat.clone();
        self.flat = self.flat.packed(packing);
        let flat = &self.flat;
        let mut moved = 0.0f64;
        for list in &mut self.lists {
            let entries = list.first..list.first + list.count;
            for i in entries.clone().filter(|&i| flat.point(i)[3] > 0.0) {
                let [p, was] = [flat, &before].map(|f| f.position(i));
                moved = moved.max((p.as_dvec3() - was.as_dvec3()).length());
                (list.min, list.max) = (list.min.min(p), list.max.max(p));
                list.reach = list.reach.max(flat.point(i)[3]);
            }
            list.cone = list.cone.and_then(|_| list::cone(entries.map(|i| flat.normal(i))));
        }
        // Keys have the distance of an entry from its parent.
        let more = error::up(self.nodes.tau_max as f64 * moved);
        if more > 0.0 {
            self.steps.iter_mut().for_each(|key| *key = error::up(*key as f64 + more as f64));
        }
        self
    }

    /// Whether it is what [`build`](Self::build) makes of this cloud with these options: for what was
    /// [loaded](Self::load).
    pub fn is_of(&self, flat: &Flat, options: &Options) -> bool {
        self.options == *options && self.leaves as usize == flat.len() && self.cloud == fingerprint(flat)
    }

    /// Bytes of what a device needs: of nodes without direction only places and errors.
    pub fn bytes(&self) -> u64 {
        let links = size_of_val(&self.nodes.links[..]);
        let nodes = self.nodes.nodes.len() * if self.nodes.rule == ErrorRule::Split { 32 } else { 16 };
        self.flat.bytes() + (links + nodes) as u64
    }
}

/// A tree on its way into lists. Entries are numbered: leaves along the curve, inner nodes, odd points.
struct Entries<'a> {
    flat: &'a Flat,
    options: &'a Options,
    tree: Tree,
    odd: Vec<u32>,
}

/// What an entry is.
enum Entry {
    Leaf(usize),
    Inner(usize),
    Odd(usize),
}

impl Entries<'_> {
    fn entry(&self, id: u32) -> Entry {
        let (id, leaves, inner) = (id as usize, self.tree.leaves.len(), self.tree.inner.len());
        match id {
            _ if id < leaves => Entry::Leaf(id),
            _ if id < leaves + inner => Entry::Inner(id - leaves),
            _ => Entry::Odd(id - leaves - inner),
        }
    }

    fn geometry(&self, id: u32) -> [f32; 4] {
        match self.entry(id) {
            Entry::Leaf(i) => self.flat.geometry[self.tree.leaves[i] as usize],
            Entry::Odd(i) => self.flat.geometry[self.odd[i] as usize],
            Entry::Inner(i) => {
                let inner = &self.tree.inner[i];
                let [x, y, z] = inner.node.position;
                [x, y, z, inner.radius]
            }
        }
    }

    /// What its own test is made of, where it has an error.
    fn node(&self, id: u32) -> Option<Node> {
        match self.entry(id) {
            Entry::Inner(i) => Some(self.tree.inner[i].node),
            Entry::Leaf(i) => self.tree.own.get(i).filter(|error| **error > 0.0).map(|&error| Node {
                position: self.flat.position(self.tree.leaves[i]).to_array(),
                error,
                normal: [0.0; 3],
                tangential: 0.0,
            }),
            Entry::Odd(_) => None,
        }
    }

    fn parent(&self, id: u32) -> u32 {
        match self.entry(id) {
            Entry::Leaf(i) => self.tree.parents[i],
            Entry::Inner(i) => self.tree.inner[i].parent,
            Entry::Odd(_) => NONE,
        }
    }

    /// Normal or colour of an entry, from those of the points or an inner node.
    fn word(&self, id: u32, points: &[u32], inner: impl Fn(&node::Inner) -> u32) -> u32 {
        match self.entry(id) {
            Entry::Leaf(i) => points[self.tree.leaves[i] as usize],
            Entry::Odd(i) => points[self.odd[i] as usize],
            Entry::Inner(i) => inner(&self.tree.inner[i]),
        }
    }

    fn level(&self, id: u32) -> u8 {
        match self.parent(id) {
            NONE => 0,
            parent => self.tree.inner[parent as usize].level + 1,
        }
    }

    /// The same of every entry in this order.
    fn each<T: Copy + Default + Send>(&self, order: &[u32], f: impl Fn(u32) -> T + Sync + Send) -> Vec<T> {
        let mut out = vec![T::default(); order.len()];
        par::fill(&mut out, 1 << 14, |first, items| {
            items.iter_mut().zip(&order[first..]).for_each(|(item, &id)| *item = f(id));
        });
        out
    }

    /// Entries with their keys' places, largest first; ties by number.
    fn keys(&self) -> Vec<u64> {
        let tree = &self.tree;
        let nodes = Nodes {
            links: Vec::new(),
            nodes: tree.inner.iter().map(|i| i.node).collect(),
            rule: self.options.rule,
            tau_max: self.options.tau_max,
        };
        let ids: Vec<u32> = (0..(tree.leaves.len() + tree.inner.len()) as u32).collect();
        self.each(&ids, |id| {
            let [x, y, z, _] = self.geometry(id);
            // Bits of floats from 0 are in their order.
            let key = list::key(&nodes, self.parent(id), Vec3::new(x, y, z));
            (!key.to_bits() as u64) << 32 | id as u64
        })
    }

    /// Number of the list of each inner node's children: from 1 on in the order of the curve, 0 above the parts. The node at
    /// the top of a part is above it, so that no box has to reach beyond its part for a parent.
    fn parts(&self) -> Vec<u32> {
        let inner = &self.tree.inner;
        let mut leaves = vec![0u32; inner.len()];
        self.tree.parents.iter().filter(|p| **p != NONE).for_each(|p| leaves[*p as usize] += 1);
        // Children come before their parents.
        for (i, node) in inner.iter().enumerate().filter(|(_, n)| n.parent != NONE) {
            leaves[node.parent as usize] += leaves[i];
        }
        let mut parts = vec![0u32; inner.len()];
        let mut count = 0;
        for (i, node) in inner.iter().enumerate().rev() {
            let above = if node.parent == NONE { 0 } else { parts[node.parent as usize] };
            parts[i] = match above {
                0 if leaves[i] <= self.options.blocks => {
                    count += 1;
                    count
                }
                above => above,
            };
        }
        parts.iter_mut().filter(|p| **p > 0).for_each(|p| *p = count + 1 - *p);
        parts
    }

    fn list(self) -> Sequential {
        let inner = self.tree.inner.len();
        let odd_first = (self.tree.leaves.len() + inner) as u32;
        let mut order: Vec<u32> = (odd_first..odd_first + self.odd.len() as u32).collect();
        let mut ends = vec![order.len()];
        let keys = self.keys();
        let mut runs = vec![Vec::new(); if self.options.clusters { CLUSTERS + 1 } else { 0 }];
        match &self.flat.normals {
            _ if self.options.blocks > 0 => {
                let parts = self.parts();
                runs = vec![Vec::new(); parts.iter().max().map_or(1, |most| *most as usize + 1)];
                for key in keys {
                    let parent = self.parent(key as u32);
                    runs[if parent == NONE { 0 } else { parts[parent as usize] as usize }].push(key);
                }
            }
            Some(normals) if self.options.clusters => {
                for &key in &keys {
                    let normal = self.word(key as u32, normals, |inner| inner.normal);
                    runs[list::cluster(normal)].push(key);
                }
            }
            _ => runs = vec![keys],
        }
        for mut run in runs {
            par::sort(&mut run);
            order.extend(run.into_iter().map(|key| key as u32));
            ends.push(order.len());
        }

        // Inner nodes are numbered anew, as the list has them.
        let leaves = self.tree.leaves.len();
        let mut places = vec![NONE; leaves + inner];
        let mut nodes = Vec::with_capacity(inner);
        for &id in &order {
            if let Some(node) = self.node(id) {
                places[id as usize] = nodes.len() as u32;
                nodes.push(node);
            }
        }
        let links = self.each(&order, |id| {
            let parent = self.parent(id);
            let place = if parent == NONE { NONE } else { places[leaves + parent as usize] };
            [places.get(id as usize).copied().unwrap_or(NONE), place]
        });
        let geometry = self.each(&order, |id| self.geometry(id));
        let stream = |points: &Option<Vec<u32>>, f: fn(&node::Inner) -> u32| {
            points.as_ref().map(|points| self.each(&order, |id| self.word(id, points, f)))
        };
        let finest = finest(&self.flat.geometry);
        let flat = Flat {
            origin: self.flat.origin,
            blocks: blocks(geometry.len(), |i| geometry[i]),
            geometry,
            normals: stream(&self.flat.normals, |inner| inner.normal),
            colors: stream(&self.flat.colors, |inner| inner.color),
            closed: self.flat.closed,
            groups: None,
            finest: Some(finest),
            packed: None,
        };
        let lists = lists(&flat, &links, &nodes, &ends, self.odd.len());
        let mut tree = Sequential {
            levels: self.each(&order, |id| self.level(id)),
            nodes: Nodes { links, nodes, rule: self.options.rule, tau_max: self.options.tau_max },
            leaves: self.flat.len() as u32,
            options: *self.options,
            cloud: fingerprint(self.flat),
            flat,
            lists,
            steps: Vec::new(),
        };
        tree.index();
        tree
    }
}

/// Largest radius of the points.
pub(super) fn finest<'a>(points: impl IntoIterator<Item = &'a [f32; 4]>) -> f32 {
    points.into_iter().map(|g| g[3]).filter(|r| r.is_finite()).fold(0.0, f32::max)
}

/// What is known of each run of entries; the first `odd` have no place in any box.
fn lists(flat: &Flat, links: &[[u32; 2]], nodes: &[Node], ends: &[usize], odd: usize) -> Vec<List> {
    let mut first = 0;
    let mut lists = Vec::new();
    for &end in ends {
        let run = std::mem::replace(&mut first, end)..end;
        if run.is_empty() {
            continue;
        }
        let mut list = List {
            first: run.start as u32,
            count: run.len() as u32,
            min: Vec3::NEG_INFINITY,
            max: Vec3::INFINITY,
            reach: 0.0,
            error: 0.0,
            cone: None,
        };
        if run.start >= odd {
            (list.min, list.max) = (list.max, list.min);
            for i in run.clone() {
                let [x, y, z, r] = flat.geometry[i];
                let p = Vec3::new(x, y, z);
                let q = links[i][1];
                let q = if q == NONE { p } else { Vec3::from(nodes[q as usize].position) };
                (list.min, list.max) = (list.min.min(p.min(q)), list.max.max(p.max(q)));
                list.reach = list.reach.max(r);
            }
            list.cone = list::cone(run.map(|i| flat.normal(i as u32)));
        }
        lists.push(list);
    }
    lists
}
