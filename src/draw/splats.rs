//! Draw calls for everything a view shows: the same for every blend.

use ash::vk;

use crate::gpu::Context;
use crate::gpu::layout::{Command, RunPush};
use crate::gpu::program::Program;
use crate::gpu::resource::Buffer;
use crate::select::Span;
use crate::stats::OrderedAccess;
use crate::structure::flat::{BLOCK, Block};

use super::cloud::DeviceCloud;
use super::faces::FaceRun;
use super::list::{Lists, Test};
use super::occlusion::Tests;
use super::variant::{Pipelines, Role, Variant};

/// Indices of one block of quads: 0 1 2, 2 1 3, then four on.
pub fn quad_indices() -> Vec<u16> {
    (0..BLOCK).flat_map(|q| [0, 1, 2, 2, 1, 3].map(|i| (4 * q + i) as u16)).collect()
}

/// Stages that read the constants of a run.
pub const RUN_STAGES: vk::ShaderStageFlags =
    vk::ShaderStageFlags::from_raw(vk::ShaderStageFlags::VERTEX.as_raw() | vk::ShaderStageFlags::COMPUTE.as_raw());

/// Consecutive points of a chunk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// Index into the cloud's chunks.
    pub chunk: usize,
    /// Index of the first point in the chunk.
    pub first: u32,
    /// Number of points.
    pub count: u32,
    /// See [`Span::least`].
    pub least: f32,
    /// Where the table of its chunk's slots begins in [`CutTable`](super::cuts::CutTable), for layered point clouds.
    pub table: u32,
    /// It may hold splats that a sprite cannot.
    pub large: bool,
    /// Number of the range that lists those of its points that are drawn; `None`: all are.
    pub range: Option<u32>,
}

/// One cloud in one view.
#[derive(Debug, Clone)]
pub struct Draw {
    /// Index into the renderer's clouds of this frame.
    pub cloud: usize,
    /// Byte offset of its parameters.
    pub params: u32,
    /// What is submitted, in this order.
    pub submitted: Vec<Run>,
    /// What is drawn, in this order: that, or ranges of a list of it.
    pub runs: Vec<Run>,
    /// What is drawn only where the query of this number finds it visible, after everything else.
    pub doubtful: Vec<(Run, u32)>,
    /// Numbers of the queries of this draw, and the places of their balls in [`CutTable`](super::cuts::CutTable).
    pub tests: std::ops::Range<u32>,
    /// One a query.
    pub balls: Vec<u32>,
    /// What decides a point by itself, wherever that is done.
    pub test: Test,
    /// Variant for everything.
    pub main: Variant,
    /// Variant for what a sprite cannot hold.
    pub large: Variant,
    /// Faces, drawn before all points.
    pub faces: Vec<FaceRun>,
    /// Variant for those, and the layer that they go to where there are layers.
    pub triangles: (Variant, u32),
}

impl Draw {
    /// Points submitted, those too that a test may keep from being drawn.
    pub fn points(&self) -> u64 {
        self.submitted.iter().chain(self.doubtful.iter().map(|(run, _)| run)).map(|r| r.count as u64).sum()
    }

    /// Whether nothing is drawn but what is doubtful.
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty() && self.faces.is_empty()
    }

    /// Faces submitted.
    pub fn triangles(&self) -> u64 {
        self.faces.iter().map(|r| r.count as u64).sum()
    }

    /// Whether there may be splats that a sprite cannot hold.
    pub fn has_large(&self) -> bool {
        self.runs.iter().chain(self.doubtful.iter().map(|(run, _)| run)).any(|r| r.large)
    }
}

