//! Planted faults, each of which the layers must report: proof that their silence about everything else means something.
//!
//! This is the one place where Vulkan is misused, and on purpose. A fault that a driver could stumble over is only
//! recorded, never submitted; those that are submitted stay within memory that belongs to them.

use ash::vk;

use super::device::{Options, Standalone};
use super::validation::{Layers, Message};
use crate::error::{Error, Named, Result};
use crate::gpu::spirv::{Shader, generated as spirv};

/// A planted fault.
#[derive(Debug, Clone, Copy)]
pub struct Canary {
    /// What is wrong.
    pub name: &'static str,
    /// Checks that must be on to see it.
    pub needs: Layers,
    /// Part of the message's id or text, by which it is known.
    pub expected: &'static str,
    plant: fn(&mut Kit) -> Result<()>,
}

const CORE: Layers = Layers { core: true, sync: false, gpu_assisted: false };
const SYNC: Layers = Layers { core: true, sync: true, gpu_assisted: false };
const GPU: Layers = Layers { core: true, sync: false, gpu_assisted: true };

/// Every canary; those that need a check that is not wanted are the caller's to leave out.
pub const ALL: &[Canary] = &[
    canary("a buffer of no size", CORE, "VUID-VkBufferCreateInfo-size-00912", empty_buffer),
    canary("a fence left alive", CORE, "VUID-vkDestroyDevice-device-00378", leak),
    canary("a fill without the usage flag", CORE, "VUID-vkCmdFillBuffer-dstBuffer-00029", missing_usage),
    canary("a buffer without memory", CORE, "VUID-vkCmdFillBuffer-dstBuffer-00031", no_memory),
    canary("an image in the wrong layout", CORE, "InvalidImageLayout", wrong_layout),
    canary("a dispatch without its set", CORE, "VUID-vkCmdDispatch-None-02697", no_set),
    canary("a dispatch without a pipeline", CORE, "VUID-vkCmdDispatch-None-02700", no_pipeline),
    canary("push constants out of range", CORE, "VUID-vkCmdPushConstants-offset-01795", push_range),
    canary("a pass that is not ended", CORE, "VUID-vkEndCommandBuffer-commandBuffer-00060", open_pass),
    canary("a pipeline for another format", CORE, "VUID-vkCmdDraw-colorAttachmentCount-06180", wrong_format),
    canary("a copy inside a pass", CORE, "VUID-vkCmdFillBuffer-renderpass", fill_in_pass),
    canary("write after write", SYNC, "SYNC-HAZARD-WRITE-AFTER-WRITE", write_after_write),
    canary("read after write", SYNC, "SYNC-HAZARD-READ-AFTER-WRITE", read_after_write),
    canary("write after read", SYNC, "SYNC-HAZARD-WRITE-AFTER-READ", write_after_read),
    canary("a dispatch reads what another writes", SYNC, "SYNC-HAZARD-READ-AFTER-WRITE", dispatches),
    canary("a transition that does not wait", SYNC, "SYNC-HAZARD-WRITE-AFTER-WRITE", transition),
    canary("write after write across submits", SYNC, "SYNC-HAZARD-WRITE-AFTER-WRITE", across_submits),
    canary("a store past the end", GPU, "VUID-vkCmdDispatch-None-02706", store_past_end),
    canary("a load past the end", GPU, "VUID-vkCmdDispatch-None-02706", load_past_end),
    canary("a descriptor past the array", GPU, "UNASSIGNED-Descriptor index out of bounds", descriptor_index),
];

const fn canary(
    name: &'static str,
    needs: Layers,
    expected: &'static str,
    plant: fn(&mut Kit) -> Result<()>,
) -> Canary {
    Canary { name, needs, expected, plant }
}

impl Canary {
    /// Whether a run with these checks can see it.
    pub fn runs_with(&self, layers: Layers) -> bool {
        let Layers { core, sync, gpu_assisted } = self.needs;
        (layers.any() || !core) && (layers.sync || !sync) && (layers.gpu_assisted || !gpu_assisted)
    }

