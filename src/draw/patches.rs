//! Patches of a layered point cloud on the device: slots of equal size in a few buffers, filled as frames ask for them. Nothing here
//! waits: what is not there is not drawn, and coarser samples stand for it.

use std::collections::{HashSet, VecDeque};
use std::sync::Arc;

use glam::Vec3;

use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::resource::Buffer;
use crate::gpu::staging::{Piece, Pool};
use crate::gpu::upload::Upload;
use crate::host::CloudId;
use crate::select::Sight;
use crate::select::layered::{
    Cache, Cut, Limit, Occlusion, Refine, Verdict, affordable, factor_visible, refine_visible, tested_ball, wishes,
};
use crate::stats::LayeredStats;
use crate::stream::{Fetcher, Want};
use crate::structure::flat::Block;
use crate::structure::layered::{Index, Layered, Patch};

use super::cloud::{CHUNK, Chunk};
use super::cuts::CutTable;
use super::occlusion::Tested;
use super::splats::Run;

/// A patch as the device keeps it, in staging memory since it was decoded.
#[derive(Debug)]
struct Ready {
    piece: Piece,
    /// Of these samples alone, with their own radii.
    bounds: Block,
}

/// Where a patch of `samples` has its normals, its colours and its groups in its piece, and how many bytes it has in all: each stream
/// begins at a multiple of 16, and what a model has none of has its place.
fn streams(samples: u64) -> [u64; 4] {
    let normals = 16 * samples;
    let colors = normals + (4 * samples).next_multiple_of(16);
    let groups = colors + (4 * samples).next_multiple_of(16);
    [normals, colors, groups, groups + samples.next_multiple_of(16)]
}

impl Ready {
    fn new(mut piece: Piece, patch: &Patch) -> Ready {
        let place = |p: &[f32; 3]| Vec3::from_array(*p);
        let bounds = Block {
            first: 0,
            count: patch.positions.len() as u32,
            min: patch.positions.iter().map(place).fold(Vec3::INFINITY, Vec3::min),
            max: patch.positions.iter().map(place).fold(Vec3::NEG_INFINITY, Vec3::max),
            radius: patch.radii.iter().copied().fold(0.0, f32::max),
        };
        let bytes = piece.bytes();
        for (to, ([x, y, z], r)) in bytes.chunks_exact_mut(16).zip(patch.positions.iter().zip(&patch.radii)) {
            to.copy_from_slice(bytemuck::bytes_of(&[*x, *y, *z, *r]));
        }
        let [normals, colors, groups, _] = streams(bounds.count.into());
        if let Some(of) = &patch.groups {
            bytes[groups as usize..][..of.len()].copy_from_slice(of);
        }
        for (at, words) in [(normals, &patch.normals), (colors, &patch.colors)] {
            if let Some(words) = words {
                bytes[at as usize..][..size_of_val(&words[..])].copy_from_slice(bytemuck::cast_slice(words));
            }
        }
        Ready { piece, bounds }
    }

    fn bytes(&self) -> u64 {
        streams(self.bounds.count.into())[3]
    }
}

/// Staging memory of a model, and so what has come and was not yet copied, at most; at least four patches \[bytes\].
const STAGED: u64 = 16 << 20;

/// One view of one instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Seen {
    /// Index of the view.
    pub view: usize,
    /// Index of the instance.
    pub instance: usize,
}

/// What one view draws of one instance in this frame.
#[derive(Debug)]
struct Part {
    seen: Seen,
    cut: Cut,
    /// Where its table begins.
    table: u32,
    /// What is known of its nodes.
    known: Occlusion,
    /// What becomes of each step.
    verdicts: Vec<Verdict>,
    /// Numbers of its queries, and their balls.
    tests: std::ops::Range<u32>,
    balls: Vec<u32>,
}

/// What a view draws of an instance.
#[derive(Debug, Default)]
pub struct Shown {
    /// In any case.
    pub runs: Vec<Run>,
    /// Where the query of this number finds it visible.
    pub doubtful: Vec<(Run, u32)>,
    /// Numbers of the queries, and the places of their balls in the table.
    pub tests: std::ops::Range<u32>,
    /// One a query.
    pub balls: Vec<u32>,
}

/// What a frame does about occlusion.
pub struct Occluding<'a> {
    /// The model's name in this frame.
    pub cloud: CloudId,
    /// Size of what a footprint covers beyond its radius, over the threshold; `None`: nothing is tested.
    pub margin: Option<f64>,
    /// All tests of the frame, by number.
    pub tests: &'a mut Vec<Tested>,
}

