//! How many splats a frame draws, and how many not, by what: a compute pass for statistics alone. It runs the very
//! function that the vertex stage runs, `project` of `glsl/shared/splat.glsl`.

use ash::vk;

use crate::gpu::barrier::Access;
use crate::gpu::layout::{Counts, RunPush};
use crate::gpu::pass::{Recorder, Use};
use crate::gpu::resource::Buffer;
use crate::stats::Culled;

use super::splats::{Bindings, Draw, RUN_STAGES, Run};

/// Threads of a group, as in `glsl/select/count.comp`.
const GROUP: u32 = 64;
/// Groups a dispatch: the least limit that a device has is 65,535; a grid-stride loop does the rest.
const GROUPS: u32 = 1024;

/// Counts all views' draws into `counts`. Returns the number of dispatches.
pub fn record(recorder: &mut Recorder, bindings: &Bindings, counts: &Buffer, views: &[Vec<Draw>]) -> u32 {
    let mut calls = 0;
    recorder.pass("clear counts", vec![Use::Memory(Access::HostRead, Access::CopyWrite)], |context, cmd| {
        context.zero(cmd, counts.handle);
    });
    recorder.pass("count", vec![Use::Memory(Access::CopyWrite, Access::ComputeWrite)], |context, cmd| {
        for draw in views.iter().flatten() {
            let variant = draw.main.count(draw.test);
            let (layout, point) = (bindings.program.layout, vk::PipelineBindPoint::COMPUTE);
            context.bind_pipeline(cmd, point, bindings.pipelines.get(&variant));
            let count = |run: &Run| {
                let chunk = &bindings.clouds[draw.cloud].chunks[run.chunk];
                let sets = [bindings.params, chunk.set, bindings.select];
                context.bind_sets(cmd, point, layout, 0, &sets, &[draw.params]);
                let (first, count, least, table) = (run.first, run.count, run.least, run.table);
                let push = RunPush { first, count, least, table, padding: [] };
                context.push(cmd, layout, RUN_STAGES, bytemuck::bytes_of(&push));
                context.dispatch(cmd, count.div_ceil(GROUP).min(GROUPS));
            };
            draw.submitted.iter().for_each(count);
            if let Some(tests) = bindings.tests {
                draw.doubtful
                    .iter()
                    .for_each(|(run, number)| tests.where_visible(context, cmd, *number, || count(run)));
            }
            calls += (draw.submitted.len() + draw.doubtful.len()) as u32;
        }
    });
    recorder.barrier(vec![Use::Memory(Access::ComputeWrite, Access::HostRead)]);
    calls
}

/// Drawn and culled, from what the device counted.
pub fn account(counts: &Counts) -> (u64, Culled) {
    let drawn = counts.drawn as u64 + counts.too_large as u64;
    let culled = Culled {
        interval: counts.not_in_cut as u64,
        frustum: counts.outside as u64,
        cone: counts.back_face as u64,
        invalid: counts.invalid as u64,
        ..Culled::default()
    };
    (drawn, culled)
}
