//! Depth test and blending in one pass, fragment by fragment in the order of submission (Dachsbacher, Vogelgsang,
//! Stamminger: Sequential Point Trees, 2003, section 5; the rule itself is `glsl/shared/blend/fuzzy.glsl`).

use ash::vk;

use crate::gpu::barrier::Access;
use crate::gpu::pass::{Recorder, Targets as PassTargets, Use};
use crate::stats::OrderedAccess;

use super::splats::{Bindings, Draw};
use super::targets::{ORDERED_CLEARS, Targets};
use super::variant::Role;

/// Draws one view into its layer. `seed` records what fills the limit from the host's depth, if there is any. Returns the
/// number of draw calls.
pub fn draw(
    recorder: &mut Recorder,
    targets: &mut Targets,
    layer: usize,
    bindings: &Bindings,
    draws: &[Draw],
    access: OrderedAccess,
    seed: Option<impl FnOnce(vk::CommandBuffer) -> u32>,
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
    let (images, ordered) = targets.split_ordered(layer);
    let attachments = images.len();
    let to = match access {
        OrderedAccess::RasterizationOrder => Access::ColorOrdered,
        OrderedAccess::Interlock => Access::FragmentStorage,
    };
    let uses = images.into_iter().map(|i| Use::layer(i, to, first && !seeded)).collect();
    let role = Role::Fuzzy(access);
    let body = |context: &_, cmd| {
        bindings.bind_ordered(context, cmd, access, ordered.set);
        calls += bindings.draw_ordered(context, cmd, role, draws);
    };
    match &ordered.target {
        Some(target) => {
            let clears = (!seeded).then_some(&ORDERED_CLEARS[..attachments]);
            recorder.draw_ordered("fuzzy", uses, target, clears, body);
        }
        None => {
            recorder.draw("fuzzy", uses, &PassTargets { colors: &[], depth: None, extent, layers: 1 }, body);
        }
    }
    calls
}
