//! Passes whose fragments read what earlier fragments of the same pixel wrote, in the order of submission
//! (`VK_EXT_rasterization_order_attachment_access`). Dynamic rendering has no input attachments before Vulkan 1.4, hence a
//! render pass.

use ash::vk;

use super::barrier::Access;
use super::context::Context;
use crate::error::{Named, Result};

/// Two compatible passes of one subpass, whose attachments are all read as input attachments by the same index.
#[derive(Debug, Clone, Copy)]
pub struct OrderedPass {
    /// Clears them first. Pipelines are made for this one.
    pub clear: vk::RenderPass,
    /// Keeps what is in them.
    keep: vk::RenderPass,
}

/// Where such a pass draws: one layer of every attachment.
#[derive(Debug)]
pub struct OrderedTarget {
    pass: OrderedPass,
    framebuffer: vk::Framebuffer,
    extent: vk::Extent2D,
}

impl OrderedTarget {
    /// All of it.
    pub fn area(&self) -> vk::Rect2D {
        vk::Rect2D { offset: vk::Offset2D::default(), extent: self.extent }
    }
}

impl Context {
    /// Passes for attachments of these formats.
    pub fn ordered_pass(&self, formats: &[vk::Format]) -> Result<OrderedPass> {
        let clear = self.one_ordered_pass(formats, vk::AttachmentLoadOp::CLEAR)?;
        match self.one_ordered_pass(formats, vk::AttachmentLoadOp::LOAD) {
            Ok(keep) => Ok(OrderedPass { clear, keep }),
            Err(e) => {
                // SAFETY: just made, and used by nothing.
                unsafe { self.device.destroy_render_pass(clear, None) };
                Err(e)
            }
        }
    }

    fn one_ordered_pass(&self, formats: &[vk::Format], load: vk::AttachmentLoadOp) -> Result<vk::RenderPass> {
        let layout = Access::ColorOrdered.layout();
        let attachments: Vec<_> = formats
            .iter()
            .map(|&format| {
                vk::AttachmentDescription::default()
                    .format(format)
                    .samples(vk::SampleCountFlags::TYPE_1)
                    .load_op(load)
                    .store_op(vk::AttachmentStoreOp::STORE)
                    .initial_layout(layout)
                    .final_layout(layout)
            })
            .collect();
        let references: Vec<_> =
            (0..formats.len() as u32).map(|attachment| vk::AttachmentReference { attachment, layout }).collect();
        let subpasses = [vk::SubpassDescription::default()
            .flags(vk::SubpassDescriptionFlags::RASTERIZATION_ORDER_ATTACHMENT_COLOR_ACCESS_EXT)
            .pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)
            .color_attachments(&references)
            .input_attachments(&references)];
        // The subpass depends on itself, pixel by pixel. What comes before and after is ordered by barriers outside.
        let itself = [vk::SubpassDependency::default()
            .src_subpass(0)
            .dst_subpass(0)
            .src_stage_mask(vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT)
            .src_access_mask(vk::AccessFlags::COLOR_ATTACHMENT_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags::FRAGMENT_SHADER)
            .dst_access_mask(vk::AccessFlags::INPUT_ATTACHMENT_READ)
            .dependency_flags(vk::DependencyFlags::BY_REGION)];
        let info =
            vk::RenderPassCreateInfo::default().attachments(&attachments).subpasses(&subpasses).dependencies(&itself);
        // SAFETY: the device lives and has the feature (callers ask `Enabled`); all that the description points to lives.
        let pass = unsafe { self.device.create_render_pass(&info, None) }.named("vkCreateRenderPass")?;
        self.name(pass, "ordered");
        Ok(pass)
    }

    /// Destroys passes that are not in use.
    pub fn destroy_ordered_pass(&self, pass: OrderedPass) {
        // SAFETY: as said, and once: callers give the handles up.
        unsafe {
            self.device.destroy_render_pass(pass.clear, None);
            self.device.destroy_render_pass(pass.keep, None);
        }
    }

    /// Views of single layers, by attachment, made for a pass's formats.
    pub fn ordered_target(
        &self,
        pass: OrderedPass,
        views: &[vk::ImageView],
        extent: vk::Extent2D,
    ) -> Result<OrderedTarget> {
        let info = vk::FramebufferCreateInfo::default()
            .render_pass(pass.clear)
            .attachments(views)
            .width(extent.width)
            .height(extent.height)
            .layers(1);
        // SAFETY: pass and views live; the extent is that of the images.
        let framebuffer = unsafe { self.device.create_framebuffer(&info, None) }.named("vkCreateFramebuffer")?;
        self.name(framebuffer, "ordered.framebuffer");
        Ok(OrderedTarget { pass, framebuffer, extent })
    }

    /// Destroys a target that is not in use.
    pub fn destroy_ordered_target(&self, target: OrderedTarget) {
        // SAFETY: as said, and once since it is consumed.
        unsafe { self.device.destroy_framebuffer(target.framebuffer, None) };
    }

    pub(super) fn begin_ordered(&self, cmd: vk::CommandBuffer, target: &OrderedTarget, clears: Option<&[[f32; 4]]>) {
        let pass = if clears.is_some() { target.pass.clear } else { target.pass.keep };
        let values: Vec<_> = clears
            .unwrap_or_default()
            .iter()
            .map(|&float32| vk::ClearValue { color: vk::ClearColorValue { float32 } })
            .collect();
        let info = vk::RenderPassBeginInfo::default()
            .render_pass(pass)
            .framebuffer(target.framebuffer)
            .render_area(target.area())
            .clear_values(&values);
        // SAFETY: recording outside a pass; everything lives until the frame is complete, and the caller's barrier moved
        // the images into the pass's layout.
        unsafe { self.device.cmd_begin_render_pass(cmd, &info, vk::SubpassContents::INLINE) };
    }

    pub(super) fn end_ordered(&self, cmd: vk::CommandBuffer) {
        // SAFETY: the pass was begun by `begin_ordered`.
        unsafe { self.device.cmd_end_render_pass(cmd) };
    }
}