    /// Plants the fault on a device of its own with just the checks that it needs (others may stumble over it), and
    /// returns everything that the layers said. Of `options` the layers are ignored.
    pub fn run(&self, options: &Options) -> Result<Vec<Message>> {
        let standalone = Standalone::new(&Options { layers: self.needs, ..options.clone() })?;
        let lacking = standalone.lacking(self.needs);
        if !lacking.is_empty() {
            return Err(Error::Unsupported(format!("the layers lack {}", lacking.join(", "))));
        }
        let mut kit = Kit { standalone: &standalone, made: Vec::new() };
        let planted = (self.plant)(&mut kit);
        kit.destroy();
        let messages = standalone.close();
        planted.map(|()| messages)
    }

    /// Whether the fault is among the messages.
    pub fn is_reported(&self, messages: &[Message]) -> bool {
        messages.iter().any(|m| m.id.contains(self.expected) || m.text.contains(self.expected))
    }
}

/// What the faults are made of, destroyed afterwards in reverse order.
struct Kit<'a> {
    standalone: &'a Standalone,
    made: Vec<Made>,
}

enum Made {
    Buffer(vk::Buffer),
    Image(vk::Image),
    View(vk::ImageView),
    Memory(vk::DeviceMemory),
    SetLayout(vk::DescriptorSetLayout),
    Layout(vk::PipelineLayout),
    Module(vk::ShaderModule),
    Pipeline(vk::Pipeline),
    Pool(vk::DescriptorPool),
}

/// A compute pipeline with its layout and a set.
struct Compute {
    pipeline: vk::Pipeline,
    layout: vk::PipelineLayout,
    set: vk::DescriptorSet,
}

/// Size of a buffer, and of the memory behind it: what lies past a buffer's end is still its own memory.
const BYTES: u64 = 64;
const MEMORY: u64 = 4096;
const COLOR: vk::Format = vk::Format::R8G8B8A8_UNORM;
const EXTENT: vk::Extent2D = vk::Extent2D { width: 8, height: 8 };

