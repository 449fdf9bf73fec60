//! What a frame draws with: attachments, slots, pipelines, made when they are first needed. It fails before anything is recorded.

use ash::vk;

use super::Renderer;
use super::supply::Staged;
use crate::composite::{Before, resolve};
use crate::draw::layers::{LayerPlan, Layers};
use crate::draw::plan::{FramePlan, Surroundings};
use crate::draw::slot::Slot;
use crate::draw::splats::{Draw, quad_indices};
use crate::draw::targets::{TargetPlan, Targets};
use crate::draw::variant::{Role, Step, Variant};
use crate::error::Result;
use crate::gpu::Interlock;
use crate::gpu::memory::Location;
use crate::gpu::resource::Buffer;
use crate::gpu::upload::Upload;
use crate::host::FrameInput;
use crate::stats::OrderedAccess;
use crate::technique::Blend;

/// What makes depth of what a blend has drawn, for those that have none that tests could use.
pub(super) fn front_depth(plan: &FramePlan, host_depth: bool) -> Option<Before> {
    match plan.blend {
        Blend::TwoPass | Blend::Opaque => None,
        Blend::Fuzzy => Some(Before::FrontDepth),
        Blend::Groups => Some(Before::LayersDepth { host_depth }),
    }
}

impl Renderer {
    pub(super) fn surroundings(&self, input: &FrameInput) -> Surroundings {
        let enabled = &self.context.enabled;
        Surroundings {
            depth_target: self.formats.depth.is_some(),
            host_depth: input.host_depth.is_some(),
            sprite_limit: if enabled.large_points { self.context.limits.point_size_range[1] } else { 1.0 },
            ordered: match (enabled.rasterization_order, enabled.interlock) {
                (true, _) => Some(OrderedAccess::RasterizationOrder),
                (false, Interlock::Pixel | Interlock::Implicit) => Some(OrderedAccess::Interlock),
                (false, Interlock::Absent) => None,
            },
            output_layer: enabled.output_layer,
        }
    }

    pub(super) fn before(&self, input: &FrameInput, plan: &FramePlan) -> Option<Before> {
        let Some(targets) = &self.targets else { unreachable!("made before") };
        let (sums, surface, host_depth) = (targets.plan.sums, targets.plan.surface, input.host_depth.is_some());
        match plan.blend {
            Blend::Groups => Some(Before::Fold { sums, surface, normals: plan.lit, host_depth }),
            _ if !host_depth => None,
            Blend::Fuzzy => Some(Before::SeedFront { sums, surface }),
            Blend::TwoPass | Blend::Opaque => Some(Before::SeedDepth),
        }
    }

    pub(super) fn ensure_targets(&mut self, input: &FrameInput, plan: &FramePlan) -> Result<()> {
        let mut wanted = TargetPlan {
            extent: input.extent,
            layers: input.views.len() as u32,
            surface: plan.surface(),
            sums: plan.sums,
            ordered: plan.ordered,
        };
        if let Some(old) = &self.targets {
            if old.plan == wanted {
                return Ok(());
            }
            // Of the same size, attachments are only ever added: styles that alternate must not remake them.
            if old.plan.extent == wanted.extent && old.plan.layers == wanted.layers {
                wanted.surface |= old.plan.surface;
                wanted.ordered = wanted.ordered.or(old.plan.ordered);
                if old.plan == wanted {
                    return Ok(());
                }
            }
        }
        let made = Targets::new(&mut self.context, wanted, &self.splats, &mut self.pipelines.passes)?;
        if let Some(old) = self.targets.replace(made) {
            old.retire(&mut self.retired, self.newest);
        }
        Ok(())
    }

