//! What one view draws of one instance.

use crate::structure::nodes::NONE;

use super::refine::Found;
use super::{Wish, shown};

/// Why the cut has a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// Its samples are drawn.
    Drawn,
    /// It faces away, with all below it. It is refined as if it were drawn, for the radii of its ancestors' samples.
    BackFacing,
    /// It lies outside the frustum, with all below it. It counts for radii, nothing below it does.
    Outside,
    /// It was behind other things when it was last tested, with all below it: drawn only where a test in this very frame finds
    /// otherwise. It counts for radii, nothing below it does.
    Hidden,
}

impl Role {
    /// Whether the node's samples are drawn, if they are not found to be hidden.
    pub fn is_shown(self) -> bool {
        matches!(self, Role::Drawn | Role::Hidden)
    }
}

/// A node of a cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Number in the index.
    pub node: u32,
    /// What it is for.
    pub role: Role,
    /// Axis of its plane, 3 for a leaf, and where: [`Node::split`](crate::structure::layered::Node::split).
    pub split: u8,
    /// See [`Node::plane`](crate::structure::layered::Node::plane).
    pub plane: f32,
    /// Steps of the children in the cut, [`NONE`] for others.
    pub children: [u32; 2],
    /// Radius of a sample whose deepest step this is \[cloud units\]: the node's spacing, or between its parent's radius and
    /// that while it fades in.
    pub radius: f32,
    /// Of its samples those with [`rank`](super::rank) ≤ this are drawn; `u32::MAX`: all.
    pub limit: u32,
}

/// What a traversal met. `visited` = `drawn` + `frustum` + `cone` + `missing` + `occluded`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Nodes that the rule asked for: the root, and all children of refined nodes.
    pub visited: u32,
    /// Of those, outside the frustum.
    pub frustum: u32,
    /// Of those, inside, but facing away by the cone of their normals.
    pub cone: u32,
    /// Of those, drawn.
    pub drawn: u32,
    /// Of those, to be drawn, but not there.
    pub missing: u32,
    /// Of those, to be drawn, but behind other things.
    pub occluded: u32,
    /// Samples of drawn nodes that are drawn.
    pub samples: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Counts) {
        let Counts { visited, frustum, cone, drawn, missing, occluded, samples } = other;
        self.visited += visited;
        self.frustum += frustum;
        self.cone += cone;
        self.drawn += drawn;
        self.missing += missing;
        self.occluded += occluded;
        self.samples += samples;
    }
}

/// What one view draws of one instance, and what it lacks.
#[derive(Debug, Clone, Default)]
pub struct Cut {
    /// By number, so parents come before their children.
    pub steps: Vec<Step>,
    /// Patches that are not there, in no order: with priorities above 0 what the view wants, others for what it may want soon.
    pub wishes: Vec<Wish>,
    /// Nodes that are there, not drawn, and may be soon.
    pub near: Vec<u32>,
    /// What was met.
    pub counts: Counts,
    /// The level in work, and the next.
    pub(super) found: [Vec<Found>; 2],
}

impl Cut {
    /// Nodes whose samples are drawn, by number, and the limits of their ranks.
    pub fn drawn(&self) -> impl Iterator<Item = &Step> {
        self.steps.iter().filter(|step| step.role == Role::Drawn)
    }

    /// Index of a node's step.
    pub fn step_of(&self, node: u32) -> Option<usize> {
        self.steps.binary_search_by_key(&node, |step| step.node).ok()
    }

    /// Radius \[cloud units\] of a sample of a step's node: that of the deepest step containing `position`, which is relative to
    /// the index's origin and as the sample's patch has it after decoding.
    ///
    /// Comparisons alone, so that the vertex stage finds the same to the bit. A coordinate that is no number goes to the second
    /// child.
    pub fn radius_of(&self, step: usize, position: [f32; 3]) -> f32 {
        self.deepest(step, position).radius
    }

    /// The deepest step containing the place of a sample of this one.
    pub fn deepest(&self, step: usize, position: [f32; 3]) -> &Step {
        let mut step = &self.steps[step];
        while step.split < 3 {
            let side = if position[step.split as usize] < step.plane { 0 } else { 1 };
            match step.children[side] {
                NONE => break,
                child => step = &self.steps[child as usize],
            }
        }
        step
    }

    pub(super) fn clear(&mut self) {
        self.steps.clear();
        self.wishes.clear();
        self.near.clear();
        self.counts = Counts::default();
    }

    /// Counts a drawn node.
    pub(super) fn count(&mut self, node: u32, samples: u32, limit: u32) {
        self.counts.drawn += 1;
        self.counts.samples += shown(node, samples, limit) as u64;
    }
}
