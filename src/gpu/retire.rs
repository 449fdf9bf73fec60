//! Things that the device may still use, kept until the host says that their frame is complete.

use std::collections::VecDeque;

use super::context::Context;
use super::ordered::OrderedTarget;
use super::resource::{Buffer, Image};
use super::staging::Piece;
use ash::vk;

/// Something to destroy later.
#[derive(Debug)]
pub enum Retired {
    /// A buffer.
    Buffer(Buffer),
    /// An image.
    Image(Image),
    /// A descriptor pool with all its sets.
    DescriptorPool(vk::DescriptorPool),
    /// The target of an ordered pass.
    OrderedTarget(OrderedTarget),
    /// Pieces of a staging pool, which others may fill from then on.
    Pieces(Vec<Piece>),
}

impl Retired {
    fn destroy(self, context: &mut Context) {
        match self {
            Retired::Buffer(buffer) => buffer.destroy(context),
            Retired::Image(image) => image.destroy(context),
            Retired::Pieces(pieces) => drop(pieces),
            Retired::OrderedTarget(target) => context.destroy_ordered_target(target),
            // SAFETY: its frame is complete, so no set of it is in use; destroyed once.
            Retired::DescriptorPool(pool) => unsafe { context.device.destroy_descriptor_pool(pool, None) },
        }
    }
}

/// The queue, in order of frames.
#[derive(Debug, Default)]
pub struct RetireQueue {
    waiting: VecDeque<(u64, Retired)>,
}

impl RetireQueue {
    /// Destroys `what` once `frame` is complete.
    pub fn push(&mut self, frame: u64, what: Retired) {
        debug_assert!(self.waiting.back().is_none_or(|(last, _)| *last <= frame), "frame ids only grow");
        self.waiting.push_back((frame, what));
    }

    /// Destroys everything whose frame is at most `completed`.
    pub fn collect(&mut self, context: &mut Context, completed: u64) {
        while self.waiting.front().is_some_and(|(frame, _)| *frame <= completed) {
            if let Some((_, what)) = self.waiting.pop_front() {
                what.destroy(context);
            }
        }
    }

    /// How many things wait.
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }
}
