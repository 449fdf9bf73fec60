//! The recursion: which sample goes to which node, and how large those are that do not say. The same for a part in memory and one in a file.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use bytemuck::Zeroable;
use glam::Vec3;

use super::finish::{Draft, Grown};
use super::region::{Cut, Region};
use super::select::{self, Chosen};
use super::spool::{BUFFER, Folder, Spool, Writer};
use super::{Options, Sampling};
use crate::error::{Error, Place, Result};
use crate::load::{PointCloud, attributes};
use crate::rng::Rng;
use crate::structure::layered::patch::{Content, Sample};
use crate::structure::layered::{MAX_LEVEL, MAX_SAMPLES};
use crate::structure::octahedral;

/// Bytes that a sample takes while its subtree is grown in memory: itself, once more while it is handed to a child, its
/// patch (at most 24), and the nodes; measured below 90.
pub(super) const GROWING: u64 = 96;
/// No leaf's spacing is more than this times what covers its parent.
const STRAY: f32 = 4.0;
/// Fewer points do not tell a surface from strays: each is asked for 16 neighbours.
const FEW: usize = 17;
/// Subtrees of fewer samples are one task.
const TASK: usize = 1 << 15;

/// What all parts of one model share.
pub(super) struct Maker<'a> {
    pub options: &'a Options<'a>,
    pub content: Content,
    pub folder: std::sync::Arc<Folder>,
    /// Samples in all, and in finished nodes.
    pub total: u64,
    pub done: AtomicU64,
    /// A part in memory and room to divide it, kept from one part to the next: what is freed and taken again, large and of
    /// ever another size, the allocator does not find again (70 MiB instead of 50 with 64 to work in).
    pub held: Mutex<[Vec<Sample>; 2]>,
}

/// What a node knows from above.
pub(super) struct Above {
    /// The ancestors' samples on its side of every cut.
    pub samples: Vec<Sample>,
    pub level: u8,
    /// Least distance of the parent's samples \[world units\]; 0 for the root.
    pub radius: f32,
    /// What covers all of the parent's region; 0 where that is not known.
    pub most: f32,
    /// r of the parent, its M_tot, and N − M: equations 1 and 2.
    pub published: f32,
    pub total: f64,
    pub rest: f64,
    /// Of the random numbers.
    pub seed: u64,
}

impl Above {
    pub fn root(seed: u64) -> Above {
        Above { samples: vec![], level: 0, radius: 0.0, most: 0.0, published: 0.0, total: 0.0, rest: 0.0, seed }
    }
}

/// An inner node before its children are.
struct Inner {
    draft: Draft,
    cut: Cut,
    /// Of the part, ascending: which records are its samples.
    taken: Vec<u64>,
}

/// What is known of a part's records as they are dealt out, one after the other.
struct Dealt {
    own: Vec<Sample>,
    regions: [Region; 2],
    /// Square of the distance of the farthest record from the centre.
    ball: f32,
    /// Records that were dealt out.
    count: u64,
}

impl Inner {
    fn dealt(&self) -> Dealt {
        Dealt { own: Vec::with_capacity(self.taken.len()), regions: [Region::EMPTY; 2], ball: 0.0, count: 0 }
    }

    /// The child that the next record goes to; `None` if the node keeps it.
    fn deal(&self, record: &Sample, dealt: &mut Dealt) -> Option<usize> {
        dealt.ball = dealt.ball.max(self.draft.centre.distance_squared(record.position.into()));
        let taken = self.taken.get(dealt.own.len()) == Some(&dealt.count);
        dealt.count += 1;
        if taken {
            dealt.own.push(*record);
            return None;
        }
        let side = self.cut.side(record.position);
        dealt.regions[side].add(record.position);
        Some(side)
    }
}