    /// The layers of `groups`: as many as the frame needs, kept while they are enough.
    pub(super) fn ensure_layers(&mut self, input: &FrameInput, plan: &FramePlan) -> Result<()> {
        if plan.blend != Blend::Groups {
            return Ok(());
        }
        let wanted = LayerPlan { extent: input.extent, count: plan.layers, normals: plan.lit, sums: plan.sums };
        if self.layers.as_ref().is_some_and(|old| old.plan == wanted) {
            return Ok(());
        }
        let made = Layers::new(&mut self.context, wanted, &self.composite.program, self.composite.sampler)?;
        if let Some(old) = self.layers.replace(made) {
            old.retire(&mut self.retired, self.newest);
        }
        Ok(())
    }

    /// A slot whose last frame is complete and that has room for so many clouds times views.
    pub(super) fn ensure_slot(&mut self, draws: u64) -> Result<usize> {
        let free = self.slots.iter().position(|s| s.frame <= self.completed && s.stats.is_none());
        let index = match free {
            Some(index) if self.slots[index].capacity() >= draws => index,
            Some(index) => {
                let slot = Slot::new(&mut self.context, &self.splats, &self.composite, draws.next_power_of_two())?;
                std::mem::replace(&mut self.slots[index], slot).destroy(&mut self.context);
                index
            }
            None => {
                let slot = Slot::new(&mut self.context, &self.splats, &self.composite, draws.next_power_of_two())?;
                self.slots.push(slot);
                self.slots.len() - 1
            }
        };
        Ok(index)
    }

    pub(super) fn ensure_pipelines(
        &mut self,
        input: &FrameInput,
        plan: &FramePlan,
        views: &[Vec<Draw>],
        full_screen: impl Iterator<Item = Before>,
    ) -> Result<u32> {
        let roles: &[Role] = match (plan.blend, plan.ordered) {
            (Blend::Fuzzy, Some(access)) => &[Role::Fuzzy(access)],
            (Blend::TwoPass | Blend::Fuzzy, _) => &[Role::Visibility, Role::Accumulate],
            (Blend::Groups, _) => &[Role::Groups],
            (Blend::Opaque, _) => &[Role::Opaque],
        };
        let mut built = 0;
        for before in full_screen {
            built += self.composite.ensure_before(&self.context, before)? as u32;
        }
        for draw in views.iter().flatten() {
            if !draw.tests.is_empty() {
                built += self.pipelines.ensure(&self.context, &self.splats, draw.main.of_balls())? as u32;
            }
            for &role in roles {
                let triangles = (!draw.faces.is_empty()).then_some(draw.triangles.0);
                for variant in [draw.main, draw.large].into_iter().chain(triangles) {
                    built += self.pipelines.ensure(&self.context, &self.splats, Variant { role, ..variant })? as u32;
                }
            }
            let steps = if draw.main.listed { &[Step::Mark, Step::Scan, Step::List][..] } else { &[] };
            let computed = steps.iter().map(|step| Variant::compute(draw.test, draw.main.packing, *step));
            for variant in computed.chain(input.count.then(|| draw.main.count(draw.test))) {
                built += self.pipelines.ensure(&self.context, &self.splats, variant)? as u32;
            }
        }
        let resolve = resolve::Variant::new(plan, input.style, input.views[0].depth);
        built += self.composite.ensure(&self.context, resolve)? as u32;
        Ok(built)
    }

    pub(super) fn ensure_indices(&mut self, needed: bool) -> Result<()> {
        if !needed || self.indices.is_some() {
            return Ok(());
        }
        let indices = quad_indices();
        let data: &[u8] = bytemuck::cast_slice(&indices);
        let usage = vk::BufferUsageFlags::INDEX_BUFFER | vk::BufferUsageFlags::TRANSFER_DST;
        let buffer = Buffer::new(&mut self.context, "quad_indices", data.len() as u64, usage, Location::Device)?;
        let mut upload = match Upload::new(&mut self.context, data.len() as u64) {
            Ok(upload) => upload,
            Err(e) => {
                buffer.destroy(&mut self.context);
                return Err(e);
            }
        };
        upload.write(&buffer, data);
        self.staged.push(Staged { cloud: None, upload });
        self.indices = Some(buffer);
        Ok(())
    }
}
