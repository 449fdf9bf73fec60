//! What a point-by-point level of detail decides by: the errors of a tree's nodes, in a list without the tree.

use glam::Vec3;

use crate::technique::names;

/// In [`Nodes::links`]: no node.
pub const NONE: u32 = u32::MAX;

/// Which error of a node is held against the threshold (Dachsbacher, Vogelgsang, Stamminger: Sequential Point Trees, 2003,
/// sections 3.1 to 3.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum ErrorRule {
    /// √(e_p² + e_t²), the same from everywhere.
    #[default]
    Geometric = 0,
    /// e_p sin α + e_t cos α, α between the node's normal and the view.
    Split = 1,
    /// The diameter of the disk, as in QSplat (Rusinkiewicz, Levoy 2000).
    Diameter = 2,
    /// The diameter of the cell (unprocessed scans, 2006, section 3.3).
    Cell = 3,
}

names!(ErrorRule { Geometric = "geometric", Split = "split", Diameter = "diameter", Cell = "cell" });

/// [`ErrorRule::Split`] passes no node whose geometric error is beyond so many times the threshold: head-on, e_p alone says
/// nothing, and what passes must go on passing for the children, whose view differs.
pub const SPLIT_REACH: f32 = 2.0;

/// A node that has an error. The device keeps 16 B of it, 32 B for [`ErrorRule::Split`].
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Node {
    /// Where its distance is taken, relative to the cloud's origin.
    pub position: [f32; 3],
    /// Error \[cloud units\]: e_p for [`ErrorRule::Split`], for others the only one.
    pub error: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// e_t \[cloud units\] for [`ErrorRule::Split`], else 0.
    pub tangential: f32,
}

/// Errors of a list's entries.
#[derive(Debug, Clone, PartialEq)]
pub struct Nodes {
    /// Indices into `nodes` for each entry of the list: its own node, [`NONE`] for entries without error, which always pass;
    /// and its parent's, [`NONE`] where nothing can stand for it.
    pub links: Vec<[u32; 2]>,
    /// Every node that has an error.
    pub nodes: Vec<Node>,
    /// What the errors are.
    pub rule: ErrorRule,
    /// Passing is inherited by all descendants for τ up to this one (see `structure::sequential`).
    pub tau_max: f32,
}

/// The viewer as the test takes it, in single floats: the device does the same operations on the same numbers, so that both
/// decide alike to the last bit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Test {
    /// Eye relative to the cloud's origin and 1, or the unit direction towards the viewer and 0.
    pub eye: [f32; 4],
    /// τ = threshold / focal length; without perspective the largest error that passes \[cloud units\].
    pub tau: f32,
}

impl Test {
    /// Whether a node may stand for all below it: its error on the screen is at most the threshold.
    ///
    /// Squares are compared, so there are no roots, divisions or trigonometric functions, which devices round each their own way.
    /// Twin: `glsl/shared/interval.glsl`.
    pub fn passes(&self, rule: ErrorRule, node: &Node) -> bool {
        let ([px, py, pz], [ex, ey, ez, w]) = (node.position, self.eye);
        let (x, y, z) = (px * w - ex, py * w - ey, pz * w - ez);
        let square = (x * x + y * y) + z * z;
        let limit = (self.tau * self.tau) * square;
        if rule != ErrorRule::Split {
            return node.error * node.error <= limit;
        }
        let (ep, et) = (node.error, node.tangential);
        let cosine = ((node.normal[0] * x + node.normal[1] * y) + node.normal[2] * z).abs();
        // e_p sin α + e_t cos α ≤ τ r, times r: r sin α = √(r² − cosine²).
        let sine_square = (square - cosine * cosine).max(0.0);
        let left = self.tau * square - et * cosine;
        let all = ep * ep + et * et;
        left >= 0.0 && (ep * ep) * sine_square <= left * left && all <= (SPLIT_REACH * SPLIT_REACH) * limit
    }

    /// Whether entry `i` is in the cut: it passes, and its parent does not.
    pub fn selects(&self, nodes: &Nodes, i: usize) -> bool {
        let [own, parent] = nodes.links[i];
        let passes = |node: u32| self.passes(nodes.rule, &nodes.nodes[node as usize]);
        (own == NONE || passes(own)) && (parent == NONE || !passes(parent))
    }

    /// The test as published (2003, section 3.6), with distances r from the entry alone: e ≤ τ r, and τ r < e_parent +
    /// τ |p − p_parent|. `position` is the entry's.
    pub fn selects_published(&self, nodes: &Nodes, i: usize, position: Vec3) -> bool {
        let [own, parent] = nodes.links[i];
        let [ex, ey, ez, w] = self.eye;
        let r = (position * w - Vec3::new(ex, ey, ez)).length();
        let error = |node: &Node| match nodes.rule {
            ErrorRule::Split => (node.error * node.error + node.tangential * node.tangential).sqrt(),
            _ => node.error,
        };
        let passes = own == NONE || error(&nodes.nodes[own as usize]) <= self.tau * r;
        passes
            && (parent == NONE || {
                let parent = &nodes.nodes[parent as usize];
                self.tau * r < error(parent) + self.tau * w * (position - Vec3::from(parent.position)).length()
            })
    }
}
