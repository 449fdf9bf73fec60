//! What triangles stand for is taken out of a tree (Dachsbacher, Vogelgsang, Stamminger: Sequential Point Trees, 2003,
//! section 3.8): a point is needed only from where its triangle is no longer drawn.
//!
//! A point is needed from distance e / τ on, e its *own error*: as an error, it passes exactly there. A node is needed where any
//! point below it is, so where its own place is at least e / τ away with e = min (e_c − τ_max Δ) over its children, Δ the way
//! to them. Where its geometric error is no more than that, it passes wherever it is needed, and what is below it is never
//! drawn: it *ends* the tree, with e for its error. Errors of what remains are raised as the module's proof demands. They may
//! exceed diameters then, which costs nothing: where they do, a triangle is drawn.

use glam::{DVec3, Vec3};

use super::Options;
use super::error::{inherited, up};
use super::node::Inner;
use super::tree::Tree;
use crate::structure::Flat;
use crate::structure::nodes::{ErrorRule, NONE, Node};

/// A little less than a length, by more than single floats lose in the test: what is needed must pass.
fn down(length: f64) -> f32 {
    (length * (1.0 - 1.0 / (1 << 17) as f64)) as f32
}

fn place(node: &Node) -> DVec3 {
    Vec3::from(node.position).as_dvec3()
}

fn whole(node: &Node) -> f64 {
    (node.error as f64).hypot(node.tangential as f64)
}

/// Sums up what the children of each node ask of it.
struct Demands<'a> {
    options: &'a Options,
    inner: &'a mut [Inner],
}

impl Demands<'_> {
    /// Raises the errors of `parent` so that it passes nowhere where this child of it does not.
    fn raise(&mut self, parent: u32, child: &Node) {
        if parent == NONE {
            return;
        }
        let node = &mut self.inner[parent as usize].node;
        let (tau_max, apart) = (self.options.tau_max as f64, (place(child) - place(node)).length());
        let directed = |n: &Node| Some(Vec3::from(n.normal).as_dvec3()).filter(|n| *n != DVec3::ZERO);
        match (self.options.rule, directed(node)) {
            (ErrorRule::Split, Some(normal)) => {
                let normals = directed(child).map(|n| (n, normal));
                let (p, t) = inherited(child.error as f64, child.tangential as f64, normals, tau_max, apart);
                node.error = node.error.max(up(p));
                node.tangential = node.tangential.max(up(t));
            }
            _ => node.error = node.error.max(up(whole(child) + tau_max * apart)),
        }
    }
}

impl Tree {
    /// Takes out what is never drawn. `errors` has the own error of each point of the cloud \[cloud units\]; 0 and less: it is
    /// needed from everywhere.
    pub fn trim(mut self, flat: &Flat, options: &Options, errors: &[f32]) -> Tree {
        let leaf = |point: u32| Node {
            position: flat.position(point).to_array(),
            error: down(errors[point as usize].max(0.0) as f64),
            normal: [0.0; 3],
            tangential: 0.0,
        };
        // Children come before their parents.
        let mut needed = vec![f64::INFINITY; self.inner.len()];
        let tau_max = options.tau_max as f64;
        let asked = |inner: &[Inner], parent: u32, child: &Node, error: f64| {
            error - tau_max * (place(child) - place(&inner[parent as usize].node)).length()
        };
        for (&point, &parent) in self.leaves.iter().zip(&self.parents).filter(|(_, p)| **p != NONE) {
            let node = leaf(point);
            let error = asked(&self.inner, parent, &node, node.error as f64);
            needed[parent as usize] = needed[parent as usize].min(error);
        }
        for i in 0..self.inner.len() {
            let Inner { node, parent, .. } = &self.inner[i];
            if *parent != NONE {
                let error = asked(&self.inner, *parent, node, needed[i]);
                needed[*parent as usize] = needed[*parent as usize].min(error);
            }
        }
        let ends: Vec<bool> = (0..needed.len()).map(|i| whole(&self.inner[i].node) as f32 <= down(needed[i])).collect();
        // Below a node that ends the tree.
        let mut gone = vec![false; ends.len()];
        for i in (0..ends.len()).rev() {
            let parent = self.inner[i].parent;
            gone[i] = parent != NONE && (gone[parent as usize] || ends[parent as usize]);
        }
        let kept = |parent: u32| parent == NONE || !(gone[parent as usize] || ends[parent as usize]);

        let mut demands = Demands { options, inner: &mut self.inner };
        for (&point, &parent) in self.leaves.iter().zip(&self.parents).filter(|(_, p)| kept(**p)) {
            demands.raise(parent, &leaf(point));
        }
        for i in 0..ends.len() {
            if gone[i] {
                continue;
            }
            let Inner { node, parent, .. } = &mut demands.inner[i];
            if ends[i] {
                (node.error, node.tangential, node.normal) = (down(needed[i]), 0.0, [0.0; 3]);
            }
            let (node, parent) = (*node, *parent);
            demands.raise(parent, &node);
        }

        let mut numbers = vec![NONE; gone.len()];
        let stay = numbers.iter_mut().zip(&gone).filter(|(_, gone)| !**gone);
        (0..).zip(stay).for_each(|(next, (number, _))| *number = next);
        let anew = |parent: u32| if parent == NONE { NONE } else { numbers[parent as usize] };
        let leaves = self.leaves.iter().zip(&self.parents).filter(|(_, p)| kept(**p));
        let (leaves, parents): (Vec<u32>, Vec<u32>) = leaves.map(|(&point, &parent)| (point, anew(parent))).unzip();
        let inner = self.inner.into_iter().zip(&gone).filter(|(_, gone)| !**gone);
        Tree {
            own: leaves.iter().map(|&point| leaf(point).error).collect(),
            leaves,
            parents,
            inner: inner.map(|(node, _)| Inner { parent: anew(node.parent), ..node }).collect(),
        }
    }
}