impl Kit<'_> {
    fn device(&self) -> &ash::Device {
        &self.standalone.device
    }

    fn memory(&mut self, requirements: vk::MemoryRequirements) -> Result<vk::DeviceMemory> {
        let index = requirements.memory_type_bits.trailing_zeros();
        let info =
            vk::MemoryAllocateInfo::default().allocation_size(requirements.size + MEMORY).memory_type_index(index);
        // SAFETY: the device lives; the type is one that the resource allows.
        let memory = unsafe { self.device().allocate_memory(&info, None) }.named("vkAllocateMemory")?;
        self.made.push(Made::Memory(memory));
        Ok(memory)
    }

    fn buffer(&mut self, usage: vk::BufferUsageFlags) -> Result<vk::Buffer> {
        let buffer = self.bare_buffer(usage)?;
        // SAFETY: the buffer was made just above.
        let requirements = unsafe { self.device().get_buffer_memory_requirements(buffer) };
        let memory = self.memory(requirements)?;
        // SAFETY: memory of a fitting type and size, bound once.
        unsafe { self.device().bind_buffer_memory(buffer, memory, 0) }.named("vkBindBufferMemory")?;
        Ok(buffer)
    }

    fn bare_buffer(&mut self, usage: vk::BufferUsageFlags) -> Result<vk::Buffer> {
        let info = vk::BufferCreateInfo::default().size(BYTES).usage(usage);
        // SAFETY: the device lives.
        let buffer = unsafe { self.device().create_buffer(&info, None) }.named("vkCreateBuffer")?;
        self.made.push(Made::Buffer(buffer));
        Ok(buffer)
    }

    fn image(&mut self) -> Result<(vk::Image, vk::ImageView)> {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(COLOR)
            .extent(vk::Extent3D { width: EXTENT.width, height: EXTENT.height, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::COLOR_ATTACHMENT);
        // SAFETY: the device lives.
        let image = unsafe { self.device().create_image(&info, None) }.named("vkCreateImage")?;
        self.made.push(Made::Image(image));
        // SAFETY: the image was made just above.
        let requirements = unsafe { self.device().get_image_memory_requirements(image) };
        let memory = self.memory(requirements)?;
        let view = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(COLOR)
            .subresource_range(RANGE);
        // SAFETY: memory of a fitting type and size, bound once; the view is of the image's format.
        let view = unsafe {
            self.device().bind_image_memory(image, memory, 0).named("vkBindImageMemory")?;
            self.device().create_image_view(&view, None).named("vkCreateImageView")?
        };
        self.made.push(Made::View(view));
        Ok((image, view))
    }

    fn module(&mut self, shader: &Shader) -> Result<vk::ShaderModule> {
        let info = vk::ShaderModuleCreateInfo::default().code(shader.words);
        // SAFETY: the build validated the words.
        let module = unsafe { self.device().create_shader_module(&info, None) }.named("vkCreateShaderModule")?;
        self.made.push(Made::Module(module));
        Ok(module)
    }

    fn layout(&mut self, sets: &[vk::DescriptorSetLayout]) -> Result<vk::PipelineLayout> {
        let push = [vk::PushConstantRange { stage_flags: vk::ShaderStageFlags::COMPUTE, offset: 0, size: 4 }];
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(sets).push_constant_ranges(&push);
        // SAFETY: device and set layouts live.
        let layout = unsafe { self.device().create_pipeline_layout(&info, None) }.named("vkCreatePipelineLayout")?;
        self.made.push(Made::Layout(layout));
        Ok(layout)
    }

    /// A pipeline whose binding `i` is an array of the `i`-th buffers.
    fn compute(&mut self, shader: &Shader, bindings: &[&[vk::Buffer]]) -> Result<Compute> {
        let storage = vk::DescriptorType::STORAGE_BUFFER;
        let binding = |(i, buffers): (u32, &&[vk::Buffer])| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(i)
                .descriptor_type(storage)
                .descriptor_count(buffers.len() as u32)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
        };
        let in_set: Vec<_> = (0..).zip(bindings).map(binding).collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&in_set);
        // SAFETY: the device lives.
        let set_layout = unsafe { self.device().create_descriptor_set_layout(&info, None) };
        let set_layout = set_layout.named("vkCreateDescriptorSetLayout")?;
        self.made.push(Made::SetLayout(set_layout));
        let layout = self.layout(&[set_layout])?;
        let module = self.module(shader)?;
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main");
        let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout)];
        // SAFETY: module and layout live and fit each other.
        let made = unsafe { self.device().create_compute_pipelines(vk::PipelineCache::null(), &info, None) };
        let pipeline = made.map_err(|(_, e)| e).named("vkCreateComputePipelines")?[0];
        self.made.push(Made::Pipeline(pipeline));

        let sizes = [vk::DescriptorPoolSize { ty: storage, descriptor_count: 4 }];
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: the device lives.
        let pool = unsafe { self.device().create_descriptor_pool(&info, None) }.named("vkCreateDescriptorPool")?;
        self.made.push(Made::Pool(pool));
        let layouts = [set_layout];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: the pool has room for the set.
        let set = unsafe { self.device().allocate_descriptor_sets(&info) }.named("vkAllocateDescriptorSets")?[0];
        let cut = |buffer: &vk::Buffer| vk::DescriptorBufferInfo { buffer: *buffer, offset: 0, range: vk::WHOLE_SIZE };
        let infos: Vec<Vec<_>> = bindings.iter().map(|b| b.iter().map(cut).collect()).collect();
        let mut writes = Vec::new();
        for (i, infos) in (0..).zip(&infos) {
            let write = vk::WriteDescriptorSet::default().dst_set(set).dst_binding(i);
            writes.push(write.descriptor_type(storage).buffer_info(infos));
        }
        // SAFETY: the set is in no use; the buffers live.
        unsafe { self.device().update_descriptor_sets(&writes, &[]) };
        Ok(Compute { pipeline, layout, set })
    }

    /// Records one dispatch of a single invocation.
    fn dispatch(&self, cmd: vk::CommandBuffer, compute: &Compute, at: u32) {
        let (point, stage) = (vk::PipelineBindPoint::COMPUTE, vk::ShaderStageFlags::COMPUTE);
        let device = self.device();
        // SAFETY: recording outside a pass; all objects live until the submit is complete.
        unsafe {
            device.cmd_bind_pipeline(cmd, point, compute.pipeline);
            device.cmd_bind_descriptor_sets(cmd, point, compute.layout, 0, &[compute.set], &[]);
            device.cmd_push_constants(cmd, compute.layout, stage, 0, &at.to_le_bytes());
            device.cmd_dispatch(cmd, 1, 1, 1);
        }
    }

    /// Records, submits and waits.
    fn submit(&self, record: impl FnOnce(vk::CommandBuffer)) -> Result<()> {
        self.standalone.run(self.standalone.command_buffer()?, |cmd| {
            record(cmd);
            Ok(())
        })
    }

    /// Only records: the driver never sees the commands run.
    fn record(&self, record: impl FnOnce(vk::CommandBuffer)) -> Result<()> {
        let cmd = self.standalone.command_buffer()?;
        // SAFETY: a new buffer. The end may be refused, which is then the purpose.
        unsafe {
            self.device().begin_command_buffer(cmd, &Default::default()).named("vkBeginCommandBuffer")?;
            record(cmd);
            let _ = self.device().end_command_buffer(cmd);
        }
        Ok(())
    }

    fn destroy(self) {
        let device = &self.standalone.device;
        // SAFETY: every submit was waited for; each object is destroyed once, users before what they use. Waiting is for
        // submits that a canary does not wait for.
        unsafe {
            let _ = device.device_wait_idle();
            for made in self.made.into_iter().rev() {
                match made {
                    Made::Buffer(it) => device.destroy_buffer(it, None),
                    Made::Image(it) => device.destroy_image(it, None),
                    Made::View(it) => device.destroy_image_view(it, None),
                    Made::Memory(it) => device.free_memory(it, None),
                    Made::SetLayout(it) => device.destroy_descriptor_set_layout(it, None),
                    Made::Layout(it) => device.destroy_pipeline_layout(it, None),
                    Made::Module(it) => device.destroy_shader_module(it, None),
                    Made::Pipeline(it) => device.destroy_pipeline(it, None),
                    Made::Pool(it) => device.destroy_descriptor_pool(it, None),
                }
            }
        }
    }
}