impl Maker<'_> {
    /// A part in a file: in memory as soon as it fits.
    pub fn grow(
        &self,
        part: Spool<Sample>,
        region: Region,
        above: Above,
        patches: &mut Writer<u8>,
    ) -> Result<Box<Grown>> {
        let n = part.count();
        if n.saturating_mul(GROWING) <= self.room() || n <= self.options.samples as u64 {
            let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
            let [records, room] = &mut *held;
            part.load_to(records)?;
            drop(part);
            room.resize(records.len(), Sample::zeroed());
            let mut grown = self.grow_here(records, room, region, above)?;
            grown.flush(patches)?;
            return Ok(grown);
        }
        let inner = self.inner(n, &region, &above, |picks| {
            let mut one = [Sample::zeroed()];
            picks.iter().map(|i| part.read(*i, &mut one).map(|()| one[0].position)).collect()
        })?;
        let Some(inner) = inner else { return Err(self.heap(n, &region)) };
        let mut dealt = inner.dealt();
        let mut writers = [self.folder.writer()?, self.folder.writer()?];
        let mut wrong = Ok(());
        let mut buffers: [Vec<Sample>; 2] = Default::default();
        part.each(|_, records| {
            for record in records {
                if let Some(side) = inner.deal(record, &mut dealt) {
                    buffers[side].push(*record);
                }
            }
            for (writer, buffer) in writers.iter_mut().zip(&mut buffers) {
                writer.push(buffer)?;
                buffer.clear();
            }
            Ok(())
        })?;
        drop((part, buffers));
        let [first, second] = writers;
        let spools = [first.finish()?, second.finish()?];
        let mut children = [None, None];
        for (side, spool) in spools.into_iter().enumerate() {
            if spool.count() > 0 && wrong.is_ok() {
                let below = inner.below(side, &dealt, &above, n);
                match self.grow(spool, dealt.regions[side], below, patches) {
                    Ok(grown) => children[side] = Some(grown),
                    Err(e) => wrong = Err(e),
                }
            }
        }
        wrong?;
        let mut grown = self.complete(inner, dealt, &above, children)?;
        grown.flush(patches)?;
        Ok(grown)
    }

    /// Bytes for a part in memory: what buffers of files do not need.
    fn room(&self) -> u64 {
        self.options.memory.saturating_sub(16 * BUFFER as u64)
    }

    /// A part in memory, and as much room. Subtrees are grown side by side.
    fn grow_here(
        &self,
        records: &mut [Sample],
        room: &mut [Sample],
        region: Region,
        above: Above,
    ) -> Result<Box<Grown>> {
        let n = records.len();
        let picked = |picks: &[u64]| Ok(picks.iter().map(|i| records[*i as usize].position).collect());
        let Some(inner) = self.inner(n as u64, &region, &above, picked)? else {
            if n > MAX_SAMPLES as usize {
                return Err(self.heap(n as u64, &region));
            }
            let mut own = records.to_vec();
            let found = self.radii(&mut own, &region, &above);
            let draft = self.leaf(&own, &region, &above);
            return self.finish(draft, own, [None, None], found);
        };
        // Both parts keep their order: the first moves up, the second goes through the other room.
        let mut dealt = inner.dealt();
        let mut ends = [0; 2];
        for i in 0..n {
            let record = records[i];
            if let Some(side) = inner.deal(&record, &mut dealt) {
                let part = if side == 0 { &mut *records } else { &mut *room };
                part[ends[side]] = record;
                ends[side] += 1;
            }
        }
        let (first, rest) = records.split_at_mut(ends[0]);
        let (second, _) = rest.split_at_mut(ends[1]);
        second.copy_from_slice(&room[..ends[1]]);
        let (room_of_first, room_of_second) = room.split_at_mut(ends[0]);
        let child = |side: usize, part: &mut [Sample], room: &mut [Sample]| -> Result<Option<Box<Grown>>> {
            if part.is_empty() {
                return Ok(None);
            }
            let below = inner.below(side, &dealt, &above, n as u64);
            self.grow_here(part, room, dealt.regions[side], below).map(Some)
        };
        let (first, second) = match n > TASK {
            true => rayon::join(|| child(0, first, room_of_first), || child(1, second, room_of_second)),
            false => (child(0, first, room_of_first), child(1, second, room_of_second)),
        };
        let children = [first?, second?];
        self.complete(inner, dealt, &above, children)
    }

    fn complete(
        &self,
        inner: Inner,
        mut dealt: Dealt,
        above: &Above,
        mut children: [Option<Box<Grown>>; 2],
    ) -> Result<Box<Grown>> {
        let mut draft = inner.draft;
        draft.ball = dealt.ball.sqrt();
        draft.cut = Some(inner.cut);
        let found = inner.found(&mut dealt.own, above, &mut children);
        self.finish(draft, dealt.own, children, found)
    }

    /// Radii of a leaf's records that have none; with the ancestors' samples, which lie among them, that is all there is in the leaf's
    /// region. One for all where they lie evenly, else as a flat cloud's are found, which takes longer. What lies beyond the leaf's
    /// border is not asked: there it is a border of the surface as well.
    /// Returns those of the ancestors' samples; none where none is wanted.
    fn radii(&self, own: &mut [Sample], region: &Region, above: &Above) -> Vec<f32> {
        let all = || own.iter().chain(&above.samples);
        if all().all(|s| s.radius > 0.0) {
            return Vec::new();
        }
        let mut found = match even(own, region, above) {
            Some(radius) => vec![radius; own.len() + above.samples.len()],
            None => {
                let normal = |s: &Sample| octahedral::decode(s.normal).map_or(Vec3::ZERO, |n| n.as_vec3());
                let mut cloud = PointCloud {
                    positions: all().map(|s| s.position.into()).collect(),
                    normals: Some(all().map(normal).collect()),
                    ..PointCloud::default()
                };
                attributes::complete(&mut cloud, &attributes::Options::default());
                cloud.radii.unwrap_or_default()
            }
        };
        // Strays are not covered as if there were a surface between them. More points tell for themselves; what covers the parent's points
        // is no bound there, since where they are thin all of them are its samples.
        if found.len() < FEW && above.most > 0.0 {
            found.iter_mut().for_each(|r| *r = r.min(STRAY * above.most));
        }
        let of_others = found.split_off(own.len());
        own.iter_mut().zip(found).filter(|(s, _)| s.radius == 0.0).for_each(|(s, r)| s.radius = r);
        of_others
    }

    /// More records at one place, or deeper down than levels go, than a patch holds.
    fn heap(&self, n: u64, region: &Region) -> Error {
        let at = region.centre();
        let why = format!("{n} points lie about {at} of the origin, too close to tell apart: at most {MAX_SAMPLES}");
        Error::data(self.options.name, Place::File, why)
    }

    /// Draws candidates of a part of `n` records and chooses; `None` for a leaf. `picked` has the positions of records.
    fn inner(
        &self,
        n: u64,
        region: &Region,
        above: &Above,
        picked: impl FnOnce(&[u64]) -> Result<Vec<[f32; 3]>>,
    ) -> Result<Option<Inner>> {
        let wanted = self.options.samples as usize;
        let cut = region.cut().filter(|_| n > wanted as u64 && above.level < MAX_LEVEL);
        let Some(cut) = cut else { return Ok(None) };
        let mut rng = Rng::new(above.seed);
        let picks = candidates(n, wanted as u64 * self.options.candidates as u64, &mut rng);
        let side = region.extent();
        let unit = |p: &[f32; 3]| region.unit(*p);
        let places: Vec<Vec3> = picked(&picks)?.iter().map(unit).collect();
        let near: Vec<Vec3> = above.samples.iter().map(|s| unit(&s.position)).collect();
        // Without a parent: as far as so many points can lie apart in a cube.
        let radius = if above.radius > 0.0 { above.radius / side } else { 1.5 / (wanted as f32).cbrt() };
        let random = self.options.sampling == Sampling::Random;
        let Chosen { samples, spacing, most, radius } =
            select::choose(&places, &near, wanted, radius.min(2.0), random, &mut rng);
        let (spacing, most) = (spacing * side, most * side);
        let (published, total) = published(above, n, wanted, spacing);
        let draft = Draft {
            level: above.level,
            centre: region.centre(),
            spacing,
            most,
            radius: radius * side,
            published,
            total,
            ..Draft::default()
        };
        Ok(Some(Inner { draft, cut, taken: samples.iter().map(|c| picks[*c as usize]).collect() }))
    }

    fn leaf(&self, records: &[Sample], region: &Region, above: &Above) -> Draft {
        let centre = region.centre();
        let square = records.iter().map(|r| centre.distance_squared(r.position.into())).fold(0.0, f32::max);
        let mut radii: Vec<f32> = records.iter().map(|r| r.radius).collect();
        // Nine in ten are no larger.
        let at = (radii.len() - 1) * 9 / 10;
        let found = *radii.select_nth_unstable_by(at, f32::total_cmp).1;
        // Strays are not covered as if there were a surface between them.
        let most = if above.most > 0.0 { (STRAY * above.most).min(f32::MAX) } else { f32::MAX };
        let spacing = found.min(most);
        let (published, total) = published(above, records.len() as u64, records.len(), spacing);
        Draft { level: above.level, centre, ball: square.sqrt(), spacing, most, published, total, ..Draft::default() }
    }

    /// So many samples more are in their patches.
    pub fn count(&self, samples: usize) {
        let done = self.done.fetch_add(samples as u64, Ordering::Relaxed) + samples as u64;
        self.options.report("tree", done, self.total);
    }
}

