//! Which patches stay on the device.

use std::collections::VecDeque;

use super::Cut;
use crate::structure::layered::Index;
use crate::structure::nodes::NONE;

/// Victims that are found at a time.
const BATCH: usize = 256;

/// A place for one patch in the device's buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Slot {
    /// Which, from 0 on.
    pub index: u32,
    /// How many patches it has held: what was said of an earlier one is not meant for this one.
    pub generation: u32,
}

/// How many patches could be taken in now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Room {
    /// That views want: in free slots, and in place of what they do not want.
    pub wanted: u32,
    /// That are fetched ahead: in place of what is not even near to being wanted. At most `wanted`.
    pub prefetch: u32,
}

/// Why a patch got no slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Refused {
    /// It has one.
    There,
    /// Its parent has none.
    Orphan,
    /// All slots are in use by the frame marked last, by ones that are not complete, or by what is wanted more.
    Full,
}

/// What a slot holds.
#[derive(Debug, Clone, Copy)]
struct Held {
    /// [`NONE`]: nothing.
    node: u32,
    generation: u32,
    /// Recency: twice the number of the frame that last cared, plus one where it drew it or wanted it. Never more than the
    /// parent's.
    used: u64,
    /// Last frame whose commands read or write it. Never more than the parent's.
    busy: u64,
    /// Frame in which it came.
    since: u64,
}

/// A least-recently-used cache of one model's patches, in slots of equal size: no patch has more samples than the model's M,
/// so bytes are slots, nothing is fragmented, and a slot is found without search.
///
/// - A patch is there only if its parent is; the root stays. That needs no pins: a patch is never used more recently than
///   its parent, so in the order of victims (recency, then larger numbers first) children precede their parents.
/// - What the frame draws whose cuts were marked last, be it this one or one before, is no victim, nor what a frame draws that is not complete, by the host's counter.
/// - A still camera comes to rest: what is [affordable](super::affordable) within [`Cache::room`] only takes the place of what
///   is not wanted. With a factor that [fits](super::factor_for) the number of slots, that is everything that is wanted.
#[derive(Debug, Clone)]
pub struct Cache {
    /// Of each node.
    parents: Vec<u32>,
    slots: Vec<u32>,
    held: Vec<Held>,
    free: Vec<u32>,
    /// The next victims in this frame, with the recency that they had.
    victims: VecDeque<(u64, u32)>,
    frame: u64,
    /// The last frame of which cuts were marked.
    marked: u64,
    completed: u64,
    ramp: u32,
    evicted: u64,
}

impl Cache {
    /// An empty one of `slots` slots, at least 1. A patch comes in over `ramp` frames, at once with 0.
    pub fn new(index: &Index, slots: u32, ramp: u32) -> Cache {
        let empty = Held { node: NONE, generation: 0, used: 0, busy: 0, since: 0 };
        Cache {
            parents: index.nodes.iter().map(|node| node.parent).collect(),
            slots: vec![NONE; index.nodes.len()],
            held: vec![empty; slots as usize],
            // The first is taken from the end.
            free: (0..slots).rev().collect(),
            victims: VecDeque::new(),
            frame: 0,
            marked: 0,
            completed: 0,
            ramp,
            evicted: 0,
        }
    }

    /// Begins a frame. Numbers only grow; frames up to `completed` are done on the device, as in [`retire`](crate::Renderer::retire).
    pub fn begin(&mut self, frame: u64, completed: u64) {
        debug_assert!(frame >= self.frame && completed >= self.completed && completed < frame, "numbers only grow");
        (self.frame, self.completed) = (frame, completed);
        self.victims.clear();
    }

    /// Notes what a view of this frame draws and may want soon.
    pub fn mark(&mut self, cut: &Cut) {
        self.marked = self.frame;
        let drawn = 2 * self.frame + 1;
        // What is hidden is drawn where a test in the frame finds it visible.
        for step in cut.steps.iter().filter(|step| step.role.is_shown()) {
            // Its ancestors are in the cut as well.
            if let Some(held) = self.held.get_mut(self.slots[step.node as usize] as usize) {
                (held.used, held.busy) = (drawn, self.frame);
            }
        }
        cut.near.iter().for_each(|&node| self.raise(node, 2 * self.frame, 0));
    }

    /// The slot of a node that is there.
    pub fn slot(&self, node: u32) -> Option<Slot> {
        let index = self.slots[node as usize];
        self.held.get(index as usize).map(|held| Slot { index, generation: held.generation })
    }

