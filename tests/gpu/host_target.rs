//! The engine's targets and its frame: opaque geometry of its own, then the splats, then a copy to look at.

use std::ffi::c_void;
use std::ptr::NonNull;

use surfel::TargetFormats;
use surfel::ash::vk;
use surfel::select::{DepthConvention, View};
use surfel::style::Style;
use surfel::technique::Technique;
use surfel::{FrameInput, GpuMemory, HostDepth, Instance, Location, Memory, MemoryRequest, PassKind, Renderer};

use crate::host_engine::{Engine, OwnMemory};

/// What the engine knows of depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Nothing.
    None,
    /// Its pass tests it, `render` is not told.
    Tested,
    /// `render` may sample it too.
    Lent,
}

/// How an engine draws.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    pub color: vk::Format,
    pub encode_srgb: bool,
    pub samples: vk::SampleCountFlags,
    pub views: u32,
    pub depth: Depth,
    pub convention: DepthConvention,
    pub render_pass: bool,
    /// Size of the target [px].
    pub size: [u32; 2],
    /// The picture's place in it [px].
    pub offset: [i32; 2],
    pub extent: [u32; 2],
    /// The engine's own opaque geometry is drawn.
    pub geometry: bool,
}

/// The plain one: everything else is compared with it.
pub const PLAIN: Kind = Kind {
    color: vk::Format::R32G32B32A32_SFLOAT,
    encode_srgb: false,
    samples: vk::SampleCountFlags::TYPE_1,
    views: 1,
    depth: Depth::None,
    convention: DepthConvention::Reversed,
    render_pass: false,
    size: [64, 48],
    offset: [0, 0],
    extent: [64, 48],
    geometry: false,
};

/// The engine's opaque geometry: near on the left half of the picture, far on the lower part of the right half.
pub const NEAR_COLOR: [f32; 4] = [0.0, 0.25, 0.5, 1.0];
pub const FAR_COLOR: [f32; 4] = [0.5, 0.25, 0.0, 1.0];
/// Linear depths, before and behind every scene that is drawn here.
pub const NEAR_Z: f64 = 0.5;
pub const FAR_Z: f64 = 50.0;
pub const DEPTH_FORMAT: vk::Format = vk::Format::D32_SFLOAT;

impl Kind {
    fn mask(&self) -> u32 {
        if self.views > 1 { (1 << self.views) - 1 } else { 0 }
    }

    pub fn multisampled(&self) -> bool {
        self.samples != vk::SampleCountFlags::TYPE_1
    }

    /// Near and far rectangle of the engine's geometry.
    pub fn rectangles(&self) -> [vk::Rect2D; 2] {
        let [w, h] = self.extent;
        let [x, y] = self.offset;
        let rect =
            |x, y, width, height| vk::Rect2D { offset: vk::Offset2D { x, y }, extent: vk::Extent2D { width, height } };
        [rect(x, y, w / 2, h), rect(x + w as i32 / 2, y + h as i32 / 2, w / 2, h / 2)]
    }
}

pub struct Texture {
    pub image: vk::Image,
    pub view: vk::ImageView,
    memory: Option<Memory>,
    aspect: vk::ImageAspectFlags,
}

/// A target with what it takes to draw to it and to look at it.
pub struct Target {
    pub kind: Kind,
    pub color: Texture,
    pub resolved: Option<Texture>,
    pub depth: Option<Texture>,
    pub single_depth: Option<Texture>,
    pub pass: vk::RenderPass,
    framebuffer: vk::Framebuffer,
    buffer: vk::Buffer,
    buffer_memory: Option<Memory>,
    mapped: NonNull<c_void>,
    depth_at: u64,
    memory: OwnMemory,
}

// SAFETY: the mapping is plain memory; the tests that send targets read it after the frame's completion.
unsafe impl Send for Target {}

fn bytes_per_pixel(format: vk::Format) -> u64 {
    match format {
        vk::Format::R32G32B32A32_SFLOAT => 16,
        vk::Format::R16G16B16A16_SFLOAT => 8,
        _ => 4,
    }
}