impl Inner {
    /// What a child knows from above.
    fn below(&self, side: usize, dealt: &Dealt, above: &Above, n: u64) -> Above {
        let all = above.samples.iter().chain(&dealt.own);
        Above {
            samples: all.filter(|s| self.cut.side(s.position) == side).copied().collect(),
            level: above.level + 1,
            radius: self.draft.radius,
            most: self.draft.most,
            published: self.draft.published,
            total: self.draft.total,
            rest: n as f64 - self.taken.len() as f64,
            seed: Rng::new(above.seed ^ (side as u64 + 1)).bits(),
        }
    }

    /// Gives its samples the radii that leaves below found, and returns those of the ancestors' samples, in the order of
    /// [`Inner::below`]; 0 where there is no leaf.
    fn found(&self, own: &mut [Sample], above: &Above, children: &mut [Option<Box<Grown>>; 2]) -> Vec<f32> {
        let mut below = children.each_mut().map(|c| c.as_mut().map_or_else(Vec::new, |c| std::mem::take(&mut c.found)));
        if below.iter().all(Vec::is_empty) {
            return Vec::new();
        }
        below.iter_mut().for_each(|b| b.reverse());
        let mut next = |s: &Sample| below[self.cut.side(s.position)].pop().unwrap_or(0.0);
        let found = above.samples.iter().map(&mut next).collect();
        for s in own {
            let radius = next(s);
            if s.radius == 0.0 {
                s.radius = radius;
            }
        }
        found
    }
}

