//! Visibility splatting in two passes (Botsch et al. 2005, section 3; MODEL "Two tolerances"): the least z + ε of every
//! pixel, then weighted sums of all that is not behind it.

use ash::vk;

use crate::gpu::barrier::Access;
use crate::gpu::pass::{Recorder, Targets as PassTargets, Use};

use super::occlusion::{self, any_doubtful};
use super::splats::{Bindings, Draw};
use super::targets::Targets;
use super::variant::Role;

/// Draws one view into its layer. `seed` records what fills the depth from the host's, if there is any. Returns the
/// number of draw calls.
pub fn draw(
    recorder: &mut Recorder,
    targets: &mut Targets,
    layer: usize,
    bindings: &Bindings,
    draws: &[Draw],
    seed: Option<impl FnOnce(vk::CommandBuffer) -> u32>,
) -> u32 {
    let mut calls = 0;
    let extent = targets.plan.extent;
    let first = layer == 0;
    let depth = Some(targets.depth_attachment(layer, true));
    recorder.draw(
        "visibility",
        vec![Use::layer(&mut targets.depth, Access::DepthWrite, first)],
        &PassTargets { colors: &[], depth, extent, layers: 1 },
        |context, cmd| {
            calls += seed.map_or(0, |seed| seed(cmd));
            calls += bindings.draw(context, cmd, Role::Visibility, draws);
        },
    );
    calls += occlusion::record(recorder, targets, layer, bindings, draws);
    if any_doubtful(draws) {
        let depth = Some(targets.depth_attachment(layer, false));
        recorder.draw(
            "visibility, uncovered",
            vec![Use::Image(&mut targets.depth, Access::DepthWrite)],
            &PassTargets { colors: &[], depth, extent, layers: 1 },
            |context, cmd| calls += bindings.draw_doubtful(context, cmd, Role::Visibility, draws, false),
        );
    }
    let (colors, depth) = (targets.sum_attachments(layer), Some(targets.depth_attachment(layer, false)));
    let (depth_image, sums) = targets.split();
    let mut uses = vec![Use::Image(depth_image, Access::DepthWrite)];
    uses.extend(sums.map(|i| Use::layer(i, Access::ColorWrite, first)));
    recorder.draw("accumulate", uses, &PassTargets { colors: &colors, depth, extent, layers: 1 }, |context, cmd| {
        calls += bindings.draw(context, cmd, Role::Accumulate, draws);
        calls += bindings.draw_doubtful(context, cmd, Role::Accumulate, draws, false);
    });
    calls
}