const RANGE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};
const SOURCE: vk::BufferUsageFlags = vk::BufferUsageFlags::TRANSFER_SRC;
const DESTINATION: vk::BufferUsageFlags = vk::BufferUsageFlags::TRANSFER_DST;
const STORAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::STORAGE_BUFFER;

fn empty_buffer(kit: &mut Kit) -> Result<()> {
    let info = vk::BufferCreateInfo::default().size(0).usage(SOURCE);
    // SAFETY: misuse is the purpose; the size of zero never reaches memory, since nothing is bound.
    if let Ok(buffer) = unsafe { kit.device().create_buffer(&info, None) } {
        kit.made.push(Made::Buffer(buffer));
    }
    Ok(())
}

fn leak(kit: &mut Kit) -> Result<()> {
    // SAFETY: misuse is the purpose: the fence is never destroyed.
    unsafe { kit.device().create_fence(&Default::default(), None) }.named("vkCreateFence")?;
    Ok(())
}

fn missing_usage(kit: &mut Kit) -> Result<()> {
    let buffer = kit.buffer(SOURCE)?;
    // SAFETY: misuse is the purpose, and nothing is submitted.
    kit.record(|cmd| unsafe { kit.device().cmd_fill_buffer(cmd, buffer, 0, 16, 0) })
}

