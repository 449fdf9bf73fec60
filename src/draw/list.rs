//! Compaction: the numbers of the points in the cut as an index list, written by three compute passes and drawn indirectly
//! (`glsl/shared/list.glsl`). The processor never learns how many there are.

use ash::vk;

use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::barrier::Access;
use crate::gpu::layout::{Command, Range, RunPush};
use crate::gpu::memory::Location;
use crate::gpu::pass::{Recorder, Use};
use crate::gpu::resource::Buffer;
use crate::structure::Packing;
use crate::structure::nodes::ErrorRule;
use crate::style::Interval;

use super::splats::{Bindings, RUN_STAGES, Run};
use super::variant::{Step, Variant};

/// Points a tile, as in `glsl/shared/list.glsl`.
const TILE: u32 = 512;
/// Bytes of a tile's marks.
const MARKS: u64 = TILE as u64 / 8;
/// Groups of a dispatch: the least limit that a device has.
const GROUPS: u32 = 65_535;

/// What decides a point by itself; `None`: nothing does.
pub type Test = Option<(Interval, ErrorRule)>;

/// What a frame compacts.
#[derive(Debug, Default)]
pub struct Listing {
    tiles: Vec<[u32; 2]>,
    ranges: Vec<Range>,
    jobs: Vec<Job>,
    entries: u64,
}

/// Consecutive tiles that share their bindings.
#[derive(Debug)]
struct Job {
    cloud: usize,
    chunk: usize,
    params: u32,
    test: Test,
    tiles: std::ops::Range<u32>,
}

impl Listing {
    /// Adds runs of one chunk, to be tested as `test` says, as one range: their points are drawn by one call, wherever they
    /// lie. Returns its number.
    pub fn add(&mut self, [cloud, chunk]: [usize; 2], params: u32, test: Test, runs: &[Run]) -> u32 {
        let start = self.tiles.len() as u32;
        for run in runs {
            let end = run.first + run.count;
            self.tiles.extend((run.first..end).step_by(TILE as usize).map(|at| [at, TILE.min(end - at)]));
        }
        let tiles = start..self.tiles.len() as u32;
        self.ranges.push(Range {
            first: start,
            tiles: tiles.len() as u32,
            base: self.entries as u32,
            unused: 0,
            padding: [],
        });
        self.entries += runs.iter().map(|r| r.count as u64).sum::<u64>();
        match self.jobs.last_mut() {
            Some(job) if (job.cloud, job.chunk, job.params) == (cloud, chunk, params) => job.tiles.end = tiles.end,
            _ => self.jobs.push(Job { cloud, chunk, params, test, tiles }),
        }
        self.ranges.len() as u32 - 1
    }

    /// Whether nothing is compacted.
    pub fn is_empty(&self) -> bool {
        self.ranges.is_empty()
    }
}

/// What that takes on the device; kept by a slot while it is enough.
#[derive(Debug)]
pub struct Lists {
    tiles: Buffer,
    ranges: Buffer,
    marks: Buffer,
    places: Buffer,
    /// Numbers of points within their chunks.
    pub list: Buffer,
    /// A [`Command`] a range.
    pub commands: Buffer,
    /// Where list and commands are copied to for the processor.
    kept: Option<Buffer>,
}

impl Lists {
    /// Makes room, twice as much as is needed so that a moving view seldom needs more. `keep`: also to copy back.
    pub fn new(context: &mut Context, listing: &Listing, keep: bool) -> Result<Lists> {
        let most = context.limits.max_storage_buffer_range as u64;
        let entries = (2 * listing.entries * 4).min(most).max(4);
        if listing.entries * 4 > entries || listing.entries > u32::MAX as u64 / 6 {
            let text = format!("compaction of {} points in a frame: this device binds {most} B", listing.entries);
            return Err(Error::Unsupported(text));
        }
        let [tiles, ranges] = [listing.tiles.len(), listing.ranges.len()].map(|n| 2 * n.max(1) as u64);
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let source = vk::BufferUsageFlags::TRANSFER_SRC;
        let (index, indirect) = (vk::BufferUsageFlags::INDEX_BUFFER, vk::BufferUsageFlags::INDIRECT_BUFFER);
        let commands = ranges * size_of::<Command>() as u64;
        let mut wanted = vec![
            ("tiles", tiles * 8, storage, Location::Upload),
            ("ranges", ranges * size_of::<Range>() as u64, storage, Location::Upload),
            ("marks", tiles * MARKS, storage, Location::Device),
            ("places", tiles * 4, storage, Location::Device),
            ("list", entries, storage | index | source, Location::Device),
            ("commands", commands, storage | indirect | source, Location::Device),
        ];
        if keep {
            wanted.push(("kept list", entries + commands, vk::BufferUsageFlags::TRANSFER_DST, Location::Readback));
        }
        let mut made = Vec::new();
        for (name, size, usage, location) in wanted {
            match Buffer::new(context, name, size, usage, location) {
                Ok(buffer) => made.push(buffer),
                Err(e) => {
                    made.into_iter().for_each(|b: Buffer| b.destroy(context));
                    return Err(e);
                }
            }
        }
        let kept = if keep { made.pop() } else { None };
        let Ok([tiles, ranges, marks, places, list, commands]) = <[Buffer; 6]>::try_from(made) else {
            unreachable!("six were made")
        };
        Ok(Lists { tiles, ranges, marks, places, list, commands, kept })
    }

