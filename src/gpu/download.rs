//! From device images to memory.

use ash::vk;

use super::context::Context;
use super::memory::Location;
use super::resource::{Buffer, aspect};
use crate::error::Result;

/// A host-visible buffer that one layer of an image is copied to, tightly packed.
#[derive(Debug)]
pub struct Download {
    buffer: Buffer,
}

impl Download {
    /// Room for `bytes` > 0.
    pub fn new(context: &mut Context, bytes: u64) -> Result<Download> {
        let usage = vk::BufferUsageFlags::TRANSFER_DST;
        Ok(Download { buffer: Buffer::new(context, "readback", bytes, usage, Location::Readback)? })
    }

    /// Records the copy of a layer of an image that is in `TRANSFER_SRC_OPTIMAL`, its writes visible to copies.
    pub fn record(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        image: vk::Image,
        format: vk::Format,
        extent: vk::Extent2D,
        layer: u32,
    ) {
        let region = vk::BufferImageCopy::default()
            .image_subresource(
                vk::ImageSubresourceLayers::default()
                    .aspect_mask(aspect(format))
                    .base_array_layer(layer)
                    .layer_count(1),
            )
            .image_extent(vk::Extent3D { width: extent.width, height: extent.height, depth: 1 });
        // SAFETY: recording outside a pass; the image is in that layout (a precondition) and the buffer holds the layer.
        unsafe {
            context.device.cmd_copy_image_to_buffer(
                cmd,
                image,
                vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
                self.buffer.handle,
                &[region],
            );
        }
    }

    /// What was copied; the frame is complete.
    pub fn bytes(&mut self) -> &[u8] {
        self.buffer.bytes()
    }

    /// Destroys the buffer; the device no longer uses it.
    pub fn destroy(self, context: &mut Context) {
        self.buffer.destroy(context);
    }
}
