//! The nearest fragment alone: hard discs, or squares of a given size.

use ash::vk;

use crate::gpu::barrier::Access;
use crate::gpu::pass::{Attachment, Recorder, Targets as PassTargets, Use};

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
    // The seed's pipeline has no colour attachments, hence a pass of its own.
    let seeded = seed.is_some();
    if let Some(seed) = seed {
        let depth = Some(targets.depth_attachment(layer, true));
        recorder.draw(
            "seed depth",
            vec![Use::layer(&mut targets.depth, Access::DepthWrite, first)],
            &PassTargets { colors: &[], depth, extent, layers: 1 },
            |_, cmd| calls += seed(cmd),
        );
    }
    let (colors, depth) = (targets.sum_attachments(layer), Some(targets.depth_attachment(layer, !seeded)));
    let (depth_image, sums) = targets.split();
    let mut uses = vec![Use::layer(depth_image, Access::DepthWrite, first && !seeded)];
    uses.extend(sums.map(|i| Use::layer(i, Access::ColorWrite, first)));
    recorder.draw("opaque", uses, &PassTargets { colors: &colors, depth, extent, layers: 1 }, |context, cmd| {
        calls += bindings.draw(context, cmd, Role::Opaque, draws)
    });
    calls += occlusion::record(recorder, targets, layer, bindings, draws);
    if any_doubtful(draws) {
        let colors: Vec<_> =
            targets.sum_attachments(layer).into_iter().map(|a| Attachment { clear: None, ..a }).collect();
        let depth = Some(targets.depth_attachment(layer, false));
        let (depth_image, sums) = targets.split();
        let mut uses = vec![Use::Image(depth_image, Access::DepthWrite)];
        uses.extend(sums.map(|i| Use::Image(i, Access::ColorWrite)));
        let pass = PassTargets { colors: &colors, depth, extent, layers: 1 };
        recorder.draw("opaque, uncovered", uses, &pass, |context, cmd| {
            calls += bindings.draw_doubtful(context, cmd, Role::Opaque, draws, false)
        });
    }
    calls
}
