//! The cache of a layered point cloud's patches against an oracle, and whole frames with a slow source.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};

use surfel::select::Sight;
use surfel::select::layered::{
    Cache, Cut, Limit, Refine, Refused, Role, Slot, Step, affordable, factor_for, refine, wishes,
};
use surfel::structure::nodes::NONE;

use crate::layered_common::{Model, Random, any_sight, surface};

/// What is there, with recency and last frame on the device.
struct Oracle<'a> {
    model: &'a Model,
    there: BTreeMap<u32, (u64, u64)>,
    slots: usize,
    frame: u64,
    marked: u64,
    completed: u64,
}

impl Oracle<'_> {
    fn up(&mut self, mut node: u32, used: u64, busy: u64) {
        while node != NONE {
            let Some(held) = self.there.get_mut(&node) else { return };
            *held = (held.0.max(used), held.1.max(busy));
            node = self.model.index.nodes[node as usize].parent;
        }
    }

    /// The least recently used without children, the larger number first.
    fn victim(&self, limit: u64) -> Option<u32> {
        let parents: BTreeSet<u32> = self.there.keys().map(|n| self.model.index.nodes[*n as usize].parent).collect();
        let may_go = self.there.iter().filter(|(node, (used, busy))| {
            **node > 0 && !parents.contains(node) && *used < limit && *busy <= self.completed
        });
        may_go.min_by_key(|(node, (used, _))| (*used, u32::MAX - **node)).map(|(node, _)| *node)
    }

    fn insert(&mut self, node: u32, wanted: bool) -> Result<Option<u32>, Refused> {
        let parent = self.model.index.nodes[node as usize].parent;
        if self.there.contains_key(&node) {
            return Err(Refused::There);
        }
        if parent != NONE && !self.there.contains_key(&parent) {
            return Err(Refused::Orphan);
        }
        let limit = 2 * self.marked + wanted as u64;
        self.up(parent, limit, 0);
        let victim = if self.there.len() < self.slots { None } else { Some(self.victim(limit).ok_or(Refused::Full)?) };
        victim.map(|victim| self.there.remove(&victim));
        self.up(parent, limit, self.frame);
        self.there.insert(node, (limit, self.frame));
        Ok(victim)
    }

    /// How many could go one after the other.
    fn room(&self, limit: u64) -> u32 {
        let mut rest = Oracle { there: self.there.clone(), ..*self };
        let mut count = (self.slots - self.there.len()) as u32;
        while let Some(victim) = rest.victim(limit) {
            rest.there.remove(&victim);
            count += 1;
        }
        count
    }
}

fn step(node: u32) -> Step {
    let (children, split, plane) = ([NONE; 2], 3, 0.0);
    Step { node, role: Role::Drawn, split, plane, children, radius: 1.0, limit: u32::MAX }
}

#[test]
fn victims_are_the_oracle_s() {
    let model = Model::build(&surface(3000, 1), 16);
    let mut random = Random(30);
    let (mut evicted, mut refused) = (0, [0; 3]);
    for slots in [1, 2, 17, 60, 400] {
        let mut cache = Cache::new(&model.index, slots, 0);
        let mut oracle =
            Oracle { model: &model, there: BTreeMap::new(), slots: slots as usize, frame: 0, marked: 0, completed: 0 };
        let mut given: HashMap<Slot, u32> = HashMap::new();
        let mut drawn = BTreeSet::new();
        for frame in 1..150u64 {
            let lag = 1 + random.below(4) as u64;
            (oracle.frame, oracle.completed) = (frame, oracle.completed.max(frame.saturating_sub(lag)));
            cache.begin(frame, oracle.completed);
            // What comes may come before the cuts of its frame are known, or after.
            for known in [false, true] {
                if known {
                    // A random set with all ancestors is drawn, and some of the others may be soon.
                    let mut cut = Cut::default();
                    drawn.clear();
                    for &node in oracle.there.keys() {
                        let parent = model.index.nodes[node as usize].parent;
                        if (parent == NONE || drawn.contains(&parent)) && random.unit() < 0.8 {
                            drawn.insert(node);
                            cut.steps.push(step(node));
                        } else if drawn.contains(&parent) && random.unit() < 0.5 {
                            cut.near.push(node);
                        }
                    }
                    cache.mark(&cut);
                    oracle.marked = frame;
                    drawn.iter().for_each(|n| oracle.up(*n, 2 * frame + 1, frame));
                    cut.near.iter().for_each(|n| oracle.up(*n, 2 * frame, 0));
                    let room = cache.room();
                    assert_eq!((room.wanted, room.prefetch), (oracle.room(2 * frame + 1), oracle.room(2 * frame)));
                }
                for _ in 0..random.below(15) {
                    // Any, or more often one whose parent is there.
                    let mut node = if oracle.there.is_empty() { 0 } else { random.below(model.len()) as u32 };
                    if let Some(parent) = oracle.there.keys().nth(random.below(oracle.there.len().max(1))) {
                        let child = model.index.nodes[*parent as usize].children[random.below(2)];
                        node = if child == NONE || random.unit() < 0.3 { node } else { child };
                    }
                    let wanted = random.unit() < 0.6;
                    let before = cache.evicted();
                    match (cache.insert(node, wanted), oracle.insert(node, wanted)) {
                        (Ok(slot), Ok(victim)) => {
                            assert!(
                                slot.index < slots && given.insert(slot, node).is_none(),
                                "a slot is new each time"
                            );
                            assert_eq!(cache.evicted() - before, victim.is_some() as u64);
                            assert!(
                                victim.is_none_or(|victim| !drawn.contains(&victim)),
                                "drawn by the frame marked last"
                            );
                            evicted += victim.is_some() as usize;
                        }
                        (Err(a), Err(b)) => {
                            assert_eq!(a, b);
                            refused[a as usize] += 1;
                        }
                        (got, expected) => panic!("{got:?} for {expected:?}"),
                    }
                    // What is there, and what a slot that was given once says today.
                    for n in 0..model.len() as u32 {
                        assert_eq!(cache.slot(n).is_some(), oracle.there.contains_key(&n), "frame {frame}, node {n}");
                        assert_eq!(cache.presence(n) > 0.0, cache.slot(n).is_some());
                    }
                    for (slot, n) in &given {
                        let now = (cache.slot(*n) == Some(*slot)).then_some(*n);
                        assert_eq!(cache.node(*slot), now);
                    }
                }
            }
        }
    }
    assert!(evicted > 300 && refused.iter().all(|n| *n > 100), "{evicted}, {refused:?}");
}