fn no_memory(kit: &mut Kit) -> Result<()> {
    let buffer = kit.bare_buffer(DESTINATION)?;
    // SAFETY: misuse is the purpose, and nothing is submitted.
    kit.record(|cmd| unsafe { kit.device().cmd_fill_buffer(cmd, buffer, 0, 16, 0) })
}

fn wrong_layout(kit: &mut Kit) -> Result<()> {
    let (image, _) = kit.image()?;
    let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
    // SAFETY: misuse is the purpose: the image is still undefined. Its memory is its own, so the clear harms nobody.
    kit.submit(|cmd| unsafe { kit.device().cmd_clear_color_image(cmd, image, layout, &Default::default(), &[RANGE]) })
}

fn no_set(kit: &mut Kit) -> Result<()> {
    let buffer = kit.buffer(STORAGE)?;
    let compute = kit.compute(&spirv::CANARY_FILL_COMP, &[&[buffer]])?;
    // SAFETY: misuse is the purpose, and nothing is submitted.
    kit.record(|cmd| unsafe {
        kit.device().cmd_bind_pipeline(cmd, vk::PipelineBindPoint::COMPUTE, compute.pipeline);
        kit.device().cmd_dispatch(cmd, 1, 1, 1);
    })
}

fn no_pipeline(kit: &mut Kit) -> Result<()> {
    // SAFETY: misuse is the purpose, and nothing is submitted.
    kit.record(|cmd| unsafe { kit.device().cmd_dispatch(cmd, 1, 1, 1) })
}

fn push_range(kit: &mut Kit) -> Result<()> {
    let layout = kit.layout(&[])?;
    let stage = vk::ShaderStageFlags::COMPUTE;
    // SAFETY: misuse is the purpose, and nothing is submitted: the layout has four bytes.
    kit.record(|cmd| unsafe { kit.device().cmd_push_constants(cmd, layout, stage, 0, &[0; 8]) })
}

fn attachment(view: vk::ImageView) -> vk::RenderingAttachmentInfo<'static> {
    vk::RenderingAttachmentInfo::default()
        .image_view(view)
        .image_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
        .load_op(vk::AttachmentLoadOp::CLEAR)
        .store_op(vk::AttachmentStoreOp::STORE)
}

fn rendering<'a>(colors: &'a [vk::RenderingAttachmentInfo<'a>]) -> vk::RenderingInfo<'a> {
    let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: EXTENT };
    vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(colors)
}

fn open_pass(kit: &mut Kit) -> Result<()> {
    let (_, view) = kit.image()?;
    let colors = [attachment(view)];
    // SAFETY: misuse is the purpose, and nothing is submitted.
    kit.record(|cmd| unsafe { kit.device().cmd_begin_rendering(cmd, &rendering(&colors)) })
}

fn fill_in_pass(kit: &mut Kit) -> Result<()> {
    let (_, view) = kit.image()?;
    let buffer = kit.buffer(DESTINATION)?;
    let colors = [attachment(view)];
    // SAFETY: misuse is the purpose, and nothing is submitted.
    kit.record(|cmd| unsafe {
        kit.device().cmd_begin_rendering(cmd, &rendering(&colors));
        kit.device().cmd_fill_buffer(cmd, buffer, 0, 16, 0);
        kit.device().cmd_end_rendering(cmd);
    })
}

