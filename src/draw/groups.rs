//! Single-pass splatting with deferred blending (Zhang, Pajarola: Single-Pass Point Rendering and Transparent Shading,
//! 2006, figures 5 and 7): every splat into the layer of its group, then the layers into one.

use ash::vk;

use crate::gpu::Context;
use crate::gpu::barrier::Access;
use crate::gpu::pass::{Recorder, Targets as PassTargets, Use};

use super::layers::Layers;
use super::occlusion::{self, any_doubtful};
use super::splats::{Bindings, Draw};
use super::targets::Targets;
use super::variant::Role;

/// Draws one view into its layer of the targets. `fold` records what sums the layers of the groups, `front_depth` what makes depth of
/// them, for what is tested against it. Returns the number of draw calls.
pub fn draw(
    recorder: &mut Recorder,
    targets: &mut Targets,
    layer: usize,
    layers: &mut Layers,
    bindings: &Bindings,
    draws: &[Draw],
    (fold, front_depth): (impl FnOnce(vk::CommandBuffer) -> u32, impl FnOnce(vk::CommandBuffer) -> u32),
) -> u32 {
    let mut calls = 0;
    let extent = targets.plan.extent;
    let all = |context: &Context, cmd| bindings.draw(context, cmd, Role::Groups, draws);
    calls += pass(recorder, layers, extent, ("groups", true), all);
    if draws.iter().any(|d| !d.tests.is_empty()) {
        let depth = Some(targets.depth_attachment(layer, true));
        let mut uses = vec![Use::layer(&mut targets.depth, Access::DepthWrite, layer == 0)];
        uses.push(Use::Image(&mut layers.front, Access::FragmentRead));
        let target = PassTargets { colors: &[], depth, extent, layers: 1 };
        recorder.draw("front depth", uses, &target, |_, cmd| calls += front_depth(cmd));
        calls += occlusion::record(recorder, targets, layer, bindings, draws);
        if any_doubtful(draws) {
            let rest = |context: &Context, cmd| bindings.draw_doubtful(context, cmd, Role::Groups, draws, false);
            calls += pass(recorder, layers, extent, ("groups, uncovered", false), rest);
        }
    }

    let colors = targets.sum_attachments(layer);
    let (_, sums) = targets.split();
    let (images, _) = layers.split();
    let mut uses: Vec<Use> = images.map(|i| Use::Image(i, Access::FragmentRead)).collect();
    uses.extend(sums.map(|i| Use::layer(i, Access::ColorWrite, layer == 0)));
    let pass = PassTargets { colors: &colors, depth: None, extent, layers: 1 };
    recorder.draw("fold", uses, &pass, |_, cmd| calls += fold(cmd));
    calls
}

/// One pass over all layers; `body` returns the number of its draw calls. The name, and whether what the layers hold is given up.
fn pass(
    recorder: &mut Recorder,
    layers: &mut Layers,
    extent: vk::Extent2D,
    (name, first): (&'static str, bool),
    body: impl FnOnce(&Context, vk::CommandBuffer) -> u32,
) -> u32 {
    let mut calls = 0;
    let count = layers.plan.count;
    let (colors, depth) = layers.attachments(first);
    let (images, depth_image) = layers.split();
    let whole = if first { Use::Discard } else { Use::Image };
    let mut uses: Vec<Use> = images.map(|i| whole(i, Access::ColorWrite)).collect();
    uses.push(whole(depth_image, Access::DepthWrite));
    let pass = PassTargets { colors: &colors, depth: Some(depth), extent, layers: count };
    recorder.draw(name, uses, &pass, |context, cmd| calls = body(context, cmd));
    calls
}
