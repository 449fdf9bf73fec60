//! Single-pass splatting with deferred blending (Zhang, Pajarola: Single-Pass Point Rendering and Transparent Shading,
//! 2006, figures 5 and 7): every splat into the layer of its group, then the layers into one.

use ash::vk;

use crate::gpu::barrier::Access;
use crate::gpu::pass::{Recorder, Targets as PassTargets, Use};

use super::layers::Layers;
use super::splats::{Bindings, Draw};
use super::targets::Targets;
use super::variant::Role;

/// Draws one view into its layer of the targets. `fold` records what sums the layers of the groups. Returns the number of
/// draw calls.
pub fn draw(
    recorder: &mut Recorder,
    targets: &mut Targets,
    layer: usize,
    layers: &mut Layers,
    bindings: &Bindings,
    draws: &[Draw],
    fold: impl FnOnce(vk::CommandBuffer) -> u32,
) -> u32 {
    let mut calls = 0;
    let extent = targets.plan.extent;
    let count = layers.plan.count;
    let (colors, depth) = layers.attachments();
    let (images, depth_image) = layers.split();
    let mut uses: Vec<Use> = images.map(|i| Use::Discard(i, Access::ColorWrite)).collect();
    uses.push(Use::Discard(depth_image, Access::DepthWrite));
    let pass = PassTargets { colors: &colors, depth: Some(depth), extent, layers: count };
    recorder.draw("groups", uses, &pass, |context, cmd| calls += bindings.draw(context, cmd, Role::Groups, draws));

    let colors = targets.sum_attachments(layer);
    let (_, sums) = targets.split();
    let (images, _) = layers.split();
    let mut uses: Vec<Use> = images.map(|i| Use::Image(i, Access::FragmentRead)).collect();
    uses.extend(sums.map(|i| Use::layer(i, Access::ColorWrite, layer == 0)));
    let pass = PassTargets { colors: &colors, depth: None, extent, layers: 1 };
    recorder.draw("fold", uses, &pass, |_, cmd| calls += fold(cmd));
    calls
}
