//! Divide, shade, encode: one triangle inside the host's pass. And its counterpart, which takes the host's depth in.

use std::collections::HashMap;

use ash::vk;

use crate::draw::plan::FramePlan;
use crate::draw::targets::DEPTH;
use crate::error::Result;
use crate::gpu::Context;
use crate::gpu::layout::SeedPush;
use crate::gpu::program::{BlendMode, ColorTarget, DepthMode, GraphicsInfo, Program};
use crate::gpu::spirv::generated as spirv;
use crate::host::{PassKind, TargetFormats};
use crate::select::DepthConvention;
use crate::style::{Shading, Style};
use crate::technique::Blend;

/// What distinguishes the pipelines: the specialisation constants of `glsl/composite/resolve.frag`, and the host's
/// depth comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Variant {
    shade: u32,
    eye_dome: bool,
    solid: bool,
    convention: DepthConvention,
}

impl Variant {
    /// The variant of a frame.
    pub fn new(plan: &FramePlan, style: &Style, blend: Blend, convention: DepthConvention) -> Variant {
        let shade = match style.shading {
            _ if !plan.lit => 0,
            Shading::None => 0,
            Shading::Headlight { .. } => 1,
            Shading::Phong { .. } => 2,
        };
        Variant { shade, eye_dome: style.eye_dome.is_some(), solid: blend == Blend::Opaque, convention }
    }
}

impl Variant {
    /// Whether normals are not read.
    pub fn is_unlit(&self) -> bool {
        self.shade == 0
    }
}

/// Pipelines and the sampler.
#[derive(Debug)]
pub struct Composite {
    /// Set 0: the frame's block, sums, front, host depth.
    pub program: Program,
    /// Nearest, for `texelFetch`.
    pub sampler: vk::Sampler,
    formats: TargetFormats,
    resolve: HashMap<Variant, vk::Pipeline>,
    seed: vk::Pipeline,
}

impl Composite {
    /// For one kind of target.
    pub fn new(context: &Context, formats: TargetFormats) -> Result<Composite> {
        let push = vk::PushConstantRange {
            stage_flags: vk::ShaderStageFlags::FRAGMENT,
            offset: 0,
            size: size_of::<SeedPush>() as u32,
        };
        let shaders =
            &[&spirv::COMPOSITE_TRIANGLE_VERT, &spirv::COMPOSITE_RESOLVE_FRAG, &spirv::COMPOSITE_SEED_DEPTH_FRAG];
        let program = Program::new(context, "composite", shaders, false, Some(push))?;
        let mut composite = Composite {
            program,
            sampler: vk::Sampler::null(),
            formats,
            resolve: HashMap::new(),
            seed: vk::Pipeline::null(),
        };
        match composite.build(context) {
            Ok(()) => Ok(composite),
            Err(e) => {
                composite.destroy(context);
                Err(e)
            }
        }
    }

    fn build(&mut self, context: &Context) -> Result<()> {
        self.sampler = context.nearest_sampler()?;
        self.seed = self.program.graphics(
            context,
            &GraphicsInfo {
                name: "seed_depth",
                vertex: &spirv::COMPOSITE_TRIANGLE_VERT,
                fragment: &spirv::COMPOSITE_SEED_DEPTH_FRAG,
                constants: &[],
                streams: &[],
                topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                colors: &[],
                depth: Some(DepthMode {
                    format: DEPTH,
                    compare: vk::CompareOp::ALWAYS,
                    write: true,
                    mark_hidden: false,
                }),
                samples: vk::SampleCountFlags::TYPE_1,
                view_mask: 0,
                render_pass: None,
            },
        )?;
        Ok(())
    }

    /// Builds the variant if it is new, and says whether it was.
    pub fn ensure(&mut self, context: &Context, variant: Variant) -> Result<bool> {
        if self.resolve.contains_key(&variant) {
            return Ok(false);
        }
        let formats = &self.formats;
        let compare = match variant.convention {
            DepthConvention::Reversed => vk::CompareOp::GREATER_OR_EQUAL,
            DepthConvention::Standard => vk::CompareOp::LESS_OR_EQUAL,
        };
        let pipeline = self.program.graphics(
            context,
            &GraphicsInfo {
                name: "resolve",
                vertex: &spirv::COMPOSITE_TRIANGLE_VERT,
                fragment: &spirv::COMPOSITE_RESOLVE_FRAG,
                constants: &[
                    variant.shade,
                    variant.eye_dome as u32,
                    formats.depth.is_some() as u32,
                    formats.encode_srgb as u32,
                    variant.solid as u32,
                ],
                streams: &[],
                topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                colors: &[ColorTarget { format: formats.color, blend: BlendMode::Over }],
                depth: formats.depth.map(|format| DepthMode { format, compare, write: true, mark_hidden: false }),
                samples: formats.samples,
                view_mask: match formats.pass {
                    PassKind::Dynamic => formats.view_mask,
                    PassKind::RenderPass { .. } => 0,
                },
                render_pass: match formats.pass {
                    PassKind::Dynamic => None,
                    PassKind::RenderPass { pass, subpass } => Some((pass, subpass)),
                },
            },
        )?;
        self.resolve.insert(variant, pipeline);
        Ok(true)
    }

    /// Fills a view's depth from the host's, inside a pass with that depth alone. Returns the number of draw calls.
    pub fn seed(&self, context: &Context, cmd: vk::CommandBuffer, set: vk::DescriptorSet, view: u32) -> u32 {
        let push = SeedPush { view, padding: [] };
        let layout = self.program.layout;
        context.bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.seed);
        context.bind_sets(cmd, vk::PipelineBindPoint::GRAPHICS, layout, 0, &[set], &[]);
        context.push(cmd, layout, vk::ShaderStageFlags::FRAGMENT, bytemuck::bytes_of(&push));
        context.draw(cmd, 0, 3);
        1
    }

    /// Draws the picture inside the host's pass.
    pub fn resolve(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        variant: Variant,
        set: vk::DescriptorSet,
        area: vk::Rect2D,
    ) {
        // llvmpipe (Mesa 22.3) draws a triangle that it has to clip into view 0 alone, once for every view: with several
        // views nothing leaves the clip volume.
        let (first, vertices) = if self.formats.view_mask == 0 { (0, 3) } else { (3, 6) };
        context.set_area(cmd, area);
        context.bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.resolve[&variant]);
        context.bind_sets(cmd, vk::PipelineBindPoint::GRAPHICS, self.program.layout, 0, &[set], &[]);
        context.draw(cmd, first, vertices);
    }

    /// Destroys everything; nothing is in use.
    pub fn destroy(self, context: &Context) {
        self.resolve.into_values().chain([self.seed]).for_each(|pipeline| context.destroy_pipeline(pipeline));
        context.destroy_sampler(self.sampler);
        self.program.destroy(context);
    }
}
