//! One traversal of the index for one view of one instance.

use crate::select::Sight;
use crate::structure::layered::{Index, Node};
use crate::structure::nodes::NONE;
use crate::technique::names;

use super::fade;
use super::{Cut, Role, Step, Wish};

/// Which spacing of a node is held against the threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Rule {
    /// As measured where the node lies.
    #[default]
    Measured,
    /// By equations 1 and 2 of the paper, from counts, as if density were even.
    Published,
}

names!(Rule { Measured = "measured", Published = "published" });

/// How a view refines.
///
/// A node is refined where the ratio of its projected spacing to the threshold, s / (τ d), is more than `factor`: s its spacing,
/// d the least distance of the eye from its ball (1 without perspective). That is for its nearest sample, so finer than
/// needed for others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refine {
    /// Which spacing s is.
    pub rule: Rule,
    /// On the threshold, more than 0: what [`factor_for`](super::factor_for) found.
    pub factor: f64,
    /// Whether what faces away is not drawn anyway: closed clouds whose back faces are dropped.
    pub back_faces_culled: bool,
    /// A child is there in full from this ratio of its parent on, at least 1; between 1 and this in proportion. 1: at once.
    pub fade: f64,
    /// Children may be wanted soon from this ratio of their parent on, at most 1: they are fetched ahead where there is room. 1: none.
    pub prefetch: f64,
}

impl Default for Refine {
    fn default() -> Self {
        Refine { rule: Rule::Measured, factor: 1.0, back_faces_culled: false, fade: 1.0, prefetch: 1.0 }
    }
}

/// A node that the cut will have.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    node: u32,
    role: Role,
    /// The parent's step, and which of its children this is.
    above: usize,
    side: usize,
    /// How much of it there is, 0 to 1.
    share: f32,
}

/// What the traversals ask of a node.
pub(super) struct Look<'a> {
    pub index: &'a Index,
    pub sight: &'a Sight,
    pub options: &'a Refine,
}

impl Look<'_> {
    pub fn spacing(&self, node: &Node) -> f32 {
        match self.options.rule {
            Rule::Measured => node.spacing,
            Rule::Published => node.published,
        }
    }

    /// Projected spacing over the threshold, ∞ where the eye is in the ball. Never above 0 for leaves.
    pub fn ratio(&self, node: &Node) -> f64 {
        if node.split > 2 {
            return 0.0;
        }
        let ratio = self.spacing(node) as f64 / (self.sight.tau * self.sight.distance_to_ball(node.centre, node.ball));
        // Points all in one place have no spacing, and nothing to refine.
        if ratio.is_nan() { 0.0 } else { ratio }
    }

    /// Whether a node lies outside the frustum, with all that its being in the cut could change there. `above`: the radius in
    /// its parent's region, `spacing`: the parent's.
    ///
    /// Its own samples are drawn no larger than `above`. Its ancestors' samples in its region lie within the parent's spacing of
    /// one of its own, that is how spacing is measured, and they reach as far again: twice the spacing and they are out of the
    /// picture too, so that none of their radii matters.
    pub fn outside(&self, node: &Node, above: f32, spacing: f32) -> bool {
        let reach = node.reach.max(above).max(2.0 * spacing);
        self.sight.misses_ball(node.centre, node.ball, reach)
    }

    pub fn back_facing(&self, node: &Node) -> bool {
        self.options.back_faces_culled && self.sight.faces_away(node.centre, node.ball, node.axis, node.cone)
    }

    pub fn role(&self, node: &Node, above: f32, spacing: f32) -> Role {
        match (self.outside(node, above, spacing), self.back_facing(node)) {
            (true, _) => Role::Outside,
            (_, true) => Role::BackFacing,
            _ => Role::Drawn,
        }
    }

    fn wish(&self, node: u32, pressure: f64) -> Wish {
        let it = &self.index.nodes[node as usize];
        let middle = self.sight.centrality(it.centre, it.ball);
        let priority = if pressure > 0.0 { pressure * middle } else { pressure / middle };
        Wish { node, at: it.at, bytes: it.bytes, priority: priority as f32 }
    }
}

/// Finds what a view draws of an instance, and what it lacks.
///
/// `presence` says how much of a node's patch there is: 0 none, 1 all, between the two for one that arrived a moment ago and
/// comes gradually. A node whose parent is not in the cut is never asked for.
///
/// The cost is that of the nodes in the cut and their children. In the index every child comes after its parent, as its
/// order by level says.
pub fn refine(index: &Index, sight: &Sight, options: &Refine, presence: impl Fn(u32) -> f32, cut: &mut Cut) {
    refine_visible(index, sight, options, presence, |_| false, cut);
}

