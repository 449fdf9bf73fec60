//! The threshold at which views want no more than there is room or time for.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::refine::Look;
use super::{Refine, Role};
use crate::select::Sight;
use crate::structure::layered::Index;

/// What there may be no more of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// Samples drawn, over all views.
    Samples(u64),
    /// Patches that the views need together, one that several need counted once.
    Patches(u32),
}

/// A node that may be refined.
struct Next {
    /// Factor on the threshold from which on it is not.
    ratio: f64,
    node: u32,
    view: usize,
}

impl Ord for Next {
    fn cmp(&self, other: &Next) -> Ordering {
        // The largest first; ties in any fixed order.
        self.ratio.total_cmp(&other.ratio).then_with(|| (other.node, other.view).cmp(&(self.node, self.view)))
    }
}

impl PartialOrd for Next {
    fn partial_cmp(&self, other: &Next) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Next {
    fn eq(&self, other: &Next) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Next {}

/// The least [`Refine::factor`], but not below `finest`, at which the views' cuts keep to the limit when every patch is there.
/// Patches that fade in count in full. Views are of one model: each view of each instance.
///
/// The paper searches the threshold by bisection, with a traversal each step. Here the one traversal refines the coarsest node
/// first, by [ratio](Refine), until the next one would go beyond the limit: that node's ratio is the answer, exactly, at the cost
/// of one cut. Where even the roots are too many the answer is a factor at which nothing else is drawn.
///
/// `refine` has options for all views; its factor is not used.
pub fn factor_for(index: &Index, sights: &[Sight], refine: &Refine, limit: Limit, finest: f64) -> f64 {
    factor_visible(index, sights, refine, |_, _| false, limit, finest)
}

/// The same where some nodes of some views (by index) are known to be `hidden`, as in
/// [`refine_visible`](super::refine_visible): those count, and nothing below them does.
pub fn factor_visible(
    index: &Index,
    sights: &[Sight],
    refine: &Refine,
    hidden: impl Fn(usize, u32) -> bool,
    limit: Limit,
    finest: f64,
) -> f64 {
    let Some(root) = index.nodes.first() else { return finest };
    let look = |view: usize| Look { index, sight: &sights[view], options: refine };
    // Nodes that are counted already.
    let mut known = vec![0u64; if matches!(limit, Limit::Patches(_)) { index.nodes.len().div_ceil(64) } else { 0 }];
    let mut cost = |node: u32| match limit {
        Limit::Samples(_) => index.nodes[node as usize].samples as u64,
        Limit::Patches(_) => {
            let (word, bit) = (&mut known[node as usize / 64], 1u64 << (node % 64));
            let new = *word & bit == 0;
            *word |= bit;
            new as u64
        }
    };
    let most = match limit {
        Limit::Samples(most) => most,
        Limit::Patches(most) => most as u64,
    };
    let mut heap = BinaryHeap::new();
    let mut count = 0;
    for view in 0..sights.len() {
        let look = look(view);
        let spacing = look.spacing(root);
        if look.role(root, spacing, spacing) == Role::Drawn {
            count += cost(0);
            if !hidden(view, 0) {
                heap.push(Next { ratio: look.ratio(root), node: 0, view });
            }
        }
    }
    while let Some(next) = heap.pop().filter(|next| next.ratio > finest) {
        let look = look(next.view);
        let node = &index.nodes[next.node as usize];
        let spacing = look.spacing(node);
        for child in node.children() {
            let it = &index.nodes[child as usize];
            if look.role(it, spacing, spacing) == Role::Drawn {
                count += cost(child);
                if !hidden(next.view, child) {
                    // A child is only refined where its parent is.
                    heap.push(Next { ratio: look.ratio(it).min(next.ratio), node: child, view: next.view });
                }
            }
        }
        if count > most {
            return next.ratio;
        }
    }
    finest
}