fn wrong_format(kit: &mut Kit) -> Result<()> {
    let (_, view) = kit.image()?;
    let layout = kit.layout(&[])?;
    let modules = [kit.module(&spirv::COMPOSITE_TRIANGLE_VERT)?, kit.module(&spirv::CANARY_WHITE_FRAG)?];
    let flags = [vk::ShaderStageFlags::VERTEX, vk::ShaderStageFlags::FRAGMENT];
    let stage =
        |i: usize| vk::PipelineShaderStageCreateInfo::default().stage(flags[i]).module(modules[i]).name(c"main");
    let stages = [stage(0), stage(1)];
    let input = vk::PipelineVertexInputStateCreateInfo::default();
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let area = [vk::Rect2D { offset: vk::Offset2D::default(), extent: EXTENT }];
    let viewports = [vk::Viewport { width: 8.0, height: 8.0, max_depth: 1.0, ..Default::default() }];
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewports(&viewports).scissors(&area);
    let raster = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
    let multisample =
        vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let blends = [vk::PipelineColorBlendAttachmentState::default()];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends);
    // Made for floats, used with bytes.
    let formats = [vk::Format::R32G32B32A32_SFLOAT];
    let mut dynamic = vk::PipelineRenderingCreateInfo::default().color_attachment_formats(&formats);
    let info = [vk::GraphicsPipelineCreateInfo::default()
        .stages(&stages)
        .vertex_input_state(&input)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&raster)
        .multisample_state(&multisample)
        .color_blend_state(&blend)
        .layout(layout)
        .push_next(&mut dynamic)];
    // SAFETY: the description is complete, and all that it points to lives until the call returns.
    let made = unsafe { kit.device().create_graphics_pipelines(vk::PipelineCache::null(), &info, None) };
    let pipeline = made.map_err(|(_, e)| e).named("vkCreateGraphicsPipelines")?[0];
    kit.made.push(Made::Pipeline(pipeline));
    let colors = [attachment(view)];
    // SAFETY: misuse is the purpose, and nothing is submitted.
    kit.record(|cmd| unsafe {
        kit.device().cmd_begin_rendering(cmd, &rendering(&colors));
        kit.device().cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
        kit.device().cmd_draw(cmd, 3, 1, 0, 0);
        kit.device().cmd_end_rendering(cmd);
    })
}

fn write_after_write(kit: &mut Kit) -> Result<()> {
    let buffer = kit.buffer(DESTINATION)?;
    // SAFETY: misuse is the purpose: no barrier between the fills of one buffer, whose content nobody reads.
    kit.submit(|cmd| unsafe {
        kit.device().cmd_fill_buffer(cmd, buffer, 0, 64, 1);
        kit.device().cmd_fill_buffer(cmd, buffer, 0, 64, 2);
    })
}

const WHOLE: [vk::BufferCopy; 1] = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: 64 }];

fn read_after_write(kit: &mut Kit) -> Result<()> {
    let (from, to) = (kit.buffer(SOURCE | DESTINATION)?, kit.buffer(DESTINATION)?);
    // SAFETY: misuse is the purpose: the copy does not wait for the fill. Nobody reads the result.
    kit.submit(|cmd| unsafe {
        kit.device().cmd_fill_buffer(cmd, from, 0, 64, 1);
        kit.device().cmd_copy_buffer(cmd, from, to, &WHOLE);
    })
}

fn write_after_read(kit: &mut Kit) -> Result<()> {
    let (from, to) = (kit.buffer(SOURCE | DESTINATION)?, kit.buffer(DESTINATION)?);
    // SAFETY: misuse is the purpose: the fill does not wait for the copy. Nobody reads the result.
    kit.submit(|cmd| unsafe {
        kit.device().cmd_copy_buffer(cmd, from, to, &WHOLE);
        kit.device().cmd_fill_buffer(cmd, from, 0, 64, 1);
    })
}

fn dispatches(kit: &mut Kit) -> Result<()> {
    let (first, second) = (kit.buffer(STORAGE)?, kit.buffer(STORAGE)?);
    let fill = kit.compute(&spirv::CANARY_FILL_COMP, &[&[first]])?;
    let read = kit.compute(&spirv::CANARY_READ_COMP, &[&[second], &[first]])?;
    // Misuse is the purpose: no barrier between a dispatch that writes and one that reads.
    kit.submit(|cmd| {
        kit.dispatch(cmd, &fill, 0);
        kit.dispatch(cmd, &read, 0);
    })
}