impl Target {
    pub fn new(engine: &Engine, kind: Kind) -> Target {
        let mut memory = engine.memory();
        use vk::ImageUsageFlags as U;
        let single = vk::SampleCountFlags::TYPE_1;
        let (color_use, depth_use) = (U::COLOR_ATTACHMENT, U::DEPTH_STENCIL_ATTACHMENT | U::SAMPLED);
        let color = texture(engine, &mut memory, &kind, kind.color, kind.samples, color_use | U::TRANSFER_SRC);
        let resolved = kind
            .multisampled()
            .then(|| texture(engine, &mut memory, &kind, kind.color, single, color_use | U::TRANSFER_SRC));
        let depth = (kind.depth != Depth::None)
            .then(|| texture(engine, &mut memory, &kind, DEPTH_FORMAT, kind.samples, depth_use | U::TRANSFER_SRC));
        let single_depth = (depth.is_some() && kind.multisampled())
            .then(|| texture(engine, &mut memory, &kind, DEPTH_FORMAT, single, depth_use | U::TRANSFER_SRC));
        let pixels = kind.size[0] as u64 * kind.size[1] as u64 * kind.views as u64;
        let depth_at = pixels * bytes_per_pixel(kind.color);
        let info =
            vk::BufferCreateInfo::default().size(depth_at + 4 * pixels).usage(vk::BufferUsageFlags::TRANSFER_DST);
        // SAFETY: the device lives; the memory fits the buffer and is bound once.
        let (buffer, buffer_memory) = unsafe {
            let buffer = engine.device.create_buffer(&info, None).expect("a buffer");
            let requirements = engine.device.get_buffer_memory_requirements(buffer);
            let request = MemoryRequest { name: "readback", requirements, location: Location::Readback, linear: true };
            let piece = memory.allocate(&request).expect("memory");
            engine.device.bind_buffer_memory(buffer, piece.memory, piece.offset).expect("bind");
            (buffer, piece)
        };
        let mapped = buffer_memory.mapped.expect("mapped");
        let mut target = Target {
            kind,
            color,
            resolved,
            depth,
            single_depth,
            pass: vk::RenderPass::null(),
            framebuffer: vk::Framebuffer::null(),
            buffer,
            buffer_memory: Some(buffer_memory),
            mapped,
            depth_at,
            memory,
        };
        if kind.render_pass {
            target.make_pass(engine);
        }
        target
    }

