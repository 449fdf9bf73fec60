//! The tree under the list: an octree whose chains are skipped, built from the leaves up, a part of it a thread.

use glam::Vec3;

use super::Options;
use super::node::{Child, Inner, Maker};
use crate::par;
use crate::structure::Flat;
use crate::structure::morton::{Cube, LEVELS};
use crate::structure::nodes::NONE;

/// Most leaves of a part that is built by itself. Never a matter of how many threads there are, and parts are joined in
/// order: the same bytes everywhere.
const GRAIN: usize = 1 << 14;

/// Leaves along the Morton curve, and all that is above them.
#[derive(Default)]
pub struct Tree {
    /// Points of the cloud.
    pub leaves: Vec<u32>,
    /// Of each leaf, an inner node; [`NONE`] for an only one.
    pub parents: Vec<u32>,
    /// Children before their parents, so the root is last.
    pub inner: Vec<Inner>,
    /// Of each leaf, the error that it has itself; empty where none has.
    pub own: Vec<f32>,
}

/// A place on the curve and the point there.
type Place = (u64, u32);

impl Tree {
    /// Of these points of a cloud: finite ones with finite squares, with radii.
    pub fn new(flat: &Flat, mut leaves: Vec<u32>, options: &Options) -> Tree {
        if leaves.is_empty() {
            return Tree::default();
        }
        let position = |i: u32| {
            let [x, y, z, _] = flat.geometry[i as usize];
            Vec3::new(x, y, z)
        };
        let (low, high) = leaves.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &i| {
            let p = position(i);
            (low.min(p), high.max(p))
        });
        let cube = Cube::round(low, high);
        let mut sorted: Vec<Place> = vec![(0, 0); leaves.len()];
        par::fill(&mut sorted, GRAIN, |first, places| {
            for (place, &i) in places.iter_mut().zip(&leaves[first..]) {
                *place = (cube.code(position(i)), i);
            }
        });
        par::sort(&mut sorted);

        let maker = Maker { flat, options };
        let mut cuts = Vec::new();
        plan(&sorted, &mut cuts);
        let parts = par::map(&cuts, |places| {
            let mut part = Part::default();
            let top = part.grow(&maker, &cube, places);
            (part, top)
        });
        // The parts one after the other, then what joins them.
        let mut whole = Part { inner: Vec::new(), parents: Vec::with_capacity(sorted.len()) };
        let mut tops = Vec::with_capacity(parts.len());
        for (part, mut top) in parts {
            let (inner, first) = (whole.inner.len() as u32, whole.parents.len() as u32);
            let moved = |parent: u32| if parent == NONE { NONE } else { parent + inner };
            whole.parents.extend(part.parents.into_iter().map(moved));
            whole.inner.extend(part.inner.into_iter().map(|node| Inner { parent: moved(node.parent), ..node }));
            top.id = if top.leaf { top.id + first } else { top.id + inner };
            tops.push(top);
        }
        whole.join(&maker, &cube, &sorted, &mut tops.into_iter());

        leaves.clear();
        leaves.extend(sorted.iter().map(|&(_, i)| i));
        let mut tree = Tree { leaves, parents: whole.parents, inner: whole.inner, own: Vec::new() };
        // Parents come after their children.
        for i in (0..tree.inner.len()).rev() {
            let parent = tree.inner[i].parent;
            tree.inner[i].level = if parent == NONE { 0 } else { tree.inner[parent as usize].level + 1 };
        }
        tree
    }
}

/// Runs of places that are built by themselves, in order.
fn plan<'a>(places: &'a [Place], cuts: &mut Vec<&'a [Place]>) {
    if places.len() <= GRAIN {
        cuts.push(places);
        return;
    }
    split(places).0.into_iter().filter(|part| !part.is_empty()).for_each(|part| plan(part, cuts));
}

/// At least two places, cut into the octants of the least cell that holds them, and how many times the cube was halved for
/// it. Where they are at one place, into eight equal parts, so that no tree is deep.
fn split(places: &[Place]) -> ([&[Place]; 8], u32) {
    let (first, last) = (places[0].0, places[places.len() - 1].0);
    if first == last {
        let at = |k: usize| places.len() * k / 8;
        return (std::array::from_fn(|k| &places[at(k)..at(k + 1)]), LEVELS);
    }
    // Of the groups of three bits, the highest in which they differ.
    let group = (63 - (first ^ last).leading_zeros()) / 3;
    let mut rest = places;
    let octants = std::array::from_fn(|k| {
        let (octant, others) = rest.split_at(rest.partition_point(|p| (p.0 >> (3 * group) & 7) as usize <= k));
        rest = others;
        octant
    });
    (octants, LEVELS - 1 - group)
}

/// Inner nodes of a part of the tree, and its leaves' parents among them.
#[derive(Default)]
struct Part {
    inner: Vec<Inner>,
    parents: Vec<u32>,
}

impl Part {
    fn grow(&mut self, maker: &Maker, cube: &Cube, places: &[Place]) -> Child {
        if let [(_, point)] = places {
            self.parents.push(NONE);
            return maker.leaf(*point, self.parents.len() as u32 - 1);
        }
        self.over(maker, cube, places, &mut |part, octant| part.grow(maker, cube, octant))
    }

    /// What lies above the parts of a plan, whose tops come in order.
    fn join(&mut self, maker: &Maker, cube: &Cube, places: &[Place], tops: &mut impl Iterator<Item = Child>) -> Child {
        if places.len() <= GRAIN {
            return tops.next().expect("a part for each run of the plan");
        }
        // Calls itself through a pointer: a type for each depth would not end.
        self.over(maker, cube, places, &mut |part, octant| part.join(maker, cube, octant, tops))
    }

    /// The node of a cell, over what `child` makes of its octants.
    fn over(
        &mut self,
        maker: &Maker,
        cube: &Cube,
        places: &[Place],
        child: &mut dyn FnMut(&mut Self, &[Place]) -> Child,
    ) -> Child {
        let (octants, halved) = split(places);
        let mut children = [None; 8];
        let mut count = 0;
        for octant in octants.into_iter().filter(|octant| !octant.is_empty()) {
            children[count] = Some(child(self, octant));
            count += 1;
        }
        let children = children.map(|c| c.unwrap_or(Child::NONE));
        let children = &children[..count];
        let (node, top) = maker.node(children, cube.side as f64 / (1u64 << halved) as f64, self.inner.len() as u32);
        for child in children {
            match child.leaf {
                true => self.parents[child.id as usize] = top.id,
                false => self.inner[child.id as usize].parent = top.id,
            }
        }
        self.inner.push(node);
        top
    }
}