/// Spans of one cloud as runs: cut where chunks end, and where blocks that may hold large splats begin or end. `large`
/// has the indices of those, in order. What is not on the device yet is left out.
pub fn runs(spans: &[Span], chunks: &[[u32; 2]], blocks: &[Block], large: &[u32]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for span in spans {
        let (mut at, end) = (span.first, span.first + span.count);
        while at < end {
            let chunk = chunks.partition_point(|[first, count]| first + count <= at);
            let Some([first, count]) = chunks.get(chunk) else { break };
            // The first large block that ends behind this point.
            let next = large.partition_point(|b| {
                let block = &blocks[*b as usize];
                block.first + block.count <= at
            });
            let next = large.get(next).map(|b| &blocks[*b as usize]);
            let is_large = next.is_some_and(|b| b.first <= at);
            let border = next.map_or(u32::MAX, |b| if is_large { b.first + b.count } else { b.first });
            let stop = end.min(first + count).min(border);
            let run = Run {
                chunk,
                first: at - first,
                count: stop - at,
                least: span.least,
                table: 0,
                large: is_large,
                range: None,
            };
            match runs.last_mut() {
                Some(last) if last.goes_on_with(&run) && last.large == run.large => last.count += run.count,
                _ => runs.push(run),
            }
            at = stop;
        }
    }
    runs
}

impl Run {
    fn goes_on_with(&self, next: &Run) -> bool {
        self.first + self.count == next.first && self.shares_all_with(next)
    }

    /// Whether nothing has to be bound between them.
    fn shares_all_with(&self, next: &Run) -> bool {
        self.chunk == next.chunk
            && (self.least.to_bits(), self.table) == (next.least.to_bits(), next.table)
            && self.range.is_none()
            && next.range.is_none()
    }
}

/// What drawing needs besides the draws.
pub struct Bindings<'a> {
    /// Layouts.
    pub program: &'a Program,
    /// Pipelines, all built.
    pub pipelines: &'a Pipelines,
    /// Set 0: parameters, with a dynamic offset.
    pub params: vk::DescriptorSet,
    /// Set 2: counters and lists.
    pub select: vk::DescriptorSet,
    /// See [`quad_indices`]; there whenever quads are drawn.
    pub indices: Option<&'a Buffer>,
    /// What ranges refer to; there whenever a run has one.
    pub lists: Option<&'a Lists>,
    /// What decides about doubtful runs; there whenever there is one.
    pub tests: Option<&'a Tests>,
    /// The frame's clouds.
    pub clouds: &'a [&'a DeviceCloud],
}

/// What is bound, so that it is not bound again.
#[derive(Default)]
pub(super) struct Bound {
    variant: Option<Variant>,
    chunk: Option<usize>,
    run: Option<(u32, u32)>,
}

