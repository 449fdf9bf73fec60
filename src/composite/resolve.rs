//! Divide, shade, encode: one triangle inside the host's pass. And its counterpart, which takes the host's depth in.

use std::collections::HashMap;

use ash::vk;

use crate::draw::plan::FramePlan;
use crate::draw::targets::{DEPTH, FRONT, SURFACE, sums_format};
use crate::error::Result;
use crate::gpu::Context;
use crate::gpu::layout::PassPush;
use crate::gpu::program::{BlendMode, ColorTarget, DepthMode, GraphicsInfo, Program};
use crate::gpu::spirv::generated as spirv;
use crate::host::{PassKind, TargetFormats};
use crate::select::DepthConvention;
use crate::style::{Shading, Style, SumPrecision};
use crate::technique::Blend;

/// What distinguishes the pipelines: the specialisation constants of `glsl/composite/resolve.frag`, and the host's
/// depth comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Variant {
    shade: u32,
    eye_dome: bool,
    hidden: u32,
    front: bool,
    convention: DepthConvention,
}

impl Variant {
    /// The variant of a frame.
    pub fn new(plan: &FramePlan, style: &Style, convention: DepthConvention) -> Variant {
        let shade = match style.shading {
            _ if !plan.lit => 0,
            Shading::None => 0,
            Shading::Headlight { .. } => 1,
            Shading::Phong { .. } => 2,
        };
        let hidden = match plan.blend {
            Blend::TwoPass => 0,
            Blend::Fuzzy | Blend::Groups => 1,
            Blend::Opaque => 2,
        };
        let front = plan.blend == Blend::Fuzzy;
        Variant { shade, eye_dome: style.eye_dome.is_some(), hidden, front, convention }
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
    before: HashMap<Before, vk::Pipeline>,
}

/// A full-screen pass into the library's own targets, before `composite`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Before {
    /// The host's depth as depth.
    SeedDepth,
    /// The host's depth as the limit of `fuzzy`.
    SeedFront {
        /// Of the sums in the same pass.
        sums: SumPrecision,
        /// Normals are there too.
        surface: bool,
    },
    /// What `fuzzy` has drawn so far as depth.
    FrontDepth,
    /// What `groups` have drawn so far as depth.
    LayersDepth {
        /// The host's geometry hides what is behind it.
        host_depth: bool,
    },
    /// The layers of `groups` into one.
    Fold {
        /// Of the sums.
        sums: SumPrecision,
        /// Normals or depth are wanted.
        surface: bool,
        /// The layers have normals.
        normals: bool,
        /// The host's geometry hides what is behind it.
        host_depth: bool,
    },
}

impl Composite {
    /// For one kind of target.
    pub fn new(context: &Context, formats: TargetFormats) -> Result<Composite> {
        let push = vk::PushConstantRange {
            stage_flags: vk::ShaderStageFlags::FRAGMENT,
            offset: 0,
            size: size_of::<PassPush>() as u32,
        };
        let shaders = &[
            &spirv::COMPOSITE_TRIANGLE_VERT,
            &spirv::COMPOSITE_RESOLVE_FRAG,
            &spirv::COMPOSITE_SEED_DEPTH_FRAG,
            &spirv::COMPOSITE_SEED_FRONT_FRAG,
            &spirv::COMPOSITE_FRONT_DEPTH_FRAG,
            &spirv::COMPOSITE_LAYERS_DEPTH_FRAG,
            &spirv::COMPOSITE_FOLD_FRAG,
        ];
        let program = Program::new(context, "composite", shaders, false, Some(push))?;
        let mut composite = Composite {
            program,
            sampler: vk::Sampler::null(),
            formats,
            resolve: HashMap::new(),
            before: HashMap::new(),
        };
        match context.nearest_sampler() {
            Ok(sampler) => {
                composite.sampler = sampler;
                Ok(composite)
            }
            Err(e) => {
                composite.destroy(context);
                Err(e)
            }
        }
    }