impl Part {
    fn new(seen: Seen) -> Part {
        Part {
            seen,
            cut: Cut::default(),
            table: 0,
            known: Occlusion::default(),
            verdicts: Vec::new(),
            tests: 0..0,
            balls: Vec::new(),
        }
    }

    /// Decides which nodes are tested, and which of them are drawn only if they are visible.
    fn judge(&mut self, index: &Index, sight: &Sight, frame: u64, table: &mut CutTable, occluding: &mut Occluding) {
        let Part { seen, cut, known, verdicts, balls, .. } = self;
        let first = occluding.tests.len() as u32;
        balls.clear();
        verdicts.clear();
        verdicts.resize(cut.steps.len(), Verdict::Draw);
        if let Some(margin) = occluding.margin {
            let mut alone = true;
            for step in (0..cut.steps.len()).filter(|s| cut.steps[*s].role.is_shown()) {
                let node = cut.steps[step].node;
                let Some(ball) = tested_ball(index, sight, cut, step, sight.tau * margin) else {
                    known.forget(node);
                    alone = false;
                    continue;
                };
                let verdict = known.ask(node, frame, alone);
                alone &= verdict == Verdict::TestFirst;
                verdicts[step] = verdict;
                if verdict != Verdict::Draw {
                    balls.push(table.ball(ball));
                    let samples = if verdict == Verdict::TestFirst { index.nodes[node as usize].samples } else { 0 };
                    occluding.tests.push(Tested { cloud: occluding.cloud, seen: *seen, node, samples });
                }
            }
            known.keep(frame);
        }
        self.tests = first..occluding.tests.len() as u32;
    }
}

/// The patches of one model.
#[derive(Debug)]
pub struct Patches {
    model: Arc<Layered>,
    cache: Cache,
    /// Before the threads that wait for its pieces: they end only once it is closed.
    pool: Pool,
    fetcher: Fetcher<Ready>,
    /// Slots have 2 to this many samples.
    shift: u32,
    slots: u32,
    /// By slot.
    bounds: Vec<Block>,
    /// Came and not yet uploaded.
    waiting: VecDeque<(u32, Ready)>,
    /// Never to be had, and why the latest was not.
    lost: HashSet<u32>,
    broken: Option<String>,
    /// Of this frame; the first `used`.
    parts: Vec<Part>,
    used: usize,
    wanted: Vec<Want>,
    /// Drawn at most.
    pub samples: Option<u64>,
    stats: LayeredStats,
}

/// Slots of 2^`shift` samples that a chunk holds.
fn of_chunk(shift: u32) -> u32 {
    (CHUNK >> shift).max(1) as u32
}

impl Patches {
    /// Starts the threads that fetch, and asks for the root.
    pub fn new(context: &mut Context, model: Arc<Layered>) -> Result<Patches> {
        let options = &model.streaming;
        let shift = model.largest().next_power_of_two().trailing_zeros();
        let words = 4 + model.flat.has_normals() as u64 + model.flat.has_colors() as u64;
        let slot = (4 * words + model.flat.groups.is_some() as u64) << shift;
        let slots = (options.cache / slot).clamp(2, model.index.nodes.len().max(2) as u64) as u32;
        let piece = streams(1 << shift)[3];
        let pool = Pool::new(context, piece, (STAGED / piece).clamp(4, slots.max(4).into()) as u32)?;
        let (decoder, pieces) = (Arc::clone(&model), pool.pieces());
        let decode = move |node: u32, bytes: Vec<u8>| {
            let patch = decoder.decode(node, &bytes)?;
            let piece = pieces.take().ok_or_else(|| Error::Unsupported("the model was removed".into()))?;
            Ok(Ready::new(piece, &patch))
        };
        let fetcher = match Fetcher::with_options(Arc::clone(&model.access), options.fetch, decode) {
            Ok(fetcher) => fetcher,
            Err(e) => {
                pool.close().destroy(context);
                return Err(e);
            }
        };
        let nothing = Block { first: 0, count: 0, min: Vec3::ZERO, max: Vec3::ZERO, radius: 0.0 };
        let mut patches = Patches {
            cache: Cache::new(&model.index, slots, options.ramp),
            pool,
            fetcher,
            shift,
            slots,
            bounds: vec![nothing; slots as usize],
            waiting: VecDeque::new(),
            lost: HashSet::new(),
            broken: None,
            parts: Vec::new(),
            used: 0,
            wanted: Vec::new(),
            samples: options.samples,
            stats: LayeredStats::default(),
            model,
        };
        if let Some(root) = patches.model.index.nodes.first() {
            patches.wanted.push(Want { key: 0, at: root.at, bytes: root.bytes, priority: f32::INFINITY });
            patches.fetcher.want(&patches.wanted);
        }
        Ok(patches)
    }

