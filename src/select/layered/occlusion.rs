//! Which nodes are behind other things, as far as is known, and which are to be tested (Gobbetti, Marton: Layered Point Clouds,
//! 2004, section 4.3; the published order is: draw what was visible, test the rest, draw what of that is visible).
//!
//! What is believed here only decides when a test is made and whether a node is refined; whether a hidden node is drawn, its test in
//! the very frame decides, on the device.

use std::collections::HashMap;

use super::Cut;
use crate::select::Sight;
use crate::structure::layered::Index;
use crate::structure::nodes::NONE;

/// Frames from one test of a visible node to the next: at first, and at most. They double from test to test.
const WAIT: [u32; 2] = [2, 64];
/// Where less than this share of the tests finds something hidden, new nodes are not tested before they are drawn.
const YIELD: f32 = 1.0 / 64.0;
/// What a test counts for in the share.
const WEIGHT: f32 = 1.0 / 256.0;

/// What becomes of a node of a cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It is drawn.
    Draw,
    /// It is drawn, and tested for the next frames.
    Recheck,
    /// It is drawn where its test finds it visible.
    TestFirst,
}

/// What is known of a node.
#[derive(Debug, Clone, Copy)]
struct Known {
    hidden: bool,
    /// The last frame that asked for it.
    asked: u64,
    /// The frame of the next test, and the wait until then.
    due: u64,
    wait: u32,
}

/// What is known of the nodes in one view of one instance.
#[derive(Debug, Clone, Default)]
pub struct Occlusion {
    known: HashMap<u32, Known>,
    /// Share of tests that found something hidden, lately; 1 before there was any.
    share: Option<f32>,
}

impl Occlusion {
    /// Whether a node was hidden when it was tested last.
    pub fn hidden(&self, node: u32) -> bool {
        self.known.get(&node).is_some_and(|known| known.hidden)
    }

    /// Whether so little is hidden that new nodes are not tested before they are drawn.
    pub fn is_idle(&self) -> bool {
        self.share.is_some_and(|share| share < YIELD)
    }

    /// What becomes of a node of this frame's cut that can be tested. `alone`: nothing else is drawn that could hide it.
    pub fn ask(&mut self, node: u32, frame: u64, alone: bool) -> Verdict {
        let idle = self.is_idle();
        // Nodes that came together are not tested together for ever.
        let spread = node.wrapping_mul(0x9e37_79b9) >> 16;
        let new = || {
            let wait = if idle { WAIT[1] } else { WAIT[0] };
            Known { hidden: false, asked: 0, due: frame + 1 + u64::from(spread % wait), wait }
        };
        let first = !self.known.contains_key(&node);
        let known = self.known.entry(node).or_insert_with(new);
        known.asked = frame;
        if known.hidden || (first && !idle && !alone) {
            return Verdict::TestFirst;
        }
        if known.due > frame {
            return Verdict::Draw;
        }
        // Not again before the answer is here.
        known.due = frame + u64::from(known.wait);
        Verdict::Recheck
    }

    /// A node of this frame's cut cannot be tested: what was known of it is forgotten.
    pub fn forget(&mut self, node: u32) {
        self.known.remove(&node);
    }

    /// A test of some frame has found this.
    pub fn learn(&mut self, node: u32, frame: u64, visible: bool) {
        let share = self.share.unwrap_or(1.0);
        self.share = Some(share + WEIGHT * (f32::from(!visible) - share));
        let Some(known) = self.known.get_mut(&node) else { return };
        match (known.hidden, visible) {
            (true, true) => (known.wait, known.due) = (WAIT[0], frame + u64::from(WAIT[0])),
            (false, true) => {
                known.wait = (2 * known.wait).min(WAIT[1]);
                known.due = known.due.max(frame + u64::from(known.wait));
            }
            (_, false) => {}
        }
        known.hidden = !visible;
    }

    /// Forgets what this frame's cut no longer has.
    pub fn keep(&mut self, frame: u64) {
        self.known.retain(|_, known| known.asked == frame);
    }
}