    /// Whether there is room.
    pub fn holds(&self, listing: &Listing, keep: bool) -> bool {
        self.tiles.size >= listing.tiles.len() as u64 * 8
            && self.ranges.size >= (listing.ranges.len() * size_of::<Range>()) as u64
            && self.list.size >= listing.entries * 4
            && (self.kept.is_some() || !keep)
    }

    /// The buffers in the order of their bindings, from 1 on.
    pub fn bindings(&self) -> [vk::Buffer; 6] {
        [&self.tiles, &self.ranges, &self.marks, &self.places, &self.list, &self.commands].map(|b| b.handle)
    }

    /// Writes the tables; the last frame that used them is complete.
    pub fn write(&mut self, listing: &Listing) {
        let tiles: &[u8] = bytemuck::cast_slice(&listing.tiles);
        let ranges: &[u8] = bytemuck::cast_slice(&listing.ranges);
        self.tiles.bytes()[..tiles.len()].copy_from_slice(tiles);
        self.ranges.bytes()[..ranges.len()].copy_from_slice(ranges);
    }

    /// What was kept: the numbers listed for each range.
    pub fn read(&mut self, listing: &Listing) -> Vec<Vec<u32>> {
        let list_size = self.list.size as usize;
        let Some(kept) = &mut self.kept else { return Vec::new() };
        let (list, commands) = kept.bytes().split_at(list_size);
        let commands = commands.chunks_exact(size_of::<Command>()).map(bytemuck::pod_read_unaligned::<Command>);
        let numbers = |c: Command| {
            let part = &list[4 * c.first_index as usize..][..4 * c.indices as usize];
            part.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect()
        };
        commands.take(listing.ranges.len()).map(numbers).collect()
    }

    /// Destroys everything; no frame uses it.
    pub fn destroy(self, context: &mut Context) {
        let Lists { tiles, ranges, marks, places, list, commands, kept } = self;
        [tiles, ranges, marks, places, list, commands].into_iter().chain(kept).for_each(|b| b.destroy(context));
    }
}

/// Records the passes. Returns the number of dispatches.
pub fn record(recorder: &mut Recorder, bindings: &Bindings, lists: &Lists, listing: &Listing) -> u32 {
    let mut calls = 0;
    let (layout, point) = (bindings.program.layout, vk::PipelineBindPoint::COMPUTE);
    let push = |context: &Context, cmd, first| {
        let run = RunPush { first, count: 0, least: 0.0, table: 0, padding: [] };
        context.push(cmd, layout, RUN_STAGES, bytemuck::bytes_of(&run));
    };
    let mut tiles = |context: &Context, cmd, step| {
        for job in &listing.jobs {
            let cloud = bindings.clouds[job.cloud];
            let chunk = &cloud.chunks[job.chunk];
            let variant = Variant::compute(job.test, cloud.flat().packing(), step);
            context.bind_pipeline(cmd, point, bindings.pipelines.get(&variant));
            context.bind_sets(cmd, point, layout, 0, &[bindings.params, chunk.set, bindings.select], &[job.params]);
            for first in job.tiles.clone().step_by(GROUPS as usize) {
                push(context, cmd, first);
                context.dispatch(cmd, (job.tiles.end - first).min(GROUPS));
                calls += 1;
            }
        }
    };
    let after = || vec![Use::Memory(Access::ComputeWrite, Access::ComputeWrite)];
    // The last frame that read these buffers is complete, which layers that do not know the host's semaphores cannot tell.
    let before = vec![Use::Memory(Access::VertexRead, Access::ComputeWrite)];
    recorder.pass("mark", before, |context, cmd| tiles(context, cmd, Step::Mark));
    let mut scans = 0;
    recorder.pass("scan", after(), |context, cmd| {
        let Some(job) = listing.jobs.first() else { return };
        let chunk = &bindings.clouds[job.cloud].chunks[job.chunk];
        context.bind_pipeline(cmd, point, bindings.pipelines.get(&Variant::compute(None, Packing::Full, Step::Scan)));
        context.bind_sets(cmd, point, layout, 0, &[bindings.params, chunk.set, bindings.select], &[job.params]);
        let ranges = listing.ranges.len() as u32;
        for first in (0..ranges).step_by(GROUPS as usize) {
            push(context, cmd, first);
            context.dispatch(cmd, (ranges - first).min(GROUPS));
            scans += 1;
        }
    });
    recorder.pass("list", after(), |context, cmd| tiles(context, cmd, Step::List));
    recorder.barrier(vec![Use::Memory(Access::ComputeWrite, Access::VertexRead)]);
    if let Some(kept) = &lists.kept {
        recorder.pass("keep list", vec![Use::Memory(Access::ComputeWrite, Access::CopyRead)], |context, cmd| {
            context.copy(cmd, &lists.list, kept, 0);
            context.copy(cmd, &lists.commands, kept, lists.list.size);
        });
        recorder.barrier(vec![Use::Memory(Access::CopyWrite, Access::HostRead)]);
    }
    calls + scans
}
