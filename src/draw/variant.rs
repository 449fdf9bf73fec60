//! Pipelines of the splat passes, by what distinguishes them.

use std::collections::HashMap;

use ash::vk;

use crate::error::Result;
use crate::gpu::Context;
use crate::gpu::program::{BlendMode, ColorTarget, DepthMode, GraphicsInfo, Program, Stream};
use crate::gpu::spirv::{Shader, generated as spirv};
use crate::style::{Ellipse, Style};

use super::plan::{CloudTraits, FramePlan};
use super::targets::{DEPTH, TargetPlan};

/// Shaders that share the splats' layout: set 0 parameters, set 1 a chunk, set 2 counters.
pub const SHADERS: &[&Shader] = &[
    &spirv::DRAW_POINT_VERT,
    &spirv::DRAW_QUAD_VERT,
    &spirv::DRAW_VISIBILITY_FRAG,
    &spirv::DRAW_ACCUMULATE_FRAG,
    &spirv::DRAW_ACCUMULATE_SURFACE_FRAG,
    &spirv::SELECT_COUNT_COMP,
];

/// Vertex streams of `draw/point.vert`, in the order of `Chunk::streams`.
const STREAMS: [Stream; 3] = [
    Stream { stride: 16, format: vk::Format::R32G32B32A32_SFLOAT },
    Stream { stride: 4, format: vk::Format::R32_UINT },
    Stream { stride: 4, format: vk::Format::R32_UINT },
];

/// Which pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// Least z + ε, depth alone.
    Visibility,
    /// Sums of what lies within the tolerance.
    Accumulate,
    /// The nearest fragment.
    Opaque,
    /// Counting: compute.
    Count,
}

/// A pipeline's key: the specialisation constants of `glsl/shared/params.glsl`, and the fixed state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Variant {
    /// Which pass.
    pub role: Role,
    /// Quads pulled from storage, not point primitives.
    pub quads: bool,
    /// FOOTPRINT.
    pub footprint: u32,
    /// APPROXIMATE.
    pub approximate: bool,
    /// CULL_BACK.
    pub cull: bool,
    /// HAS_NORMAL.
    pub normals: bool,
    /// HAS_COLOR.
    pub colors: bool,
    /// LARGE.
    pub large: bool,
    /// PAIRS.
    pub pairs: bool,
    /// The second attachment, of normals and the front's depth, is there.
    pub surface: bool,
    /// Formats of the attachments by location.
    pub formats: [vk::Format; 2],
}

impl Variant {
    /// The variant that draws a cloud in a pass. `large`: only what sprites cannot hold, as quads. `pairs`: as
    /// [`Camera::needs_pairs`](super::params::Camera::needs_pairs) says.
    pub fn new(
        role: Role,
        plan: &FramePlan,
        style: &Style,
        cloud: &CloudTraits,
        targets: &TargetPlan,
        large: bool,
        pairs: bool,
    ) -> Variant {
        Variant {
            role,
            quads: plan.quads || large,
            footprint: if plan.pixels { 2 } else { plan.disc as u32 },
            approximate: style.ellipse == Ellipse::Approximate,
            cull: plan.culls(style, cloud),
            normals: cloud.normals,
            colors: cloud.colors,
            large,
            pairs,
            surface: targets.surface,
            formats: targets.formats(),
        }
    }

    fn build(&self, context: &Context, program: &Program) -> Result<vk::Pipeline> {
        let constants = [
            self.footprint,
            self.approximate as u32,
            self.cull as u32,
            self.normals as u32,
            // Depth alone needs no colour, so its decoding is left out.
            (self.colors && self.role != Role::Visibility) as u32,
            self.large as u32,
            (self.large || self.role == Role::Count) as u32,
            self.pairs as u32,
        ];
        let attachments = if self.surface { 2 } else { 1 };
        let accumulate = if self.surface { &spirv::DRAW_ACCUMULATE_SURFACE_FRAG } else { &spirv::DRAW_ACCUMULATE_FRAG };
        let target = |i: usize, blend| ColorTarget { format: self.formats[i], blend };
        let sums = [target(0, BlendMode::Add), target(1, BlendMode::AddMax)];
        let nearest = [target(0, BlendMode::Replace), target(1, BlendMode::Replace)];
        let greater = vk::CompareOp::GREATER_OR_EQUAL;
        let (name, fragment, colors, depth): (_, _, &[ColorTarget], _) = match self.role {
            Role::Count => return program.compute(context, "count", &spirv::SELECT_COUNT_COMP, &constants),
            Role::Visibility => ("visibility", &spirv::DRAW_VISIBILITY_FRAG, &[], (vk::CompareOp::GREATER, true)),
            Role::Accumulate => ("accumulate", accumulate, &sums[..attachments], (greater, false)),
            Role::Opaque => ("opaque", accumulate, &nearest[..attachments], (vk::CompareOp::GREATER, true)),
        };
        program.graphics(
            context,
            &GraphicsInfo {
                name,
                vertex: if self.quads { &spirv::DRAW_QUAD_VERT } else { &spirv::DRAW_POINT_VERT },
                fragment,
                constants: &constants,
                streams: if self.quads { &[] } else { &STREAMS },
                topology: if self.quads {
                    vk::PrimitiveTopology::TRIANGLE_LIST
                } else {
                    vk::PrimitiveTopology::POINT_LIST
                },
                colors,
                depth: Some(DepthMode {
                    format: DEPTH,
                    compare: depth.0,
                    write: depth.1,
                    mark_hidden: self.role == Role::Accumulate,
                }),
                samples: vk::SampleCountFlags::TYPE_1,
                view_mask: 0,
                render_pass: None,
            },
        )
    }
}

/// Pipelines built so far.
#[derive(Debug, Default)]
pub struct Pipelines {
    built: HashMap<Variant, vk::Pipeline>,
}

impl Pipelines {
    /// Builds the variant if it is new, and says whether it was.
    pub fn ensure(&mut self, context: &Context, program: &Program, variant: Variant) -> Result<bool> {
        if self.built.contains_key(&variant) {
            return Ok(false);
        }
        let pipeline = variant.build(context, program)?;
        self.built.insert(variant, pipeline);
        Ok(true)
    }

    /// A variant that was ensured.
    pub fn get(&self, variant: &Variant) -> vk::Pipeline {
        self.built[variant]
    }

    /// Destroys them all; none is in use.
    pub fn destroy(self, context: &Context) {
        self.built.into_values().for_each(|pipeline| context.destroy_pipeline(pipeline));
    }
}