/// The ball whose icosahedron is tested for a step of a cut: round all that is drawn in the node's region whatever is below it, and a
/// pixel more. Centre and radius \[cloud units\]; `None` where the eye is so near that it is visible without a test.
///
/// `pixel`: size of a pixel at distance 1, or without perspective anywhere, times how many a footprint reaches beyond its radius.
///
/// As in the test against the frustum: the node's own samples are no larger than their radius in the parent's region or their own, and
/// the ancestors' samples in its region lie within the parent's spacing of one of its own and reach as far again.
pub fn tested_ball(index: &Index, sight: &Sight, cut: &Cut, step: usize, pixel: f64) -> Option<[f32; 4]> {
    let step = &cut.steps[step];
    let node = &index.nodes[step.node as usize];
    let mut reach = node.reach.max(step.radius);
    if node.parent != NONE {
        let parent = &index.nodes[node.parent as usize];
        let above = cut.step_of(node.parent).map_or(0.0, |at| cut.steps[at].radius);
        reach = reach.max(2.0 * parent.spacing.max(parent.published).max(above));
    }
    let radius = node.ball as f64 + reach as f64 * sight.radius_scale;
    let centre = node.centre.as_dvec3();
    let away = if sight.eye.w == 0.0 { 1.0 } else { (centre - sight.eye.truncate()).length() + radius };
    // Twice, since a pixel of a corner is larger than one in the middle, and centres of pixels lie within pixels.
    let radius = (radius + 2.0 * pixel * away) * (1.0 + 1e-6);
    let near = sight.planes[4];
    // The icosahedron's corners are farther out than its faces.
    let clear = near.truncate().dot(centre) + near.w > AROUND * radius;
    clear.then(|| [node.centre.x, node.centre.y, node.centre.z, (radius as f32).next_up()])
}

/// Radius of the ball through an icosahedron's corners over that of the ball within: 1 / 0.79465.
const AROUND: f64 = 1.258_408_572_364_819;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_visible_is_tested_ever_more_seldom() {
        let mut known = Occlusion::default();
        assert_eq!(known.ask(7, 1, true), Verdict::Draw, "nothing could hide it");
        let (mut tested, mut last) = (Vec::new(), 1);
        for frame in 2..400 {
            match known.ask(7, frame, false) {
                Verdict::Draw => {}
                Verdict::Recheck => {
                    known.learn(7, frame, true);
                    tested.push(frame - last);
                    last = frame;
                }
                Verdict::TestFirst => panic!("it is visible"),
            }
            known.keep(frame);
        }
        assert!(tested.is_sorted() && tested[0] <= 2 && tested[tested.len() - 1] == 64, "{tested:?}");
    }

    #[test]
    fn what_is_hidden_is_tested_in_every_frame_until_it_is_seen() {
        let mut known = Occlusion::default();
        assert_eq!(known.ask(3, 1, false), Verdict::TestFirst, "new, and other things are drawn");
        known.learn(3, 1, false);
        for frame in 2..20 {
            assert!(known.hidden(3));
            assert_eq!(known.ask(3, frame, false), Verdict::TestFirst);
            known.learn(3, frame, false);
        }
        known.learn(3, 20, true);
        assert!(!known.hidden(3));
        assert_eq!(known.ask(3, 21, false), Verdict::Draw);
        assert_eq!(known.ask(3, 22, false), Verdict::Recheck, "soon");
        known.learn(3, 22, false);
        assert!(known.hidden(3));
        // Gone from the cut, then new again.
        known.keep(23);
        assert!(!known.hidden(3));
        known.learn(3, 22, false);
        assert!(!known.hidden(3), "an answer that comes too late says nothing");
    }

    #[test]
    fn where_nothing_is_hidden_new_nodes_are_not_held_up() {
        let mut known = Occlusion::default();
        for node in 0..2000 {
            known.learn(node, 1, true);
        }
        assert!(known.is_idle());
        let tests = (0..6400).filter(|n| known.ask(*n, 2, false) != Verdict::Draw).count();
        assert_eq!(tests, 0, "none before it is drawn");
        let tests = (0..6400).filter(|n| known.ask(*n, 3, false) != Verdict::Draw).count();
        // One in 64, spread by a hash of the number: 100 ± 5 · √100.
        assert!((50..150).contains(&tests), "{tests}");
        (0..12).for_each(|_| known.learn(1, 3, false));
        assert!(!known.is_idle(), "and are again once something is");
    }
}