#[test]
fn a_patch_comes_in_over_some_frames() {
    let model = Model::build(&surface(500, 1), 16);
    let mut cache = Cache::new(&model.index, 8, 3);
    cache.begin(5, 4);
    cache.insert(0, true).unwrap();
    let seen: Vec<f32> = (5..10)
        .map(|frame| {
            cache.begin(frame, frame - 1);
            cache.presence(0)
        })
        .collect();
    assert_eq!(seen, [0.25, 0.5, 0.75, 1.0, 1.0]);
    assert_eq!(cache.presence(1), 0.0);
}

/// Frames with a source that answers late, and a device that completes late.
struct Frames<'a> {
    model: &'a Model,
    cache: Cache,
    flying: VecDeque<(u64, u32, bool)>,
    frame: u64,
    random: Random,
    fetched: usize,
}

impl Frames<'_> {
    /// One frame of these views; their cuts, and how many patches were asked for.
    fn next(&mut self, sights: &[Sight], options: &Refine) -> (Vec<Cut>, usize) {
        self.frame += 1;
        let before = self.cache.evicted();
        self.cache.begin(self.frame, self.frame.saturating_sub(3));
        let (due, later): (Vec<_>, Vec<_>) = self.flying.drain(..).partition(|(due, ..)| *due <= self.frame);
        self.flying.extend(later);
        for (_, node, wanted) in due {
            self.fetched += self.cache.insert(node, wanted).is_ok() as usize;
        }
        let mut cuts = vec![Cut::default(); sights.len()];
        for (sight, cut) in sights.iter().zip(&mut cuts) {
            refine(&self.model.index, sight, options, |node| self.cache.presence(node), cut);
            self.cache.mark(cut);
        }
        let wished = wishes(&cuts);
        let asked = affordable(&wished, 2000, self.cache.room());
        for wish in &wished[..asked] {
            if !self.flying.iter().any(|(_, node, _)| *node == wish.node) {
                let due = self.frame + 1 + self.random.below(5) as u64;
                self.flying.push_back((due, wish.node, wish.priority > 0.0));
            }
        }
        for cut in &cuts {
            assert!(cut.drawn().all(|step| self.cache.slot(step.node).is_some()), "what this frame draws stays");
        }
        assert!(self.cache.evicted() >= before);
        (cuts, asked)
    }
}

#[test]
fn a_still_camera_comes_to_rest_with_all_that_fits() {
    let model = Model::build(&surface(3000, 1), 16);
    let mut random = Random(31);
    let (mut coarser, mut moved) = (0, 0);
    for (slots, fitted, prefetch) in
        [(30, true, 1.0), (60, true, 0.3), (60, false, 1.0), (60, false, 0.3), (1, true, 0.5)]
    {
        let cache = Cache::new(&model.index, slots, 2);
        let mut frames =
            Frames { model: &model, cache, flying: VecDeque::new(), frame: 0, random: Random(32), fetched: 0 };
        for place in 0..12 {
            // Two views, or two instances, with one cache.
            let sights = [any_sight(&mut random), any_sight(&mut random)];
            let mut options = Refine { prefetch, ..Refine::default() };
            if fitted {
                options.factor = factor_for(&model.index, &sights, &options, Limit::Patches(slots), 1.0);
                coarser += (options.factor > 1.0) as usize;
            }
            (0..300).for_each(|_| drop(frames.next(&sights, &options)));
            let (before, gone) = (frames.fetched, frames.cache.evicted());
            for _ in 0..50 {
                let (cuts, asked) = frames.next(&sights, &options);
                let missing: u32 = cuts.iter().map(|cut| cut.counts.missing).sum();
                assert_eq!(asked, 0, "{slots} slots, place {place}: nothing more is asked for");
                assert!(!fitted || missing == 0, "{slots} slots, place {place}: all that fits is there");
                for (cut, sight) in cuts.iter().zip(&sights).filter(|_| fitted) {
                    let mut whole = Cut::default();
                    refine(&model.index, sight, &options, |_| 1.0, &mut whole);
                    assert_eq!(cut.counts.drawn, whole.counts.drawn);
                    assert_eq!(cut.counts.samples, whole.counts.samples);
                }
            }
            assert_eq!((frames.fetched, frames.cache.evicted()), (before, gone));
        }
        moved += frames.cache.evicted();
    }
    assert!(coarser > 10 && moved > 200, "{coarser}, {moved}");
}