    /// Builds a pass before `composite` if it is new, and says whether it was.
    pub fn ensure_before(&mut self, context: &Context, before: Before) -> Result<bool> {
        if self.before.contains_key(&before) {
            return Ok(false);
        }
        let target = |format, blend| ColorTarget { format, blend };
        let (name, fragment, constants, colors) = match before {
            Before::SeedDepth => ("seed_depth", &spirv::COMPOSITE_SEED_DEPTH_FRAG, vec![], vec![]),
            Before::FrontDepth => ("front_depth", &spirv::COMPOSITE_FRONT_DEPTH_FRAG, vec![], vec![]),
            Before::LayersDepth { host_depth } => {
                ("layers_depth", &spirv::COMPOSITE_LAYERS_DEPTH_FRAG, vec![host_depth as u32], vec![])
            }
            Before::SeedFront { sums, surface } => {
                let mut colors = vec![target(sums_format(sums), BlendMode::Keep), target(FRONT, BlendMode::Replace)];
                colors.extend(surface.then_some(target(SURFACE, BlendMode::Keep)));
                ("seed_front", &spirv::COMPOSITE_SEED_FRONT_FRAG, vec![], colors)
            }
            Before::Fold { sums, surface, normals, host_depth } => {
                let mut colors = vec![target(sums_format(sums), BlendMode::Replace)];
                colors.extend(surface.then_some(target(SURFACE, BlendMode::Replace)));
                let constants = vec![surface as u32, normals as u32, host_depth as u32];
                ("fold", &spirv::COMPOSITE_FOLD_FRAG, constants, colors)
            }
        };
        let compare = vk::CompareOp::ALWAYS;
        let depth = DepthMode { format: DEPTH, compare, write: true, mark_hidden: false };
        let pipeline = self.program.graphics(
            context,
            &GraphicsInfo {
                name,
                vertex: &spirv::COMPOSITE_TRIANGLE_VERT,
                fragment,
                constants: &constants,
                streams: &[],
                topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                colors: &colors,
                depth: matches!(before, Before::SeedDepth | Before::FrontDepth | Before::LayersDepth { .. })
                    .then_some(depth),
                samples: vk::SampleCountFlags::TYPE_1,
                view_mask: 0,
                render_pass: None,
                ordered: false,
            },
        )?;
        self.before.insert(before, pipeline);
        Ok(true)
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
                    variant.hidden,
                    variant.front as u32,
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
                ordered: false,
            },
        )?;
        self.resolve.insert(variant, pipeline);
        Ok(true)
    }

    /// Draws a pass before `composite` that was ensured: of a view, inside a pass with its attachments. `set` is the
    /// frame's, `layers` the set and number of the layers of `groups`, if they are read. Returns the number of draw calls.
    pub fn draw_before(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        before: Before,
        set: vk::DescriptorSet,
        view: u32,
        layers: Option<(vk::DescriptorSet, u32)>,
    ) -> u32 {
        let push = PassPush { view, layers: layers.map_or(0, |(_, count)| count), padding: [] };
        let layout = self.program.layout;
        context.bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.before[&before]);
        context.bind_sets(cmd, vk::PipelineBindPoint::GRAPHICS, layout, 0, &[set], &[]);
        if let Some((layers, _)) = layers {
            context.bind_sets(cmd, vk::PipelineBindPoint::GRAPHICS, layout, 1, &[layers], &[]);
        }
        context.push(cmd, layout, vk::ShaderStageFlags::FRAGMENT, bytemuck::bytes_of(&push));
        context.draw(cmd, 0, 3);
        1
    }

    /// Draws the picture inside the host's pass: the area that it takes, and what of that is not empty.
    pub fn resolve(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        variant: Variant,
        set: vk::DescriptorSet,
        (area, reached): (vk::Rect2D, vk::Rect2D),
    ) {
        // llvmpipe (Mesa 22.3) draws a triangle that it has to clip into view 0 alone, once for every view: with several
        // views nothing leaves the clip volume.
        let (first, vertices) = if self.formats.view_mask == 0 { (0, 3) } else { (3, 6) };
        context.set_area(cmd, area);
        context.set_scissor(cmd, reached);
        context.bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.resolve[&variant]);
        context.bind_sets(cmd, vk::PipelineBindPoint::GRAPHICS, self.program.layout, 0, &[set], &[]);
        context.draw(cmd, first, vertices);
    }

    /// Destroys everything; nothing is in use.
    pub fn destroy(self, context: &Context) {
        self.resolve
            .into_values()
            .chain(self.before.into_values())
            .for_each(|pipeline| context.destroy_pipeline(pipeline));
        context.destroy_sampler(self.sampler);
        self.program.destroy(context);
    }
}
