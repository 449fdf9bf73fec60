//! Pipelines: layouts from the reflected bindings, variants by specialisation constants.

use std::collections::BTreeMap;

use ash::vk;

use super::context::Context;
use super::resource::aspect;
use super::spirv::{Kind, Shader, Stage};
use crate::error::{Named, Result};

/// Shaders that share one pipeline layout, so that sets bound for one stay bound for the next.
#[derive(Debug)]
pub struct Program {
    /// Pipeline layout of all the shaders together.
    pub layout: vk::PipelineLayout,
    /// Set layouts by number.
    pub sets: Vec<vk::DescriptorSetLayout>,
    modules: Vec<(&'static str, vk::ShaderModule)>,
}

impl Program {
    /// Layouts of the union of the shaders' bindings. `dynamic_uniforms`: uniform buffers are bound with an offset.
    pub fn new(
        context: &Context,
        name: &str,
        shaders: &[&'static Shader],
        dynamic_uniforms: bool,
        push_constants: Option<vk::PushConstantRange>,
    ) -> Result<Program> {
        let mut program = Program { layout: vk::PipelineLayout::null(), sets: Vec::new(), modules: Vec::new() };
        match program.build(context, name, shaders, dynamic_uniforms, push_constants) {
            Ok(()) => Ok(program),
            Err(e) => {
                program.destroy(context);
                Err(e)
            }
        }
    }

    fn build(
        &mut self,
        context: &Context,
        name: &str,
        shaders: &[&'static Shader],
        dynamic_uniforms: bool,
        push_constants: Option<vk::PushConstantRange>,
    ) -> Result<()> {
        let mut bindings: BTreeMap<(u32, u32), (Kind, vk::ShaderStageFlags)> = BTreeMap::new();
        for shader in shaders {
            for b in shader.bindings {
                let entry = bindings.entry((b.set, b.binding)).or_insert((b.kind, vk::ShaderStageFlags::empty()));
                debug_assert_eq!(entry.0, b.kind, "{} disagrees on set {} binding {}", shader.name, b.set, b.binding);
                entry.1 |= stage_flags(shader.stage);
            }
        }
        let sets = bindings.keys().map(|(set, _)| set + 1).max().unwrap_or(0);
        for set in 0..sets {
            let in_set: Vec<_> = bindings
                .range((set, 0)..(set + 1, 0))
                .map(|((_, binding), (kind, stages))| {
                    vk::DescriptorSetLayoutBinding::default()
                        .binding(*binding)
                        .descriptor_type(descriptor_type(*kind, dynamic_uniforms))
                        .descriptor_count(1)
                        .stage_flags(*stages)
                })
                .collect();
            let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&in_set);
            // SAFETY: the device lives; the bindings are distinct.
            let layout = unsafe { context.device.create_descriptor_set_layout(&info, None) }
                .named("vkCreateDescriptorSetLayout")?;
            context.name(layout, &format!("{name}.set{set}"));
            self.sets.push(layout);
        }
        let ranges: Vec<_> = push_constants.into_iter().collect();
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&self.sets).push_constant_ranges(&ranges);
        // SAFETY: the device and the set layouts live; ranges are within the 128 bytes that every device has.
        self.layout = unsafe { context.device.create_pipeline_layout(&info, None) }.named("vkCreatePipelineLayout")?;
        context.name(self.layout, &format!("{name}.layout"));
        for shader in shaders {
            let info = vk::ShaderModuleCreateInfo::default().code(shader.words);
            // SAFETY: the words were validated by the build, and need no feature beyond the required ones.
            let module = unsafe { context.device.create_shader_module(&info, None) }.named("vkCreateShaderModule")?;
            context.name(module, shader.name);
            self.modules.push((shader.name, module));
        }
        Ok(())
    }

    fn module(&self, shader: &Shader) -> vk::ShaderModule {
        let found = self.modules.iter().find(|(name, _)| *name == shader.name);
        found.expect("a shader of this program").1
    }

