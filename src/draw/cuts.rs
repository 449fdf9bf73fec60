//! Cuts of layered point clouds as the shaders read them (`glsl/shared/layered.glsl`).

use crate::select::layered::{Cut, rank};
use crate::structure::nodes::NONE;

/// A table of numbers of steps by slot, and the steps, for every view of every instance of a frame.
#[derive(Debug, Default)]
pub struct CutTable {
    /// All of it.
    pub words: Vec<u32>,
}

/// Words of a step.
const STEP: usize = 8;

impl CutTable {
    /// Adds a cut of a model of which there are so many slots; returns where its table begins. `slot`: of a node that is there.
    pub fn push(&mut self, cut: &Cut, slots: u32, slot: impl Fn(u32) -> Option<u32>) -> u32 {
        let table = self.words.len();
        self.words.resize((table + slots as usize).next_multiple_of(STEP), 0);
        // Steps are two vectors each, counted by vectors.
        let first = (self.words.len() / 4) as u32;
        for (number, step) in cut.steps.iter().enumerate() {
            let at = first + 2 * number as u32;
            if let Some(slot) = slot(step.node) {
                self.words[table + slot as usize] = at;
            }
            let [left, right] = step.children.map(|child| if child == NONE { NONE } else { first + 2 * child });
            // A leaf that is there in full: its samples have radii of their own.
            let own = step.split > 2 && step.limit == u32::MAX;
            self.words.extend([step.plane.to_bits(), step.split as u32, left, right]);
            self.words.extend([step.radius.to_bits(), step.limit, rank(step.node, 0), !own as u32]);
        }
        table as u32
    }

    /// Adds a ball to be tested; returns its place, by vectors.
    pub fn ball(&mut self, ball: [f32; 4]) -> u32 {
        debug_assert!(self.words.len().is_multiple_of(4), "cuts are whole vectors");
        let at = self.words.len() / 4;
        self.words.extend(ball.map(f32::to_bits));
        at as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::layered::{Role, Step};

    #[test]
    fn a_step_is_found_by_its_slot_and_leads_to_its_children() {
        let step = |node, split, children, limit| Step {
            node,
            role: Role::Drawn,
            split,
            plane: -1.5,
            children,
            radius: 0.25,
            limit,
        };
        let steps = vec![step(0, 1, [NONE, 1], u32::MAX), step(7, 3, [NONE; 2], u32::MAX), step(9, 3, [NONE; 2], 5)];
        let mut cut = Cut::default();
        cut.steps.extend(steps);
        let mut table = CutTable { words: vec![77; 3] };
        let at = table.push(&cut, 6, |node| (node < 9).then_some(node / 2 + 1)) as usize;
        assert_eq!(at, 3);
        let of = |slot: usize| 4 * table.words[at + slot] as usize;
        assert_eq!(of(1) % 8, 0, "aligned");
        assert_eq!(table.words[of(1)..][..4], [(-1.5f32).to_bits(), 1, NONE, of(4) as u32 / 4]);
        let attributes = |at: usize| &table.words[at + 4..at + 8];
        assert_eq!(attributes(of(1)), [0.25f32.to_bits(), u32::MAX, rank(0, 0), 1]);
        assert_eq!(attributes(of(4)), [0.25f32.to_bits(), u32::MAX, rank(7, 0), 0], "a leaf");
        assert_eq!(attributes(of(4) + 8), [0.25f32.to_bits(), 5, rank(9, 0), 1], "a leaf that fades in");
        assert_eq!((table.words.len() - of(1)) / STEP, 3);
    }
}