    /// The second of the engine's passes as a render pass: what is there is loaded, `composite` draws.
    fn make_pass(&mut self, engine: &Engine) {
        let kind = self.kind;
        let color_layout = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
        let attachment = |format, samples, layout, load| {
            vk::AttachmentDescription2::default()
                .format(format)
                .samples(samples)
                .load_op(load)
                .store_op(vk::AttachmentStoreOp::STORE)
                .stencil_load_op(vk::AttachmentLoadOp::DONT_CARE)
                .stencil_store_op(vk::AttachmentStoreOp::DONT_CARE)
                .initial_layout(layout)
                .final_layout(layout)
        };
        let load = vk::AttachmentLoadOp::LOAD;
        let mut attachments = vec![attachment(kind.color, kind.samples, color_layout, load)];
        let mut views = vec![self.color.view];
        let colors = [vk::AttachmentReference2::default().attachment(0).layout(color_layout)];
        let resolves = [vk::AttachmentReference2::default().attachment(1).layout(color_layout)];
        let mut subpass = vk::SubpassDescription2::default()
            .pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)
            .view_mask(kind.mask())
            .color_attachments(&colors);
        if let Some(resolved) = &self.resolved {
            let dont_care = vk::AttachmentLoadOp::DONT_CARE;
            attachments.push(attachment(kind.color, vk::SampleCountFlags::TYPE_1, color_layout, dont_care));
            views.push(resolved.view);
            subpass = subpass.resolve_attachments(&resolves);
        }
        let depth_layout = vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
        let depth_reference =
            vk::AttachmentReference2::default().attachment(attachments.len() as u32).layout(depth_layout);
        if let Some(depth) = &self.depth {
            attachments.push(attachment(DEPTH_FORMAT, kind.samples, depth_layout, load));
            views.push(depth.view);
            subpass = subpass.depth_stencil_attachment(&depth_reference);
        }
        let subpasses = [subpass];
        let mask = [kind.mask()];
        let mut info = vk::RenderPassCreateInfo2::default().attachments(&attachments).subpasses(&subpasses);
        if kind.mask() != 0 {
            info = info.correlated_view_masks(&mask);
        }
        // SAFETY: the device lives, and the descriptions are complete and consistent.
        unsafe {
            self.pass = engine.device.create_render_pass2(&info, None).expect("a render pass");
            let framebuffer = vk::FramebufferCreateInfo::default()
                .render_pass(self.pass)
                .attachments(&views)
                .width(kind.size[0])
                .height(kind.size[1])
                .layers(1);
            self.framebuffer = engine.device.create_framebuffer(&framebuffer, None).expect("a framebuffer");
        }
    }

    pub fn formats(&self) -> TargetFormats {
        let kind = &self.kind;
        TargetFormats {
            color: kind.color,
            depth: (kind.depth != Depth::None).then_some(DEPTH_FORMAT),
            samples: kind.samples,
            view_mask: kind.mask(),
            pass: match kind.render_pass {
                true => PassKind::RenderPass { pass: self.pass, subpass: 0 },
                false => PassKind::Dynamic,
            },
            encode_srgb: kind.encode_srgb,
        }
    }

    /// The engine's frame. The command buffer is recording; the caller ends and submits it.
    pub fn record(&self, engine: &Engine, cmd: vk::CommandBuffer, renderer: &mut Renderer, frame: &Frame) {
        self.try_record(engine, cmd, renderer, frame).expect("prepare");
    }

    /// The same, where `prepare` may fail: then the buffer goes on recording, with nothing of the library in it.
    pub fn try_record(
        &self,
        engine: &Engine,
        cmd: vk::CommandBuffer,
        renderer: &mut Renderer,
        frame: &Frame,
    ) -> surfel::Result<()> {
        let kind = &self.kind;
        self.opaque(engine, cmd, &frame.views[0]);
        let lent = self.single_depth.as_ref().or(self.depth.as_ref()).filter(|_| kind.depth == Depth::Lent);
        let input = FrameInput {
            id: frame.id,
            extent: vk::Extent2D { width: kind.extent[0], height: kind.extent[1] },
            offset: vk::Offset2D { x: kind.offset[0], y: kind.offset[1] },
            views: frame.views,
            instances: frame.instances,
            technique: frame.technique,
            style: frame.style,
            host_depth: lent.map(|d| HostDepth { view: d.view, layout: vk::ImageLayout::DEPTH_READ_ONLY_OPTIMAL }),
            count: true,
            keep_lists: false,
        };
        // SAFETY: recording outside a pass; ids grow; the depth is in its layout and visible, as `opaque` leaves it.
        unsafe {
            renderer.prepare(cmd, &input)?;
            renderer.render(cmd).expect("render");
        }
        self.begin_composite(engine, cmd);
        // SAFETY: inside the pass that the renderer was made for.
        unsafe { renderer.composite(cmd) }.expect("composite");
        self.end_composite(engine, cmd);
        self.copy(engine, cmd);
        Ok(())
    }

    /// Clears, and draws two rectangles without any shader. Leaves depth to be sampled.
    pub fn opaque(&self, engine: &Engine, cmd: vk::CommandBuffer, view: &View) {
        let kind = &self.kind;
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        let attach = (S::COLOR_ATTACHMENT_OUTPUT, A::COLOR_ATTACHMENT_WRITE | A::COLOR_ATTACHMENT_READ);
        let tests = (
            S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS | S::COLOR_ATTACHMENT_OUTPUT,
            A::DEPTH_STENCIL_ATTACHMENT_WRITE | A::DEPTH_STENCIL_ATTACHMENT_READ,
        );
        let all = (S::ALL_COMMANDS, A::MEMORY_WRITE);
        let mut barriers = vec![barrier(&self.color, L::UNDEFINED, L::COLOR_ATTACHMENT_OPTIMAL, all, attach)];
        barriers
            .extend(self.resolved.iter().map(|t| barrier(t, L::UNDEFINED, L::COLOR_ATTACHMENT_OPTIMAL, all, attach)));
        for depth in self.depth.iter().chain(&self.single_depth) {
            barriers.push(barrier(depth, L::UNDEFINED, L::DEPTH_ATTACHMENT_OPTIMAL, all, tests));
        }
        pipeline_barrier(engine, cmd, &barriers);
        let colors = [self.attachment(&self.color, vk::AttachmentLoadOp::CLEAR, false)];
        let far = kind.convention.far() as f32;
        let clear = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: far, stencil: 0 } };
        let depth = self.depth.as_ref().map(|depth| {
            let mut info = vk::RenderingAttachmentInfo::default()
                .image_view(depth.view)
                .image_layout(L::DEPTH_ATTACHMENT_OPTIMAL)
                .load_op(vk::AttachmentLoadOp::CLEAR)
                .store_op(vk::AttachmentStoreOp::STORE)
                .clear_value(clear);
            if let Some(single) = &self.single_depth {
                info = info
                    .resolve_mode(vk::ResolveModeFlags::SAMPLE_ZERO)
                    .resolve_image_view(single.view)
                    .resolve_image_layout(L::DEPTH_ATTACHMENT_OPTIMAL);
            }
            info
        });
        let mut info = self.rendering().color_attachments(&colors);
        if let Some(depth) = &depth {
            info = info.depth_attachment(depth);
        }
        // SAFETY: recording outside a pass; the images are in these layouts and live until the frame is complete.
        unsafe {
            engine.device.cmd_begin_rendering(cmd, &info);
            if kind.geometry {
                let z = [NEAR_Z, FAR_Z];
                for ((rect, color), z) in kind.rectangles().into_iter().zip([NEAR_COLOR, FAR_COLOR]).zip(z) {
                    let mut clears = vec![
                        vk::ClearAttachment::default()
                            .aspect_mask(vk::ImageAspectFlags::COLOR)
                            .clear_value(vk::ClearValue { color: vk::ClearColorValue { float32: color } }),
                    ];
                    if self.depth.is_some() {
                        let depth = depth_of(view, z) as f32;
                        let depth_stencil = vk::ClearDepthStencilValue { depth, stencil: 0 };
                        clears.push(
                            vk::ClearAttachment::default()
                                .aspect_mask(vk::ImageAspectFlags::DEPTH)
                                .clear_value(vk::ClearValue { depth_stencil }),
                        );
                    }
                    let rects = [vk::ClearRect { rect, base_array_layer: 0, layer_count: 1 }];
                    engine.device.cmd_clear_attachments(cmd, &clears, &rects);
                }
            }
            engine.device.cmd_end_rendering(cmd);
        }
        let sampled = (S::FRAGMENT_SHADER, A::SHADER_SAMPLED_READ);
        let barriers: Vec<_> = self
            .single_depth
            .iter()
            .chain(&self.depth)
            .take((kind.depth == Depth::Lent) as usize)
            .map(|d| barrier(d, L::DEPTH_ATTACHMENT_OPTIMAL, L::DEPTH_READ_ONLY_OPTIMAL, tests, sampled))
            .collect();
        pipeline_barrier(engine, cmd, &barriers);
    }

    pub fn begin_composite(&self, engine: &Engine, cmd: vk::CommandBuffer) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        let attach = (S::COLOR_ATTACHMENT_OUTPUT, A::COLOR_ATTACHMENT_WRITE | A::COLOR_ATTACHMENT_READ);
        let tests = (
            S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS,
            A::DEPTH_STENCIL_ATTACHMENT_WRITE | A::DEPTH_STENCIL_ATTACHMENT_READ,
        );
        let depth_layout = match self.kind.render_pass {
            true => L::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
            false => L::DEPTH_ATTACHMENT_OPTIMAL,
        };
        let both = L::COLOR_ATTACHMENT_OPTIMAL;
        let mut barriers = vec![barrier(&self.color, both, both, attach, attach)];
        if let Some(depth) = &self.depth {
            let lent = self.kind.depth == Depth::Lent && self.single_depth.is_none();
            let from = if lent { L::DEPTH_READ_ONLY_OPTIMAL } else { L::DEPTH_ATTACHMENT_OPTIMAL };
            let read = (S::FRAGMENT_SHADER | tests.0, tests.1);
            barriers.push(barrier(depth, from, depth_layout, read, tests));
        }
        pipeline_barrier(engine, cmd, &barriers);
        let [width, height] = self.kind.size;
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width, height } };
        if self.kind.render_pass {
            let info = vk::RenderPassBeginInfo::default()
                .render_pass(self.pass)
                .framebuffer(self.framebuffer)
                .render_area(area);
            // SAFETY: recording outside a pass; the attachments are in the pass's layouts.
            unsafe { engine.device.cmd_begin_render_pass(cmd, &info, vk::SubpassContents::INLINE) };
            return;
        }
        let colors = [self.attachment(&self.color, vk::AttachmentLoadOp::LOAD, true)];
        let depth = self.depth.as_ref().map(|depth| {
            vk::RenderingAttachmentInfo::default()
                .image_view(depth.view)
                .image_layout(L::DEPTH_ATTACHMENT_OPTIMAL)
                .load_op(vk::AttachmentLoadOp::LOAD)
                .store_op(vk::AttachmentStoreOp::STORE)
        });
        let mut info = self.rendering().color_attachments(&colors);
        if let Some(depth) = &depth {
            info = info.depth_attachment(depth);
        }
        // SAFETY: as above.
        unsafe { engine.device.cmd_begin_rendering(cmd, &info) };
    }

    pub fn end_composite(&self, engine: &Engine, cmd: vk::CommandBuffer) {
        // SAFETY: the pass was begun by `begin_composite`.
        unsafe {
            match self.kind.render_pass {
                true => engine.device.cmd_end_render_pass(cmd),
                false => engine.device.cmd_end_rendering(cmd),
            }
        }
    }

    /// Copies colour, and depth where it is single-sampled, to where the engine can read it.
    fn copy(&self, engine: &Engine, cmd: vk::CommandBuffer) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        let to = (S::COPY, A::TRANSFER_READ);
        let color = self.resolved.as_ref().unwrap_or(&self.color);
        let from = (S::COLOR_ATTACHMENT_OUTPUT, A::COLOR_ATTACHMENT_WRITE);
        let mut copies = vec![(color, 0)];
        let mut barriers = vec![barrier(color, L::COLOR_ATTACHMENT_OPTIMAL, L::TRANSFER_SRC_OPTIMAL, from, to)];
        if let Some(depth) = self.depth.as_ref().filter(|_| !self.kind.multisampled()) {
            let layout = match self.kind.render_pass {
                true => L::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
                false => L::DEPTH_ATTACHMENT_OPTIMAL,
            };
            let from = (S::LATE_FRAGMENT_TESTS | S::EARLY_FRAGMENT_TESTS, A::DEPTH_STENCIL_ATTACHMENT_WRITE);
            barriers.push(barrier(depth, layout, L::TRANSFER_SRC_OPTIMAL, from, to));
            copies.push((depth, self.depth_at));
        }
        pipeline_barrier(engine, cmd, &barriers);
        let [width, height] = self.kind.size;
        for (texture, buffer_offset) in copies {
            let region = vk::BufferImageCopy::default()
                .buffer_offset(buffer_offset)
                .image_subresource(
                    vk::ImageSubresourceLayers::default().aspect_mask(texture.aspect).layer_count(self.kind.views),
                )
                .image_extent(vk::Extent3D { width, height, depth: 1 });
            // SAFETY: recording outside a pass; the image is in that layout and the buffer holds all layers.
            unsafe {
                engine.device.cmd_copy_image_to_buffer(
                    cmd,
                    texture.image,
                    L::TRANSFER_SRC_OPTIMAL,
                    self.buffer,
                    &[region],
                );
            }
        }
        let host = [vk::MemoryBarrier2::default()
            .src_stage_mask(S::COPY)
            .src_access_mask(A::TRANSFER_WRITE)
            .dst_stage_mask(S::HOST)
            .dst_access_mask(A::HOST_READ)];
        let info = vk::DependencyInfo::default().memory_barriers(&host);
        // SAFETY: recording outside a pass.
        unsafe { engine.device.cmd_pipeline_barrier2(cmd, &info) };
    }

    fn attachment<'a>(
        &'a self,
        color: &Texture,
        load: vk::AttachmentLoadOp,
        resolve: bool,
    ) -> vk::RenderingAttachmentInfo<'a> {
        let layout = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
        let info = vk::RenderingAttachmentInfo::default()
            .image_view(color.view)
            .image_layout(layout)
            .load_op(load)
            .store_op(vk::AttachmentStoreOp::STORE);
        match &self.resolved {
            Some(resolved) if resolve => info
                .resolve_mode(vk::ResolveModeFlags::AVERAGE)
                .resolve_image_view(resolved.view)
                .resolve_image_layout(layout),
            _ => info,
        }
    }

    fn rendering(&self) -> vk::RenderingInfo<'static> {
        let [width, height] = self.kind.size;
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width, height } };
        vk::RenderingInfo::default().render_area(area).layer_count(1).view_mask(self.kind.mask())
    }

    fn bytes(&self) -> &[u8] {
        let pixels = self.kind.size[0] as u64 * self.kind.size[1] as u64 * self.kind.views as u64;
        // SAFETY: the mapping holds that many bytes, and its frame is complete: callers waited.
        unsafe {
            std::slice::from_raw_parts(self.mapped.as_ptr().cast_const().cast(), (self.depth_at + 4 * pixels) as usize)
        }
    }

    /// The colour of a view's pixel as the format stores it: 0 to 1 for bytes, floats as they are. The frame is complete.
    pub fn pixel(&self, view: u32, x: u32, y: u32) -> [f32; 4] {
        let [w, h] = self.kind.size;
        let index = ((view * h + y) * w + x) as usize;
        let size = bytes_per_pixel(self.kind.color) as usize;
        let bytes = &self.bytes()[index * size..(index + 1) * size];
        std::array::from_fn(|c| match size {
            16 => f32::from_le_bytes(bytes[4 * c..4 * c + 4].try_into().unwrap()),
            8 => half(u16::from_le_bytes(bytes[2 * c..2 * c + 2].try_into().unwrap())),
            _ => bytes[c] as f32 / 255.0,
        })
    }

    /// A view's depth, of single-sampled targets. The frame is complete.
    pub fn depth(&self, view: u32, x: u32, y: u32) -> f32 {
        assert!(self.depth.is_some() && !self.kind.multisampled(), "depth was not copied");
        let [w, h] = self.kind.size;
        let at = self.depth_at as usize + ((view * h + y) * w + x) as usize * 4;
        f32::from_le_bytes(self.bytes()[at..at + 4].try_into().unwrap())
    }

    /// All colours of a view.
    pub fn picture(&self, view: u32) -> Vec<[f32; 4]> {
        let [w, h] = self.kind.size;
        (0..w * h).map(|i| self.pixel(view, i % w, i / w)).collect()
    }

    /// Frees everything; the device no longer uses it.
    pub fn destroy(mut self, engine: &Engine) {
        // SAFETY: no longer in use (the caller waited), destroyed once; null handles are allowed.
        unsafe {
            engine.device.destroy_framebuffer(self.framebuffer, None);
            engine.device.destroy_render_pass(self.pass, None);
            engine.device.destroy_buffer(self.buffer, None);
        }
        self.memory.free(self.buffer_memory.take().expect("freed once"));
        let all = [Some(self.color), self.resolved, self.depth, self.single_depth];
        for texture in all.into_iter().flatten() {
            // SAFETY: as above.
            unsafe {
                engine.device.destroy_image_view(texture.view, None);
                engine.device.destroy_image(texture.image, None);
            }
            self.memory.free(texture.memory.expect("freed once"));
        }
    }
}