/// One radius for all of a leaf's points, if they lie evenly: of some of them, none is spaced as no random sampling of one density is
/// (d₈ varies by 18 %: of 96, from 0.6 to 1.4 of the middle one, times what tells even from random). Nine in ten are no larger.
/// Half of those asked are the ancestors' samples: a thin half of a region has hardly any points of its own, but half of those.
fn even(own: &[Sample], region: &Region, above: &Above) -> Option<f32> {
    let points: Vec<Vec3> = own.iter().chain(&above.samples).map(|s| region.unit(s.position)).collect();
    let mut found = select::spacings(&points[..own.len()], &points);
    found.extend(select::spacings(&points[own.len()..], &points));
    found.sort_unstable_by(f32::total_cmp);
    let Some(&middle) = found.get(found.len() / 2) else {
        // All at one place: what covers the parent's region, if there is one.
        return (above.most > 0.0).then_some(above.most);
    };
    let (least, most) = (found[0], found[found.len() - 1]);
    let even = least >= 0.4 * middle && most <= 2.0 * middle;
    even.then(|| found[found.len() * 9 / 10] * region.extent())
}

/// r and M_tot of a node of `n` records and `m` samples by equations 1 and 2. The root's r is its measured spacing.
fn published(above: &Above, n: u64, m: usize, spacing: f32) -> (f32, f64) {
    if above.level == 0 {
        return (spacing, m as f64);
    }
    let share = n as f64 / above.rest;
    let total = share * above.total + m as f64;
    ((above.published as f64 * (share * above.total / total).sqrt()) as f32, total)
}

/// Numbers of about `wanted` of `n` records, ascending: one at random in each of so many equal runs. Neighbours in the
/// input mostly are neighbours in space, so that this is more even than any `wanted` of them, and needs no pass of its own.
fn candidates(n: u64, wanted: u64, rng: &mut Rng) -> Vec<u64> {
    if n <= wanted {
        return (0..n).collect();
    }
    let run = n as f64 / wanted as f64;
    let mut picks: Vec<u64> = (0..wanted).map(|i| (((i as f64 + rng.unit()) * run) as u64).min(n - 1)).collect();
    picks.dedup();
    picks
}