    /// A graphics pipeline of two of the program's shaders.
    pub fn graphics(&self, context: &Context, info: &GraphicsInfo) -> Result<vk::Pipeline> {
        let (entries, data) = constants(info.constants);
        let specialisation = vk::SpecializationInfo::default().map_entries(&entries).data(&data);
        let stage = |shader: &Shader| {
            vk::PipelineShaderStageCreateInfo::default()
                .stage(stage_flags(shader.stage))
                .module(self.module(shader))
                .name(c"main")
                .specialization_info(&specialisation)
        };
        let stages = [stage(info.vertex), stage(info.fragment)];
        let streams: Vec<_> = (0..)
            .zip(info.streams)
            .map(|(binding, s)| vk::VertexInputBindingDescription { binding, stride: s.stride, ..Default::default() })
            .collect();
        let attributes: Vec<_> = (0..)
            .zip(info.streams)
            .map(|(i, s)| vk::VertexInputAttributeDescription { location: i, binding: i, format: s.format, offset: 0 })
            .collect();
        let input = vk::PipelineVertexInputStateCreateInfo::default()
            .vertex_binding_descriptions(&streams)
            .vertex_attribute_descriptions(&attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(info.topology);
        let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
        let raster = vk::PipelineRasterizationStateCreateInfo::default()
            .polygon_mode(vk::PolygonMode::FILL)
            .cull_mode(vk::CullModeFlags::NONE)
            .line_width(1.0);
        let multisample = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(info.samples);
        let mut depth = vk::PipelineDepthStencilStateCreateInfo::default();
        if let Some(mode) = &info.depth {
            depth = depth.depth_test_enable(true).depth_compare_op(mode.compare).depth_write_enable(mode.write);
            if mode.mark_hidden {
                let mark = vk::StencilOpState::default()
                    .compare_op(vk::CompareOp::ALWAYS)
                    .depth_fail_op(vk::StencilOp::REPLACE)
                    .write_mask(1)
                    .reference(1);
                depth = depth.stencil_test_enable(true).front(mark).back(mark);
            }
        }
        let depth_format = info.depth.as_ref().map_or(vk::Format::UNDEFINED, |mode| mode.format);
        let stencil = aspect(depth_format).contains(vk::ImageAspectFlags::STENCIL);
        let formats: Vec<_> = info.colors.iter().map(|c| c.format).collect();
        let blends: Vec<_> = info.colors.iter().map(|c| c.blend.state()).collect();
        let mut blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends);
        if info.ordered {
            blend = blend.flags(vk::PipelineColorBlendStateCreateFlags::RASTERIZATION_ORDER_ATTACHMENT_ACCESS_EXT);
        }
        let dynamic = vk::PipelineDynamicStateCreateInfo::default()
            .dynamic_states(&[vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR]);
        let mut rendering = vk::PipelineRenderingCreateInfo::default()
            .view_mask(info.view_mask)
            .color_attachment_formats(&formats)
            .depth_attachment_format(depth_format)
            .stencil_attachment_format(if stencil { depth_format } else { vk::Format::UNDEFINED });
        let mut create = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&raster)
            .multisample_state(&multisample)
            .depth_stencil_state(&depth)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(self.layout);
        create = match info.render_pass {
            Some((pass, subpass)) => create.render_pass(pass).subpass(subpass),
            None => create.push_next(&mut rendering),
        };
        // SAFETY: everything that the description points to lives until the call returns; the device has the features
        // that it uses, which are among the required ones.
        let made = unsafe { context.device.create_graphics_pipelines(context.pipeline_cache, &[create], None) };
        self.made(context, made, info.name, "vkCreateGraphicsPipelines")
    }

    /// A compute pipeline of one of the program's shaders.
    pub fn compute(
        &self,
        context: &Context,
        name: &str,
        shader: &Shader,
        constant_values: &[u32],
    ) -> Result<vk::Pipeline> {
        let (entries, data) = constants(constant_values);
        let specialisation = vk::SpecializationInfo::default().map_entries(&entries).data(&data);
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(stage_flags(shader.stage))
            .module(self.module(shader))
            .name(c"main")
            .specialization_info(&specialisation);
        let create = vk::ComputePipelineCreateInfo::default().stage(stage).layout(self.layout);
        // SAFETY: as for graphics pipelines.
        let made = unsafe { context.device.create_compute_pipelines(context.pipeline_cache, &[create], None) };
        self.made(context, made, name, "vkCreateComputePipelines")
    }

    fn made(
        &self,
        context: &Context,
        made: Result<Vec<vk::Pipeline>, (Vec<vk::Pipeline>, vk::Result)>,
        name: &str,
        call: &'static str,
    ) -> Result<vk::Pipeline> {
        let pipelines = made.map_err(|(_, result)| result).named(call)?;
        context.name(pipelines[0], name);
        Ok(pipelines[0])
    }

    /// Destroys layouts and modules; no command buffer that uses them is pending.
    pub fn destroy(self, context: &Context) {
        // SAFETY: not in use (a precondition), destroyed once; null handles are allowed.
        unsafe {
            for (_, module) in self.modules {
                context.device.destroy_shader_module(module, None);
            }
            context.device.destroy_pipeline_layout(self.layout, None);
            for set in self.sets {
                context.device.destroy_descriptor_set_layout(set, None);
            }
        }
    }
}