    /// The node in a slot; `None` where that has changed since.
    pub fn node(&self, slot: Slot) -> Option<u32> {
        let held = self.held.get(slot.index as usize)?;
        (held.generation == slot.generation && held.node != NONE).then_some(held.node)
    }

    /// How much of a node's patch is shown, for [`refine`](super::refine): 0 where it is not there, growing to 1 from the frame on
    /// in which it came.
    pub fn presence(&self, node: u32) -> f32 {
        match self.held.get(self.slots[node as usize] as usize) {
            None => 0.0,
            Some(held) => ((self.frame - held.since + 1) as f32 / (self.ramp + 1) as f32).min(1.0),
        }
    }

    /// How many patches could be taken in in this frame, once all its cuts are marked.
    pub fn room(&self) -> Room {
        let below = |limit: u64| self.held.iter().filter(|held| self.yields(held, limit)).count() as u32;
        let free = self.free.len() as u32;
        Room { wanted: free + below(2 * self.frame + 1), prefetch: free + below(2 * self.frame) }
    }

    /// Slots that hold nothing.
    pub fn vacant(&self) -> u32 {
        self.free.len() as u32
    }

    /// Patches that had to go.
    pub fn evicted(&self) -> u64 {
        self.evicted
    }

    /// Gives a patch a slot, which this frame's commands write: a free one or that of the victim. `wanted`: by a view of the frame
    /// marked last, with a priority above 0; otherwise it is fetched ahead.
    pub fn insert(&mut self, node: u32, wanted: bool) -> Result<Slot, Refused> {
        if self.slots[node as usize] != NONE {
            return Err(Refused::There);
        }
        let parent = self.parents[node as usize];
        if parent != NONE && self.slots[parent as usize] == NONE {
            return Err(Refused::Orphan);
        }
        let limit = 2 * self.marked + wanted as u64;
        // First of all, so that the parent is not the victim.
        self.raise(parent, limit, 0);
        let index = match self.free.pop() {
            Some(index) => index,
            None => self.evict(limit).ok_or(Refused::Full)?,
        };
        self.raise(parent, limit, self.frame);
        self.slots[node as usize] = index;
        let held = &mut self.held[index as usize];
        *held = Held { node, generation: held.generation + 1, used: limit, busy: self.frame, since: self.frame };
        Ok(Slot { index, generation: held.generation })
    }

    /// Whether what a slot holds may go for something that is used as recently as `limit`.
    fn yields(&self, held: &Held, limit: u64) -> bool {
        // The root has number 0.
        held.node != NONE && held.node != 0 && held.used < limit && held.busy <= self.completed
    }

    /// Empties the slot of the least recently used patch that may go.
    fn evict(&mut self, limit: u64) -> Option<u32> {
        loop {
            if self.victims.is_empty() {
                self.look_for_victims();
            }
            let &(used, node) = self.victims.front()?;
            if used >= limit {
                return None;
            }
            self.victims.pop_front();
            let index = self.slots[node as usize];
            if self.held.get(index as usize).is_some_and(|held| held.used == used && self.yields(held, limit)) {
                self.held[index as usize].node = NONE;
                self.slots[node as usize] = NONE;
                self.evicted += 1;
                return Some(index);
            }
        }
    }

    /// The first victims in their order. Within a frame patches only become more recent, so what is no victim now will not be
    /// one, and those found stay in their order.
    fn look_for_victims(&mut self) {
        let limit = 2 * self.marked + 1;
        let mut all: Vec<(u64, u32)> =
            self.held.iter().filter(|held| self.yields(held, limit)).map(|held| (held.used, !held.node)).collect();
        if all.len() > BATCH {
            all.select_nth_unstable(BATCH - 1);
            all.truncate(BATCH);
        }
        all.sort_unstable();
        self.victims.extend(all.into_iter().map(|(used, node)| (used, !node)));
    }

    /// Makes a node and its ancestors at least so recent and so busy.
    fn raise(&mut self, mut node: u32, used: u64, busy: u64) {
        while let Some(held) = self.slots.get(node as usize).and_then(|slot| self.held.get_mut(*slot as usize)) {
            if held.used >= used && held.busy >= busy {
                return;
            }
            (held.used, held.busy) = (held.used.max(used), held.busy.max(busy));
            node = self.parents[node as usize];
        }
    }
}