/// What a frame shows.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    pub id: u64,
    pub views: &'a [View],
    pub instances: &'a [Instance],
    pub technique: Technique,
    pub style: &'a Style,
}

/// The depth-buffer value of a linear depth, from the projection's rows.
pub fn depth_of(view: &View, z: f64) -> f64 {
    let (r2, r3) = (view.projection.row(2), view.projection.row(3));
    (-r2.z * z + r2.w) / (-r3.z * z + r3.w)
}

/// IEEE 754 binary16.
fn half(bits: u16) -> f32 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = ((bits >> 10 & 31) as i32, (bits & 1023) as f32 / 1024.0);
    sign * match exponent {
        0 => fraction * 2f32.powi(-14),
        31 => f32::INFINITY,
        e => (1.0 + fraction) * 2f32.powi(e - 15),
    }
}

fn texture(
    engine: &Engine,
    memory: &mut OwnMemory,
    kind: &Kind,
    format: vk::Format,
    samples: vk::SampleCountFlags,
    usage: vk::ImageUsageFlags,
) -> Texture {
    let depth = format == DEPTH_FORMAT;
    let aspect = if depth { vk::ImageAspectFlags::DEPTH } else { vk::ImageAspectFlags::COLOR };
    let info = vk::ImageCreateInfo::default()
        .image_type(vk::ImageType::TYPE_2D)
        .format(format)
        .extent(vk::Extent3D { width: kind.size[0], height: kind.size[1], depth: 1 })
        .mip_levels(1)
        .array_layers(kind.views)
        .samples(samples)
        .usage(usage);
    // SAFETY: the device lives; the memory fits the image and is bound once.
    unsafe {
        let image = engine.device.create_image(&info, None).expect("an image");
        let requirements = engine.device.get_image_memory_requirements(image);
        let request = MemoryRequest { name: "target", requirements, location: Location::Device, linear: false };
        let piece = memory.allocate(&request).expect("memory");
        engine.device.bind_image_memory(image, piece.memory, piece.offset).expect("bind");
        let view = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D_ARRAY)
            .format(format)
            .subresource_range(range(aspect));
        let view = engine.device.create_image_view(&view, None).expect("a view");
        Texture { image, view, memory: Some(piece), aspect }
    }
}

fn range(aspect: vk::ImageAspectFlags) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default().aspect_mask(aspect).level_count(1).layer_count(vk::REMAINING_ARRAY_LAYERS)
}

type Scope = (vk::PipelineStageFlags2, vk::AccessFlags2);

fn barrier(
    texture: &Texture,
    old: vk::ImageLayout,
    new: vk::ImageLayout,
    from: Scope,
    to: Scope,
) -> vk::ImageMemoryBarrier2<'static> {
    vk::ImageMemoryBarrier2::default()
        .image(texture.image)
        .subresource_range(range(texture.aspect))
        .old_layout(old)
        .new_layout(new)
        .src_stage_mask(from.0)
        .src_access_mask(from.1)
        .dst_stage_mask(to.0)
        .dst_access_mask(to.1)
}

fn pipeline_barrier(engine: &Engine, cmd: vk::CommandBuffer, barriers: &[vk::ImageMemoryBarrier2]) {
    let info = vk::DependencyInfo::default().image_memory_barriers(barriers);
    // SAFETY: recording outside a pass; the images live until the frame is complete.
    unsafe { engine.device.cmd_pipeline_barrier2(cmd, &info) };
}