    /// Ends the threads. The pool's buffer may go once the frames that copy from it are complete.
    pub fn end(self) -> Buffer {
        let buffer = self.pool.close();
        drop(self.fetcher);
        buffer
    }

    /// First points and numbers of points of the chunks that hold all slots.
    pub fn chunks(&self) -> impl Iterator<Item = (u32, u32)> + use<> {
        let (all, shift, step) = (self.slots, self.shift, of_chunk(self.shift));
        (0..all).step_by(step as usize).map(move |first| (first << shift, step.min(all - first) << shift))
    }

    /// Bits of a point's number within its slot.
    pub fn shift(&self) -> u32 {
        self.shift
    }

    /// Whether what is hidden is looked for.
    pub fn occlusion(&self) -> bool {
        self.model.streaming.occlusion
    }

    /// Finds what the views draw, of what is there, after [`take_in`](Patches::take_in). `sights`: what this frame shows of the model.
    pub fn select(
        &mut self,
        frame: u64,
        sights: &[(Seen, Sight)],
        back_faces_culled: bool,
        table: &mut CutTable,
        occluding: &mut Occluding,
    ) {
        let (index, streaming) = (&self.model.index, self.model.streaming);
        let mut options = Refine {
            rule: streaming.rule,
            back_faces_culled,
            fade: streaming.fade,
            prefetch: streaming.prefetch,
            factor: 1.0,
        };
        self.used = sights.len();
        while self.parts.len() < self.used {
            self.parts.push(Part::new(Seen { view: 0, instance: 0 }));
        }
        for (part, (seen, _)) in self.parts.iter_mut().zip(sights).filter(|(part, (seen, _))| part.seen != *seen) {
            *part = Part::new(*seen);
        }
        let tests = occluding.margin.is_some();
        let (parts, all): (_, Vec<Sight>) = (&self.parts, sights.iter().map(|(_, sight)| sight.clone()).collect());
        let hidden = |view: usize, node: u32| tests && parts[view].known.hidden(node);
        let factor = |limit| factor_visible(index, &all, &options, hidden, limit, 1.0);
        // Where all of the model has room, nothing has to be found out.
        let room = ((self.slots as usize) < index.nodes.len()).then(|| factor(Limit::Patches(self.slots)));
        let samples = self.samples.map(|most| factor(Limit::Samples(most)));
        options.factor = room.unwrap_or(1.0).max(samples.unwrap_or(1.0));
        self.stats.factor = options.factor;
        for (part, (_, sight)) in self.parts.iter_mut().zip(sights) {
            let hidden = |node| tests && part.known.hidden(node);
            refine_visible(index, sight, &options, |node| self.cache.presence(node), hidden, &mut part.cut);
            self.cache.mark(&part.cut);
            let slot = |node| self.cache.slot(node).map(|slot| slot.index);
            part.table = table.push(&part.cut, self.slots, slot);
            part.judge(index, sight, frame, table, occluding);
            self.stats.cut += part.cut.counts;
            self.stats.tested += part.balls.len() as u32;
            self.stats.occlusion_idle |= part.known.is_idle();
        }
    }

    /// Begins a frame, and takes in what has come, as far as `budget` bytes and the slots go: this frame draws it. What the frame before
    /// drew stays, since this one most likely draws it too.
    pub fn take_in(&mut self, frame: u64, completed: u64, chunks: &[Chunk], budget: u64) -> Option<Upload> {
        self.cache.begin(frame, completed);
        self.stats = LayeredStats { slots: self.slots, ..LayeredStats::default() };
        if self.waiting.is_empty() {
            for (node, patch) in self.fetcher.take() {
                match patch {
                    Ok(patch) => self.waiting.push_back((node, patch)),
                    Err(error) => {
                        self.lost.insert(node);
                        self.broken = Some(error.to_string());
                    }
                }
            }
        }
        let (mut bytes, mut placed) = (0, Vec::new());
        while let Some((node, patch)) = self.waiting.pop_front() {
            // The first in any case.
            if bytes > 0 && bytes + patch.bytes() > budget {
                self.waiting.push_front((node, patch));
                break;
            }
            bytes += patch.bytes();
            let wanted = self.wanted.iter().any(|want| want.key == node && want.priority > 0.0);
            match self.cache.insert(node, wanted) {
                Ok(slot) => {
                    self.bounds[slot.index as usize] = patch.bounds;
                    placed.push((slot.index, patch));
                }
                // It is asked for again if it is still wanted.
                Err(_) => self.stats.refused += 1,
            }
        }
        self.stats.arrived = placed.len() as u32;
        (!placed.is_empty()).then(|| self.copies(chunks, placed))
    }