impl Bindings<'_> {
    /// Records one role's draws of a view. Returns the number of draw calls.
    pub fn draw(&self, context: &Context, cmd: vk::CommandBuffer, role: Role, draws: &[Draw]) -> u32 {
        let mut calls = 0;
        for draw in draws.iter().filter(|d| !d.is_empty()) {
            let mut bound = self.begin(context, cmd, draw);
            calls += self.faces(context, cmd, role, draw);
            let joined = draw.runs.chunk_by(Run::goes_on_with);
            let joined: Vec<Run> =
                joined.map(|part| Run { count: part.iter().map(|r| r.count).sum(), ..part[0] }).collect();
            for part in joined.chunk_by(Run::shares_all_with) {
                calls += self.runs(context, cmd, &mut bound, draw, Variant { role, ..draw.main }, part);
            }
            for part in draw.runs.chunk_by(Run::shares_all_with) {
                let large: Vec<Run> = part.iter().filter(|r| r.large).copied().collect();
                calls += self.runs(context, cmd, &mut bound, draw, Variant { role, ..draw.large }, &large);
            }
        }
        calls
    }

    /// Binds what `fuzzy` reads and writes, for all draws of a pass.
    pub fn bind_ordered(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        access: OrderedAccess,
        set: vk::DescriptorSet,
    ) {
        let number = match access {
            OrderedAccess::RasterizationOrder => 3,
            OrderedAccess::Interlock => 4,
        };
        self.bind_set(context, cmd, number, set, &[]);
    }

    /// The same for blends that depend on the order: every cloud in stored order, whatever a sprite can hold. Returns the
    /// number of draw calls.
    pub fn draw_ordered(&self, context: &Context, cmd: vk::CommandBuffer, role: Role, draws: &[Draw]) -> u32 {
        let mut calls = 0;
        for draw in draws.iter().filter(|d| !d.is_empty()) {
            let mut bound = self.begin(context, cmd, draw);
            calls += self.faces(context, cmd, role, draw);
            for part in draw.runs.chunk_by(|a, b| a.large == b.large && a.shares_all_with(b)) {
                let variant = if part[0].large { draw.large } else { draw.main };
                calls += self.runs(context, cmd, &mut bound, draw, Variant { role, ..variant }, part);
            }
        }
        calls
    }

    /// Records one role's doubtful runs of a view. `ordered`: as [`draw_ordered`](Bindings::draw_ordered) has them. Returns the number
    /// of draw calls.
    pub fn draw_doubtful(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        role: Role,
        draws: &[Draw],
        ordered: bool,
    ) -> u32 {
        let Some(tests) = self.tests else { return 0 };
        let mut calls = 0;
        for draw in draws.iter().filter(|d| !d.doubtful.is_empty()) {
            let mut bound = self.begin(context, cmd, draw);
            for (run, number) in &draw.doubtful {
                let (main, large) = (Variant { role, ..draw.main }, Variant { role, ..draw.large });
                tests.where_visible(context, cmd, *number, || {
                    let first = if ordered && run.large { large } else { main };
                    let run = std::slice::from_ref(run);
                    calls += self.runs(context, cmd, &mut bound, draw, first, run);
                    if run[0].large && !ordered {
                        calls += self.runs(context, cmd, &mut bound, draw, large, run);
                    }
                });
            }
        }
        calls
    }

    pub(super) fn begin(&self, context: &Context, cmd: vk::CommandBuffer, draw: &Draw) -> Bound {
        self.bind_set(context, cmd, 0, self.params, &[draw.params]);
        self.bind_set(context, cmd, 2, self.select, &[]);
        Bound::default()
    }

    /// Records a draw's faces. Returns the number of draw calls.
    fn faces(&self, context: &Context, cmd: vk::CommandBuffer, role: Role, draw: &Draw) -> u32 {
        if draw.faces.is_empty() {
            return 0;
        }
        let (variant, layer) = draw.triangles;
        let pipeline = self.pipelines.get(&Variant { role, ..variant });
        context.bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
        let push = RunPush { first: 0, count: layer, least: 0.0, table: 0, padding: [] };
        context.push(cmd, self.program.layout, RUN_STAGES, bytemuck::bytes_of(&push));
        let mut chunk = usize::MAX;
        for run in &draw.faces {
            if chunk != run.chunk {
                chunk = run.chunk;
                self.bind_set(context, cmd, 1, self.clouds[draw.cloud].faces[chunk].set, &[]);
            }
            context.draw(cmd, 3 * run.first, 3 * run.count);
        }
        draw.faces.len() as u32
    }

    fn bind_set(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        number: u32,
        set: vk::DescriptorSet,
        offsets: &[u32],
    ) {
        context.bind_sets(cmd, vk::PipelineBindPoint::GRAPHICS, self.program.layout, number, &[set], offsets);
    }

    /// Records runs that share all that is bound; one with a range is alone. Returns the number of draw calls.
    fn runs(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        bound: &mut Bound,
        draw: &Draw,
        variant: Variant,
        runs: &[Run],
    ) -> u32 {
        let Some(run) = runs.first() else { return 0 };
        let chunk = &self.clouds[draw.cloud].chunks[run.chunk];
        let indirect = run.range.map(|range| {
            let lists = self.lists.expect("lists were made for ranges");
            (lists, range as u64 * size_of::<Command>() as u64)
        });
        if bound.variant != Some(variant) {
            context.bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.pipelines.get(&variant));
            match (variant.quads, indirect) {
                (false, Some((lists, _))) => context.bind_list(cmd, lists.list.handle),
                (true, None) => {
                    let indices = self.indices.expect("indices were made for quads");
                    context.bind_indices(cmd, indices.handle);
                }
                (true, Some(_)) | (false, None) => {}
            }
            bound.variant = Some(variant);
            bound.chunk = None;
        }
        if bound.chunk != Some(run.chunk) {
            if !variant.quads {
                context.bind_streams(cmd, &chunk.streams());
            }
            self.bind_set(context, cmd, 1, chunk.set, &[]);
            bound.chunk = Some(run.chunk);
        }
        if bound.run != Some((run.least.to_bits(), run.table)) {
            let push = RunPush { first: 0, count: 0, least: run.least, table: run.table, padding: [] };
            context.push(cmd, self.program.layout, RUN_STAGES, bytemuck::bytes_of(&push));
            bound.run = Some((run.least.to_bits(), run.table));
        }
        match (variant.quads, indirect) {
            (false, Some((lists, at))) => context.draw_indexed_indirect(cmd, lists.commands.handle, at),
            (true, Some((lists, at))) => {
                let at = at + std::mem::offset_of!(Command, vertices) as u64;
                context.draw_indirect(cmd, lists.commands.handle, at);
            }
            (false, None) => {
                let info = |run: &Run| vk::MultiDrawInfoEXT { first_vertex: run.first, vertex_count: run.count };
                return context.draw_each(cmd, &runs.iter().map(info).collect::<Vec<_>>());
            }
            (true, None) => {
                let mut calls = 0;
                for run in runs {
                    let end = run.first + run.count;
                    for first in (run.first..end).step_by(BLOCK) {
                        // As many as there are indices at most; the vertices lie in the chunk's buffers.
                        context.draw_indexed(cmd, 6 * (end - first).min(BLOCK as u32), 4 * first as i32);
                        calls += 1;
                    }
                }
                return calls;
            }
        }
        1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_keep_the_order_and_end_where_chunks_and_large_blocks_do() {
        let block = |i: u32| Block {
            first: 10 * i,
            count: 10 - i / 4,
            min: glam::Vec3::ZERO,
            max: glam::Vec3::ZERO,
            radius: 1.0,
        };
        let blocks: Vec<Block> = (0..5).map(block).collect();
        let chunks = [[0, 20], [20, 29]];
        let span = |first, count, least| Span { instance: 0, first, count, least };
        let found = |spans: &[Span], large: &[u32]| -> Vec<(usize, u32, u32, f32, bool)> {
            let all = runs(spans, &chunks, &blocks, large);
            all.iter().map(|r| (r.chunk, r.first, r.count, r.least, r.large)).collect()
        };
        let all = [span(0, 49, 0.0)];
        assert_eq!(found(&all, &[]), [(0, 0, 20, 0.0, false), (1, 0, 29, 0.0, false)]);
        assert_eq!(
            found(&all, &[1, 2]),
            [(0, 0, 10, 0.0, false), (0, 10, 10, 0.0, true), (1, 0, 10, 0.0, true), (1, 10, 19, 0.0, false)]
        );
        let parts = [span(5, 3, 0.0), span(8, 4, 0.5), span(12, 1, 0.5), span(40, 20, 0.0)];
        assert_eq!(
            found(&parts, &[0]),
            [(0, 5, 3, 0.0, true), (0, 8, 2, 0.5, true), (0, 10, 3, 0.5, false), (1, 20, 9, 0.0, false)],
            "what is beyond the last chunk is not there yet"
        );
        assert_eq!(found(&[], &[0]), []);
    }

    #[test]
    fn a_block_of_quads_just_fits_sixteen_bit_indices() {
        let indices = quad_indices();
        assert_eq!(indices.len(), 6 * BLOCK);
        assert_eq!(indices[..12], [0, 1, 2, 2, 1, 3, 4, 5, 6, 6, 5, 7]);
        assert_eq!(*indices.last().unwrap() as usize, 4 * BLOCK - 1);
    }
}
