//! How many splats a frame draws, and how many not, by what: a compute pass for statistics alone. It runs the very
//! function that the vertex stage runs, `project` of `glsl/shared/splat.glsl`.

use ash::vk;

use crate::gpu::barrier::Access;
use crate::gpu::layout::{CountPush, Counts};
use crate::gpu::pass::{Recorder, Use};
use crate::gpu::resource::Buffer;
use crate::stats::Culled;

use super::splats::{Bindings, Draw};
use super::variant::{Role, Variant};

/// Threads of a group, as in `glsl/select/count.comp`.
const GROUP: u32 = 64;
/// Groups a dispatch: the least limit that a device has is 65,535; a grid-stride loop does the rest.
const GROUPS: u32 = 1024;

/// Counts all views' draws into `counts`. Returns the number of dispatches.
pub fn record(
    recorder: &mut Recorder,
    bindings: &Bindings,
    counts: &Buffer,
    counts_set: vk::DescriptorSet,
    views: &[Vec<Draw>],
) -> u32 {
    let mut calls = 0;
    recorder.pass("clear counts", vec![Use::Memory(Access::HostRead, Access::CopyWrite)], |context, cmd| {
        context.zero(cmd, counts.handle);
    });
    recorder.pass("count", vec![Use::Memory(Access::CopyWrite, Access::ComputeWrite)], |context, cmd| {
        for draw in views.iter().flatten() {
            let variant = Variant { role: Role::Count, ..draw.main };
            for chunk in &bindings.clouds[draw.cloud].chunks {
                let push = CountPush { count: chunk.count, padding: [] };
                let (layout, point) = (bindings.program.layout, vk::PipelineBindPoint::COMPUTE);
                context.bind_pipeline(cmd, point, bindings.pipelines.get(&variant));
                context.bind_sets(cmd, point, layout, 0, &[bindings.params, chunk.set, counts_set], &[draw.params]);
                context.push(cmd, layout, vk::ShaderStageFlags::COMPUTE, bytemuck::bytes_of(&push));
                context.dispatch(cmd, chunk.count.div_ceil(GROUP).min(GROUPS));
                calls += 1;
            }
        }
    });
    recorder.barrier(vec![Use::Memory(Access::ComputeWrite, Access::HostRead)]);
    calls
}

/// Drawn and culled, from what the device counted.
pub fn account(counts: &Counts) -> (u64, Culled) {
    let drawn = counts.drawn as u64 + counts.too_large as u64;
    let culled = Culled {
        frustum: counts.outside as u64,
        cone: counts.back_face as u64,
        invalid: counts.invalid as u64,
        ..Culled::default()
    };
    (drawn, culled)
}
