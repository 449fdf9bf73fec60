//! Depth test and blending in one pass, fragment by fragment in the order of submission (Dachsbacher, Vogelgsang,
//! Stamminger: Sequential Point Trees, 2003, section 5; the rule itself is `glsl/shared/blend/fuzzy.glsl`).

use ash::vk;

use crate::gpu::Context;
use crate::gpu::barrier::Access;
use crate::gpu::pass::{Recorder, Targets as PassTargets, Use};
use crate::stats::OrderedAccess;

use super::occlusion::{self, any_doubtful};
use super::splats::{Bindings, Draw};
use super::targets::{ORDERED_CLEARS, Targets};
use super::variant::Role;

/// Draws one view into its layer. `seed` records what fills the limit from the host's depth, if there is any; `front_depth` what
/// makes depth of the limit, for what is tested against it. Returns the number of draw calls.
pub fn draw(
    recorder: &mut Recorder,
    targets: &mut Targets,
    layer: usize,
    bindings: &Bindings,
    draws: &[Draw],
    access: OrderedAccess,
    (seed, front_depth): (Option<impl FnOnce(vk::CommandBuffer) -> u32>, impl FnOnce(vk::CommandBuffer) -> u32),
) -> u32 {
    let mut calls = 0;
    let extent = targets.plan.extent;
    let first = layer == 0;
    // The interlock has no attachments that its own pass could clear.
    let seeded = seed.is_some() || access == OrderedAccess::Interlock;
    if seeded {
        let colors = targets.ordered_attachments(layer);
        let (images, _) = targets.split_ordered(layer);
        let uses = images.into_iter().map(|i| Use::layer(i, Access::ColorWrite, first)).collect();
        let targets = PassTargets { colors: &colors, depth: None, extent, layers: 1 };
        recorder.draw("seed front", uses, &targets, |_, cmd| calls += seed.map_or(0, |seed| seed(cmd)));
    }
    let clears = (!seeded).then_some(&ORDERED_CLEARS[..]);
    let all = |context: &Context, cmd| bindings.draw_ordered(context, cmd, Role::Fuzzy(access), draws);
    calls += pass(recorder, targets, layer, bindings, access, ("fuzzy", first && !seeded, clears), all);
    if draws.iter().all(|d| d.tests.is_empty()) {
        return calls;
    }
    let depth = Some(targets.depth_attachment(layer, true));
    let mut uses = vec![Use::layer(&mut targets.depth, Access::DepthWrite, first)];
    uses.extend(targets.front.as_mut().map(|front| Use::Image(front, Access::FragmentRead)));
    let target = PassTargets { colors: &[], depth, extent, layers: 1 };
    recorder.draw("front depth", uses, &target, |_, cmd| calls += front_depth(cmd));
    calls += occlusion::record(recorder, targets, layer, bindings, draws);
    if any_doubtful(draws) {
        let rest = |context: &Context, cmd| bindings.draw_doubtful(context, cmd, Role::Fuzzy(access), draws, true);
        calls += pass(recorder, targets, layer, bindings, access, ("fuzzy, uncovered", false, None), rest);
    }
    calls
}

/// One pass over a layer; `body` returns the number of its draw calls. The name, whether what the images hold is given up, and what
/// they are cleared to.
fn pass(
    recorder: &mut Recorder,
    targets: &mut Targets,
    layer: usize,
    bindings: &Bindings,
    access: OrderedAccess,
    (name, discard, clears): (&'static str, bool, Option<&[[f32; 4]]>),
    body: impl FnOnce(&Context, vk::CommandBuffer) -> u32,
) -> u32 {
    let mut calls = 0;
    let extent = targets.plan.extent;
    let (images, ordered) = targets.split_ordered(layer);
    let attachments = images.len();
    let to = match access {
        OrderedAccess::RasterizationOrder => Access::ColorOrdered,
        OrderedAccess::Interlock => Access::FragmentStorage,
    };
    let uses = images.into_iter().map(|i| Use::layer(i, to, discard)).collect();
    let record = |context: &Context, cmd| {
        bindings.bind_ordered(context, cmd, access, ordered.set);
        calls = body(context, cmd);
    };
    match &ordered.target {
        Some(target) => recorder.draw_ordered(name, uses, target, clears.map(|c| &c[..attachments]), record),
        None => recorder.draw(name, uses, &PassTargets { colors: &[], depth: None, extent, layers: 1 }, record),
    }
    calls
}