fn transition(kit: &mut Kit) -> Result<()> {
    let (image, _) = kit.image()?;
    use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
    let barrier = |old, new, stage, access| {
        vk::ImageMemoryBarrier2::default()
            .image(image)
            .subresource_range(RANGE)
            .old_layout(old)
            .new_layout(new)
            .dst_stage_mask(stage)
            .dst_access_mask(access)
    };
    let first = [barrier(L::UNDEFINED, L::TRANSFER_DST_OPTIMAL, S::CLEAR, A::TRANSFER_WRITE)];
    let second = [barrier(
        L::TRANSFER_DST_OPTIMAL,
        L::COLOR_ATTACHMENT_OPTIMAL,
        S::COLOR_ATTACHMENT_OUTPUT,
        A::COLOR_ATTACHMENT_WRITE,
    )];
    // SAFETY: misuse is the purpose: the second transition waits for nothing, though a clear was recorded before it.
    kit.submit(|cmd| unsafe {
        let device = kit.device();
        device.cmd_pipeline_barrier2(cmd, &vk::DependencyInfo::default().image_memory_barriers(&first));
        device.cmd_clear_color_image(cmd, image, L::TRANSFER_DST_OPTIMAL, &Default::default(), &[RANGE]);
        device.cmd_pipeline_barrier2(cmd, &vk::DependencyInfo::default().image_memory_barriers(&second));
    })
}

fn across_submits(kit: &mut Kit) -> Result<()> {
    let buffer = kit.buffer(DESTINATION)?;
    let mut submits = Vec::new();
    for value in [1, 2] {
        let cmd = kit.standalone.command_buffer()?;
        // SAFETY: a new buffer, recorded once.
        unsafe {
            kit.device().begin_command_buffer(cmd, &Default::default()).named("vkBeginCommandBuffer")?;
            kit.device().cmd_fill_buffer(cmd, buffer, 0, 64, value);
            kit.device().end_command_buffer(cmd).named("vkEndCommandBuffer")?;
        }
        submits.push([vk::CommandBufferSubmitInfo::default().command_buffer(cmd)]);
    }
    for buffers in &submits {
        let submit = [vk::SubmitInfo2::default().command_buffer_infos(buffers)];
        // SAFETY: misuse is the purpose: nothing orders the second submit after the first. Nobody reads the buffer, and
        // `destroy` waits for both.
        unsafe { kit.device().queue_submit2(kit.standalone.queue, &submit, vk::Fence::null()) }
            .named("vkQueueSubmit2")?;
    }
    Ok(())
}

/// A word past the end of a buffer, well within its memory.
const PAST: u32 = 100;
const _: () = assert!(4 * PAST as u64 >= BYTES && 4 * PAST as u64 + 4 <= MEMORY);

fn store_past_end(kit: &mut Kit) -> Result<()> {
    let buffer = kit.buffer(STORAGE)?;
    let fill = kit.compute(&spirv::CANARY_FILL_COMP, &[&[buffer]])?;
    // Misuse is the purpose: past the buffer's end, within its memory.
    kit.submit(|cmd| kit.dispatch(cmd, &fill, PAST))
}

fn load_past_end(kit: &mut Kit) -> Result<()> {
    let (from, to) = (kit.buffer(STORAGE)?, kit.buffer(STORAGE)?);
    let read = kit.compute(&spirv::CANARY_READ_COMP, &[&[to], &[from]])?;
    // Misuse is the purpose: past the buffer's end, within its memory.
    kit.submit(|cmd| kit.dispatch(cmd, &read, PAST))
}

fn descriptor_index(kit: &mut Kit) -> Result<()> {
    let (a, b, to) = (kit.buffer(STORAGE)?, kit.buffer(STORAGE)?, kit.buffer(STORAGE)?);
    let index = kit.compute(&spirv::CANARY_INDEX_COMP, &[&[to], &[a, b]])?;
    // Misuse is the purpose: the sixth of two descriptors. The instrumented shader reports it in place of the load.
    kit.submit(|cmd| kit.dispatch(cmd, &index, 5))
}