/// What a graphics pipeline is made of besides its shaders' bindings.
pub struct GraphicsInfo<'a> {
    /// Debug name.
    pub name: &'a str,
    /// Vertex shader.
    pub vertex: &'a Shader,
    /// Fragment shader.
    pub fragment: &'a Shader,
    /// Values of the specialisation constants 0, 1, 2 …, given to both stages.
    pub constants: &'a [u32],
    /// Vertex streams, one attribute each.
    pub streams: &'a [Stream],
    /// Points or triangles.
    pub topology: vk::PrimitiveTopology,
    /// By location.
    pub colors: &'a [ColorTarget],
    /// Depth test, if there is a depth attachment.
    pub depth: Option<DepthMode>,
    /// Samples a pixel.
    pub samples: vk::SampleCountFlags,
    /// Views drawn at once, as bits; 0 without multiview.
    pub view_mask: u32,
    /// Render pass and subpass; `None` for dynamic rendering.
    pub render_pass: Option<(vk::RenderPass, u32)>,
    /// Fragments read what those before them wrote to the pass's attachments: the subpass is an ordered one.
    pub ordered: bool,
}

/// What a pipeline does with depth.
#[derive(Debug, Clone, Copy)]
pub struct DepthMode {
    /// Of the attachment.
    pub format: vk::Format,
    /// Comparison.
    pub compare: vk::CompareOp,
    /// Whether depth is written.
    pub write: bool,
    /// Whether the stencil is set to 1 where a fragment fails.
    pub mark_hidden: bool,
}

/// One vertex stream with one attribute.
#[derive(Debug, Clone, Copy)]
pub struct Stream {
    /// Bytes from one vertex to the next.
    pub stride: u32,
    /// Of the attribute.
    pub format: vk::Format,
}

/// One colour attachment of a pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ColorTarget {
    /// Format.
    pub format: vk::Format,
    /// How fragments enter it.
    pub blend: BlendMode,
}

/// How a fragment enters an attachment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BlendMode {
    /// It does not.
    Keep,
    /// It replaces.
    Replace,
    /// It is added.
    Add,
    /// Colour is added; of alpha the greater value stays.
    AddMax,
    /// Premultiplied over.
    Over,
}

impl BlendMode {
    fn state(self) -> vk::PipelineColorBlendAttachmentState {
        let state = vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA);
        let blended = |alpha_op, destination| {
            state
                .blend_enable(true)
                .color_blend_op(vk::BlendOp::ADD)
                .alpha_blend_op(alpha_op)
                .src_color_blend_factor(vk::BlendFactor::ONE)
                .src_alpha_blend_factor(vk::BlendFactor::ONE)
                .dst_color_blend_factor(destination)
                .dst_alpha_blend_factor(destination)
        };
        match self {
            BlendMode::Keep => state.color_write_mask(vk::ColorComponentFlags::empty()),
            BlendMode::Replace => state,
            BlendMode::Add => blended(vk::BlendOp::ADD, vk::BlendFactor::ONE),
            BlendMode::AddMax => blended(vk::BlendOp::MAX, vk::BlendFactor::ONE),
            BlendMode::Over => blended(vk::BlendOp::ADD, vk::BlendFactor::ONE_MINUS_SRC_ALPHA),
        }
    }
}

/// Map entries and bytes of the constants 0, 1, 2 …
fn constants(values: &[u32]) -> (Vec<vk::SpecializationMapEntry>, Vec<u8>) {
    let entries =
        (0..values.len() as u32).map(|i| vk::SpecializationMapEntry { constant_id: i, offset: 4 * i, size: 4 });
    (entries.collect(), bytemuck::cast_slice(values).to_vec())
}

fn stage_flags(stage: Stage) -> vk::ShaderStageFlags {
    match stage {
        Stage::Vertex => vk::ShaderStageFlags::VERTEX,
        Stage::Fragment => vk::ShaderStageFlags::FRAGMENT,
        Stage::Compute => vk::ShaderStageFlags::COMPUTE,
    }
}

fn descriptor_type(kind: Kind, dynamic_uniforms: bool) -> vk::DescriptorType {
    match kind {
        Kind::UniformBuffer if dynamic_uniforms => vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC,
        Kind::UniformBuffer => vk::DescriptorType::UNIFORM_BUFFER,
        Kind::StorageBuffer => vk::DescriptorType::STORAGE_BUFFER,
        Kind::SampledImage => vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
        Kind::StorageImage => vk::DescriptorType::STORAGE_IMAGE,
        Kind::InputAttachment => vk::DescriptorType::INPUT_ATTACHMENT,
    }
}