/// The same where some nodes are known to be `hidden`: those have their place in the cut, and nothing below them is refined or
/// wished for.
pub fn refine_visible(
    index: &Index,
    sight: &Sight,
    options: &Refine,
    presence: impl Fn(u32) -> f32,
    hidden: impl Fn(u32) -> bool,
    cut: &mut Cut,
) {
    cut.clear();
    let Some(root) = index.nodes.first() else { return };
    let look = Look { index, sight, options };
    let [mut level, mut next] = std::mem::take(&mut cut.found);
    let spacing = look.spacing(root);
    cut.counts.visited = 1;
    match look.role(root, spacing, spacing) {
        Role::Outside | Role::Hidden => cut.counts.frustum = 1,
        role if presence(0) > 0.0 => level.push(Found { node: 0, role, above: 0, side: 0, share: 1.0 }),
        Role::BackFacing => cut.counts.cone = 1,
        Role::Drawn => {
            cut.counts.missing = 1;
            cut.wishes.push(look.wish(0, f64::INFINITY));
        }
    }
    while !level.is_empty() {
        // Levels are in order, numbers within them not yet.
        level.sort_unstable_by_key(|found| found.node);
        for mut found in level.drain(..) {
            if found.role == Role::Drawn && hidden(found.node) {
                found.role = Role::Hidden;
            }
            enter(&look, &found, &presence, cut, &mut next);
        }
        std::mem::swap(&mut level, &mut next);
    }
    cut.found = [level, next];
}

/// Adds a node to the cut, and what its children are to that or to the next level.
fn enter(look: &Look, found: &Found, presence: &impl Fn(u32) -> f32, cut: &mut Cut, next: &mut Vec<Found>) {
    let node = &look.index.nodes[found.node as usize];
    let own = look.spacing(node);
    let step = cut.steps.len();
    let mut radius = own;
    if found.node > 0 {
        let above = &mut cut.steps[found.above];
        above.children[found.side] = step as u32;
        if found.share < 1.0 {
            // Density grows in proportion, and r = density^−½ is convex: the radius in proportion is no smaller than needed.
            radius = above.radius + found.share * (own - above.radius);
        }
    }
    let limit = fade::limit(found.share);
    let (split, plane) = (node.split, node.plane);
    cut.steps.push(Step { node: found.node, role: found.role, split, plane, children: [NONE; 2], radius, limit });
    match found.role {
        Role::Outside => {
            cut.counts.frustum += 1;
            return;
        }
        Role::Hidden => {
            cut.counts.occluded += 1;
            return;
        }
        Role::BackFacing => cut.counts.cone += 1,
        Role::Drawn => cut.count(found.node, node.samples, limit),
    }

    let ratio = look.ratio(node) / look.options.factor;
    let wanted = ratio > 1.0;
    // An eye in the ball and an infinite factor: the factor says that this is not refined.
    if ratio.is_nan() || !wanted && ratio <= look.options.prefetch {
        return;
    }
    let share = if ratio < look.options.fade { ((ratio - 1.0) / (look.options.fade - 1.0)) as f32 } else { 1.0 };
    for (side, &child) in node.children.iter().enumerate().filter(|(_, child)| **child != NONE) {
        let it = &look.index.nodes[child as usize];
        let role = match look.outside(it, radius, own) {
            true => Role::Outside,
            // All below a node faces away with it.
            false if found.role == Role::BackFacing || look.back_facing(it) => Role::BackFacing,
            false => Role::Drawn,
        };
        let there = presence(child);
        match (wanted, there > 0.0, role) {
            (true, true, _) => {
                let share = share.min(found.share).min(there);
                next.push(Found { node: child, role, above: step, side, share });
            }
            (true, false, Role::Outside | Role::Hidden) => cut.counts.frustum += 1,
            (true, false, Role::BackFacing) => cut.counts.cone += 1,
            (true, false, Role::Drawn) => {
                cut.counts.missing += 1;
                cut.wishes.push(look.wish(child, ratio - 1.0));
            }
            (false, true, Role::Drawn) => cut.near.push(child),
            (false, false, Role::Drawn) => cut.wishes.push(look.wish(child, ratio - 1.0)),
            (false, ..) => {}
        }
        cut.counts.visited += wanted as u32;
    }
}
