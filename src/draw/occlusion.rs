//! Occlusion tests of layered point clouds (Gobbetti, Marton: Layered Point Clouds, 2004, section 4.3), without a wait for their
//! answers: what was visible is drawn, balls round the rest are counted against that depth, and the device itself draws what of the
//! rest that finds visible. The processor learns it when the frame is complete, for the next ones.

use ash::vk;

use crate::error::Result;
use crate::gpu::Context;
use crate::gpu::barrier::Access;
use crate::gpu::layout::RunPush;
use crate::gpu::memory::Location;
use crate::gpu::pass::{Recorder, Targets as PassTargets, Use};
use crate::gpu::query::VisibilityQueries;
use crate::gpu::resource::Buffer;
use crate::host::CloudId;

use super::patches::Seen;
use super::splats::{Bindings, Draw, RUN_STAGES};
use super::targets::Targets;

/// Vertices of an icosahedron, as `glsl/draw/occlusion.vert` makes them.
const VERTICES: u32 = 60;

/// A node that is tested, by the number of its query.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tested {
    /// Of which model.
    pub cloud: CloudId,
    /// In which view of which instance.
    pub seen: Seen,
    /// Number in the index.
    pub node: u32,
    /// Samples that are drawn only if it is visible; 0 where it is drawn anyway.
    pub samples: u32,
}

/// Queries of a frame and their answers on the device; kept by a slot while they are enough.
#[derive(Debug)]
pub struct Tests {
    queries: VisibilityQueries,
    /// A word a query: not 0 where something is visible.
    answers: Buffer,
}

impl Tests {
    /// Room for `count` ≥ 1.
    pub fn new(context: &mut Context, count: u32) -> Result<Tests> {
        let count = count.next_power_of_two();
        let usage = vk::BufferUsageFlags::TRANSFER_DST | vk::BufferUsageFlags::CONDITIONAL_RENDERING_EXT;
        let answers = Buffer::new(context, "visible", 4 * u64::from(count), usage, Location::Device)?;
        match VisibilityQueries::new(context, count) {
            Ok(queries) => Ok(Tests { queries, answers }),
            Err(e) => {
                answers.destroy(context);
                Err(e)
            }
        }
    }

    /// Whether there is room.
    pub fn holds(&self, count: usize) -> bool {
        self.queries.count as usize >= count
    }

    /// Readies the first `count`: outside a pass, before anything of the frame is drawn.
    pub fn reset(&self, context: &Context, cmd: vk::CommandBuffer, count: usize) {
        self.queries.reset(context, cmd, count as u32);
    }

    /// Runs what `body` records only where query `number` found something visible.
    pub fn where_visible(&self, context: &Context, cmd: vk::CommandBuffer, number: u32, body: impl FnOnce()) {
        context.begin_condition(cmd, self.answers.handle, 4 * u64::from(number));
        body();
        context.end_condition(cmd);
    }

    /// The answers, once the frame is complete.
    pub fn read(&self, context: &Context, count: usize) -> Result<Vec<Option<bool>>> {
        self.queries.read(context, count as u32)
    }

    /// Destroys everything; no frame uses it.
    pub fn destroy(self, context: &mut Context) {
        self.queries.destroy(context);
        self.answers.destroy(context);
    }
}

/// Whether anything of a view waits for its test.
pub fn any_doubtful(draws: &[Draw]) -> bool {
    draws.iter().any(|d| !d.doubtful.is_empty())
}

/// Tests a view's balls against the depth in its layer, and puts the answers where conditions are read from. Returns the number of
/// draw calls.
pub fn record(
    recorder: &mut Recorder,
    targets: &mut Targets,
    layer: usize,
    bindings: &Bindings,
    draws: &[Draw],
) -> u32 {
    let Some(tests) = bindings.tests.filter(|_| draws.iter().any(|d| !d.tests.is_empty())) else { return 0 };
    let mut calls = 0;
    let extent = targets.plan.extent;
    let depth = Some(targets.depth_attachment(layer, false));
    let uses = vec![Use::Image(&mut targets.depth, Access::DepthWrite)];
    let pass = PassTargets { colors: &[], depth, extent, layers: 1 };
    recorder.draw("occlusion", uses, &pass, |context, cmd| {
        for draw in draws.iter().filter(|d| !d.tests.is_empty()) {
            let pipeline = bindings.pipelines.get(&draw.main.of_balls());
            context.bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
            bindings.begin(context, cmd, draw);
            for (number, ball) in draw.tests.clone().zip(&draw.balls) {
                let push = RunPush { first: 0, count: 0, least: 0.0, table: *ball, padding: [] };
                context.push(cmd, bindings.program.layout, RUN_STAGES, bytemuck::bytes_of(&push));
                tests.queries.count(context, cmd, number, || context.draw(cmd, 0, VERTICES));
                calls += 1;
            }
        }
    });
    if any_doubtful(draws) {
        let before = vec![Use::Memory(Access::Condition, Access::CopyWrite)];
        recorder.pass("visible", before, |context, cmd| {
            for draw in draws.iter().filter(|d| !d.tests.is_empty()) {
                tests.queries.copy(context, cmd, draw.tests.clone(), &tests.answers);
            }
        });
        recorder.barrier(vec![Use::Memory(Access::CopyWrite, Access::Condition)]);
    }
    calls
}
