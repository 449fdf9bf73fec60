//! A sorted list of a tree's nodes, and which part of it a view may need.

use glam::{DVec3, Vec3};

use super::Sequential;
use super::error::up;
use crate::select::Sight;
use crate::structure::nodes::{NONE, Nodes};
use crate::structure::octahedral;
use crate::style::Interval;

/// Entries from one key that is kept to the next: prefixes are multiples of it, a cache line of keys a list.
const STEP: usize = 16;

/// Lists by normal: 8 faces of an octahedron, split twice into four.
pub const CLUSTERS: usize = 128;

/// Entries sorted by falling key: what a view needs is a prefix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct List {
    /// Index of the first entry.
    pub first: u32,
    /// Number of entries, at least 1.
    pub count: u32,
    /// Corner of a box that holds the positions of all entries and of their parents, relative to the origin. For points
    /// without a usable place, all there is: it reaches from −∞ to ∞.
    pub min: Vec3,
    /// Opposite corner.
    pub max: Vec3,
    /// Largest radius \[cloud units\].
    pub reach: f32,
    /// Least error of an entry \[cloud units\]: none passes nearer than where that does. 0 for lists with points that always pass.
    pub error: f32,
    /// What holds all normals; `None` where one is missing or it would be wider than half a turn.
    pub cone: Option<Cone>,
}

/// Directions within an angle of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Unit vector.
    pub axis: Vec3,
    /// Cosine of the angle, rounded down; more than 0.
    pub cosine: f32,
}

impl List {
    /// Whether all entries face away from the viewer, wherever they lie in the box.
    fn faces_away(&self, sight: &Sight) -> bool {
        let Some(cone) = self.cone else { return false };
        let (axis, cosine) = (cone.axis.as_dvec3(), cone.cosine as f64);
        // No normal is nearer than a right angle to the way to the eye v where v is beyond that and the cone's angle from
        // its axis: v · axis ≤ −sin |v|. That is a convex set, so the corners of the box decide. What rounding could turn is
        // left to the test of single points.
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt() + 1e-4;
        let away = |v: DVec3| v.dot(axis) < -sine * v.length();
        let eye = sight.eye.truncate();
        let corner = |k: usize| DVec3::from([0, 1, 2].map(|a| [self.min, self.max][k >> a & 1][a] as f64));
        if sight.eye.w == 0.0 { away(eye) } else { (0..8).all(|k| away(eye - corner(k))) }
    }
}

impl Sequential {
    /// Key of an entry \[cloud units\]: e_parent + τ_max |p − p_parent|; ∞ where nothing can stand for it. An entry of the
    /// cut has key ≥ τ r, r the distance of some point of its list's box.
    pub fn key(&self, entry: usize) -> f32 {
        let [x, y, z, _] = self.flat.point(entry as u32);
        key(&self.nodes, self.nodes.links[entry][1], Vec3::new(x, y, z))
    }

    /// Adds what the test of single entries may let pass, a span a list: all of it, and no list that lies outside the
    /// picture or, with `cull_back`, faces away.
    pub fn select(
        &self,
        sight: &Sight,
        interval: Interval,
        cull_back: bool,
        instance: u32,
        out: &mut crate::select::DrawList,
    ) {
        // The published test adds τ |p − p_parent|, which the key has for τ_max.
        let all = interval == Interval::Published && sight.eye.w != 0.0 && sight.test().tau > self.nodes.tau_max;
        let mut steps = &self.steps[..];
        for list in &self.lists {
            let (own, rest) = steps.split_at((list.count as usize).div_ceil(STEP));
            steps = rest;
            if sight.misses(list.min, list.max, list.reach) || cull_back && list.faces_away(sight) {
                continue;
            }
            if list.error as f64 > sight.tau * sight.farthest(list.min, list.max) {
                continue;
            }
            // `max` takes 0 for what is not a number: everything.
            let least = if all { 0.0 } else { (sight.tau * sight.distance(list.min, list.max)).max(0.0) };
            // From the head in doubling steps, since from afar prefixes are short: other lines of the cache are not touched.
            let reaches = |key: &f32| *key as f64 >= least;
            let mut bound = 1;
            while bound < own.len() && reaches(&own[bound]) {
                bound *= 2;
            }
            let head = bound / 2;
            let needed = (head + own[head..bound.min(own.len())].partition_point(reaches)) * STEP;
            let count = list.count.min(needed as u32);
            out.push(crate::select::Span { instance, first: list.first, count, least: 0.0 });
        }
    }

    /// Fills in what a view is selected by: keys of every [`STEP`]th entry of every list, which the search for a prefix is
    /// confined to, and the lists' least errors.
    pub(super) fn index(&mut self) {
        let of = |list: &List| list.first..list.first + list.count;
        let keyed = self.lists.iter().flat_map(|list| of(list).step_by(STEP));
        self.steps = keyed.map(|entry| self.key(entry as usize)).collect();
        let Nodes { links, nodes, .. } = &self.nodes;
        // What depends on the direction may pass nearer.
        let own = |i: u32| nodes.get(links[i as usize][0] as usize).filter(|n| n.tangential == 0.0);
        for list in &mut self.lists {
            list.error = of(list).map(|i| own(i).map_or(0.0, |n| n.error)).fold(f32::INFINITY, f32::min);
        }
    }
}

/// See [`Sequential::key`].
pub fn key(nodes: &Nodes, parent: u32, position: Vec3) -> f32 {
    if parent == NONE {
        return f32::INFINITY;
    }
    let parent = &nodes.nodes[parent as usize];
    let apart = (position.as_dvec3() - Vec3::from(parent.position).as_dvec3()).length();
    up((parent.error as f64).hypot(parent.tangential as f64) + nodes.tau_max as f64 * apart)
}

/// Which of the lists by normal an [`octahedral`] code belongs to; what has none, to one more.
pub fn cluster(code: u32) -> usize {
    let Some(normal) = octahedral::decode(code) else { return CLUSTERS };
    let face = (0..3).filter(|&a| normal[a] < 0.0).map(|a| 1 << a).sum::<usize>();
    let size = normal.abs();
    let mut place = size / (size.x + size.y + size.z);
    let mut cluster = face;
    for _ in 0..2 {
        let corner = (0..3).find(|&a| place[a] > 0.5);
        cluster = 4 * cluster + corner.map_or(0, |a| a + 1);
        place = match corner {
            Some(a) => 2.0 * place - DVec3::AXES[a],
            None => 1.0 - 2.0 * place,
        };
    }
    cluster
}

/// The least cone round the mean of some codes.
pub fn cone(codes: impl Iterator<Item = u32> + Clone) -> Option<Cone> {
    let mut sum = DVec3::ZERO;
    for code in codes.clone() {
        sum += octahedral::decode(code)?;
    }
    let axis = sum.try_normalize()?.as_vec3();
    let least = codes.filter_map(octahedral::decode).map(|n| n.dot(axis.as_dvec3())).fold(1.0, f64::min);
    let cosine = (least - 1e-6) as f32;
    (cosine > 0.0).then_some(Cone { axis, cosine })
}
