//! A pass opens with everything it owes the reader: label, barrier, timestamp, in one place.

use ash::vk;

use super::barrier::{self, Access};
use super::context::Context;
use super::ordered::OrderedTarget;
use super::query::Timestamps;
use super::resource::{Image, aspect};

/// Records passes into the host's command buffer, outside its own passes.
pub struct Recorder<'a> {
    /// Device.
    pub context: &'a Context,
    /// The host's command buffer, recording.
    pub cmd: vk::CommandBuffer,
    timestamps: Option<&'a mut Timestamps>,
}

/// What a pass does with a resource.
pub enum Use<'a> {
    /// An image, whose last use is known; the content is kept.
    Image(&'a mut Image, Access),
    /// An image whose content is given up.
    Discard(&'a mut Image, Access),
    /// Any memory, from one use to another.
    Memory(Access, Access),
}

impl<'a> Use<'a> {
    /// A layer of an image that is drawn layer by layer: only the first may give the whole image's content up.
    pub fn layer(image: &'a mut Image, access: Access, first: bool) -> Use<'a> {
        if first { Use::Discard(image, access) } else { Use::Image(image, access) }
    }
}

/// One colour attachment of a pass: its view, and what happens to its content first.
pub struct Attachment {
    /// View of one layer.
    pub view: vk::ImageView,
    /// Cleared to this, or kept.
    pub clear: Option<[f32; 4]>,
}

/// The depth attachment of a pass.
pub struct DepthAttachment {
    /// View of one layer.
    pub view: vk::ImageView,
    /// Its format.
    pub format: vk::Format,
    /// Cleared to this, and the stencil to 0, or both kept.
    pub clear: Option<f32>,
}

/// Where a pass draws.
pub struct Targets<'a> {
    /// By location.
    pub colors: &'a [Attachment],
    /// Depth, and stencil if the format has it.
    pub depth: Option<DepthAttachment>,
    /// Layers of every attachment, 1 unless the vertex stage chooses among several.
    pub layers: u32,
    /// \[px\]
    pub extent: vk::Extent2D,
}

impl<'a> Recorder<'a> {
    /// Records into `cmd`, timing passes where `timestamps` are given.
    pub fn new(context: &'a Context, cmd: vk::CommandBuffer, timestamps: Option<&'a mut Timestamps>) -> Self {
        Recorder { context, cmd, timestamps }
    }

    /// A pass without attachments: copies, compute.
    pub fn pass(&mut self, name: &'static str, uses: Vec<Use>, body: impl FnOnce(&Context, vk::CommandBuffer)) {
        self.open(name, uses);
        body(self.context, self.cmd);
        self.close();
    }

    /// A pass that draws, with viewport and scissor set to the whole target.
    pub fn draw(
        &mut self,
        name: &'static str,
        uses: Vec<Use>,
        targets: &Targets,
        body: impl FnOnce(&Context, vk::CommandBuffer),
    ) {
        self.open(name, uses);
        let colors: Vec<_> = targets
            .colors
            .iter()
            .map(|a| {
                let info = vk::RenderingAttachmentInfo::default().image_view(a.view);
                match a.clear {
                    Some(float32) => attachment(info, Access::ColorWrite, vk::AttachmentLoadOp::CLEAR)
                        .clear_value(vk::ClearValue { color: vk::ClearColorValue { float32 } }),
                    None => attachment(info, Access::ColorWrite, vk::AttachmentLoadOp::LOAD),
                }
            })
            .collect();
        let depth = targets.depth.as_ref().map(|d| {
            let info = vk::RenderingAttachmentInfo::default().image_view(d.view);
            match d.clear {
                Some(depth) => attachment(info, Access::DepthWrite, vk::AttachmentLoadOp::CLEAR)
                    .clear_value(vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth, stencil: 0 } }),
                None => attachment(info, Access::DepthWrite, vk::AttachmentLoadOp::LOAD),
            }
        });
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: targets.extent };
        let mut info =
            vk::RenderingInfo::default().render_area(area).layer_count(targets.layers).color_attachments(&colors);
        if let (Some(depth), Some(target)) = (&depth, &targets.depth) {
            info = info.depth_attachment(depth);
            if aspect(target.format).contains(vk::ImageAspectFlags::STENCIL) {
                info = info.stencil_attachment(depth);
            }
        }
        // SAFETY: recording outside a pass; the views live until the frame is complete, and `open` moved the images
        // into the layouts that `attachment` names.
        unsafe {
            self.context.device.cmd_begin_rendering(self.cmd, &info);
        }
        self.context.set_area(self.cmd, area);
        body(self.context, self.cmd);
        // SAFETY: the pass was begun above.
        unsafe { self.context.device.cmd_end_rendering(self.cmd) };
        self.close();
    }

    /// A pass whose fragments read what those before them wrote, in order, with viewport and scissor set to the whole
    /// target. The images are in the layout of [`Access::ColorOrdered`]; `clears` by attachment, or what is there is kept.
    pub fn draw_ordered(
        &mut self,
        name: &'static str,
        uses: Vec<Use>,
        target: &OrderedTarget,
        clears: Option<&[[f32; 4]]>,
        body: impl FnOnce(&Context, vk::CommandBuffer),
    ) {
        self.open(name, uses);
        self.context.begin_ordered(self.cmd, target, clears);
        self.context.set_area(self.cmd, target.area());
        body(self.context, self.cmd);
        self.context.end_ordered(self.cmd);
        self.close();
    }

    /// Barriers alone, for images that leave to be used by others.
    pub fn barrier(&mut self, uses: Vec<Use>) {
        let mut images = Vec::new();
        let mut memory = Vec::new();
        for item in uses {
            match item {
                Use::Image(image, to) => images.extend(barrier::image(image, to, false)),
                Use::Discard(image, to) => images.extend(barrier::image(image, to, true)),
                Use::Memory(from, to) => memory.push(barrier::memory(from, to)),
            }
        }
        if images.is_empty() && memory.is_empty() {
            return;
        }
        let info = vk::DependencyInfo::default().image_memory_barriers(&images).memory_barriers(&memory);
        // SAFETY: recording outside a pass; the images live until the frame is complete.
        unsafe { self.context.device.cmd_pipeline_barrier2(self.cmd, &info) };
    }

    fn open(&mut self, name: &'static str, uses: Vec<Use>) {
        self.context.begin_label(self.cmd, name);
        self.barrier(uses);
        if let Some(timestamps) = &mut self.timestamps {
            timestamps.begin(self.context, self.cmd, name, 1);
        }
    }

    fn close(&mut self) {
        if let Some(timestamps) = &mut self.timestamps {
            timestamps.end(self.context, self.cmd, 1);
        }
        self.context.end_label(self.cmd);
    }
}

fn attachment(
    info: vk::RenderingAttachmentInfo<'_>,
    access: Access,
    load: vk::AttachmentLoadOp,
) -> vk::RenderingAttachmentInfo<'_> {
    info.image_layout(access.layout()).load_op(load).store_op(vk::AttachmentStoreOp::STORE)
}