    /// Copies of patches to their slots.
    fn copies(&self, chunks: &[Chunk], placed: Vec<(u32, Ready)>) -> Upload {
        let (mut upload, per) = (Upload::of_pieces(&self.pool), of_chunk(self.shift));
        for stream in 0..4 {
            for (slot, patch) in &placed {
                let chunk = &chunks[(slot / per) as usize];
                let samples = u64::from(patch.bounds.count);
                let [normals, colors, groups, _] = streams(samples);
                let (at, to, bytes) = match stream {
                    0 => (0, Some(&chunk.geometry), 16),
                    1 => (normals, chunk.normals.as_ref(), 4),
                    2 => (colors, chunk.colors.as_ref(), 4),
                    _ => (groups, chunk.groups.as_ref(), 1),
                };
                if let Some(to) = to {
                    let first = u64::from(slot % per) << self.shift;
                    upload.copy(patch.piece.offset() + at, to, bytes * first, bytes * samples);
                }
            }
        }
        placed.into_iter().for_each(|(_, patch)| upload.keep(patch.piece));
        upload
    }

    /// Asks for what the views of this frame lack.
    pub fn ask(&mut self) {
        let wishes = wishes(self.parts[..self.used].iter().map(|part| &part.cut));
        let lacking = |node: u32| {
            self.cache.slot(node).is_none()
                && !self.lost.contains(&node)
                && self.waiting.iter().all(|(waits, _)| *waits != node)
        };
        let wishes: Vec<_> = wishes.into_iter().filter(|wish| lacking(wish.node)).collect();
        let count = affordable(&wishes, self.model.streaming.wishes, self.cache.room());
        self.wanted.clear();
        self.wanted.extend(wishes[..count].iter().map(|w| Want {
            key: w.node,
            at: w.at,
            bytes: w.bytes,
            priority: w.priority,
        }));
        self.fetcher.want(&self.wanted);
        self.stats.wished = count as u32;
    }

    /// What a view draws of an instance, patch by patch, coarse to fine. `large`: whether a block, with the radius given, may hold
    /// splats that a sprite cannot.
    pub fn shown(&self, seen: Seen, mut large: impl FnMut(&Block) -> bool) -> Shown {
        let Some(part) = self.part(seen).map(|i| &self.parts[i]) else { return Shown::default() };
        let mut shown = Shown { tests: part.tests.clone(), balls: part.balls.clone(), ..Shown::default() };
        let mut query = part.tests.start;
        for (step, verdict) in part.cut.steps.iter().zip(&part.verdicts) {
            let Some(slot) = self.cache.slot(step.node).filter(|_| step.role.is_shown()) else { continue };
            let block = self.bounds[slot.index as usize];
            let (chunk, within) = (slot.index / of_chunk(self.shift), slot.index % of_chunk(self.shift));
            let run = Run {
                chunk: chunk as usize,
                first: within << self.shift,
                count: block.count,
                least: 0.0,
                table: part.table + chunk * of_chunk(self.shift),
                large: large(&Block { radius: block.radius.max(step.radius), ..block }),
                range: None,
            };
            match verdict {
                Verdict::TestFirst => shown.doubtful.push((run, query)),
                Verdict::Draw | Verdict::Recheck => shown.runs.push(run),
            }
            query += (*verdict != Verdict::Draw) as u32;
        }
        shown
    }

    /// A test of an earlier frame has found this.
    pub fn learn(&mut self, test: &Tested, frame: u64, visible: bool) {
        if let Some(part) = self.part(test.seen) {
            self.parts[part].known.learn(test.node, frame, visible);
        }
    }

    /// Index of a part of this frame: they are in order.
    fn part(&self, seen: Seen) -> Option<usize> {
        self.parts[..self.used].binary_search_by_key(&seen, |part| part.seen).ok()
    }

    /// This frame's account.
    pub fn stats(&self) -> LayeredStats {
        let mut stats = self.stats.clone();
        stats.fetched = self.fetcher.stats();
        stats.fault = self.fetcher.fault().map(|fault| fault.to_string()).or_else(|| self.broken.clone());
        stats.evicted = self.cache.evicted();
        stats.resident = self.slots - self.cache.vacant();
        stats
    }
}
