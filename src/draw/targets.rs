//! The library's own attachments: one pool, shared by all blends, remade when the picture's size changes.

use std::iter;

use ash::vk;

use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::pass::{Attachment, DepthAttachment};
use crate::gpu::resource::Image;
use crate::gpu::retire::{RetireQueue, Retired};
use crate::style::SumPrecision;

/// Depth of the splat passes: reversed, so floats are dense where the far things are. The stencil marks pixels where the
/// front hides something.
pub const DEPTH: vk::Format = vk::Format::D32_SFLOAT_S8_UINT;
/// Format of the sums, unless the style asks for less. Thousands of splats may meet in a pixel, and half floats stop
/// counting at 2048.
pub const SUMS: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
/// What it asks for then: Vulkan demands that every device blends into it.
const HALF: vk::Format = vk::Format::R16G16B16A16_SFLOAT;
/// Nothing is farther away: the front's −z starts below every real one.
const FAR_AWAY: f32 = f32::MIN;

/// Size and content of the attachments, a pure function of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TargetPlan {
    /// \[px\]
    pub extent: vk::Extent2D,
    /// One layer a view.
    pub layers: u32,
    /// Sums of normals and the front's depth are kept.
    pub surface: bool,
    /// Precision of the sums of colours and weights.
    pub sums: SumPrecision,
}

impl TargetPlan {
    /// Bytes a pixel and view.
    pub fn bytes_per_pixel(&self) -> u64 {
        let sums = match self.sums {
            SumPrecision::Single => 16,
            SumPrecision::Half => 8,
        };
        8 + sums + if self.surface { 16 } else { 0 }
    }

    /// Formats of the sums by location. The second one's alpha is the front's depth, which 16 bits would ruin: it has 32
    /// whatever the first has.
    pub fn formats(&self) -> [vk::Format; 2] {
        match self.sums {
            SumPrecision::Single => [SUMS, SUMS],
            SumPrecision::Half => [HALF, SUMS],
        }
    }
}

/// The attachments.
#[derive(Debug)]
pub struct Targets {
    /// What they were made for.
    pub plan: TargetPlan,
    /// Σ w c, Σ w.
    pub color: Image,
    /// Σ w n, greatest −z.
    pub surface: Option<Image>,
    /// Internal depth.
    pub depth: Image,
}

impl Targets {
    /// Makes the attachments.
    pub fn new(context: &mut Context, plan: TargetPlan) -> Result<Targets> {
        let limit = context.limits.max_framebuffer_width.min(context.limits.max_framebuffer_height);
        let limit = limit.min(context.limits.max_image_dimension2_d);
        let vk::Extent2D { width, height } = plan.extent;
        if width == 0 || height == 0 || width > limit || height > limit {
            return Err(Error::Unsupported(format!("a picture of {width} × {height}: this device has 1 to {limit}")));
        }
        let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::SAMPLED;
        let mut made: Vec<Image> = Vec::new();
        let mut make = |context: &mut Context, name, format, usage| {
            let image = Image::new(context, name, format, plan.extent, plan.layers, usage)?;
            made.push(image);
            Ok(())
        };
        let all = (|| -> Result<()> {
            make(
                context,
                "depth",
                DEPTH,
                vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT | vk::ImageUsageFlags::SAMPLED,
            )?;
            make(context, "color_sum", plan.formats()[0], usage)?;
            if plan.surface {
                make(context, "surface_sum", plan.formats()[1], usage)?;
            }
            Ok(())
        })();
        if let Err(e) = all {
            made.into_iter().for_each(|image| image.destroy(context));
            return Err(e);
        }
        let mut made = made.into_iter();
        let (Some(depth), Some(color)) = (made.next(), made.next()) else { unreachable!("both were made") };
        Ok(Targets { plan, color, surface: made.next(), depth })
    }

    /// Depth, and the images that splats are summed into.
    pub fn split(&mut self) -> (&mut Image, impl Iterator<Item = &mut Image>) {
        (&mut self.depth, iter::once(&mut self.color).chain(self.surface.as_mut()))
    }

    /// The depth attachment of a layer, cleared to nothing or kept.
    pub fn depth_attachment(&self, layer: usize, clear: bool) -> DepthAttachment {
        DepthAttachment { view: self.depth.layers[layer], format: DEPTH, clear: clear.then_some(0.0) }
    }

    /// The attachments of a layer of the sums by location, cleared.
    pub fn sum_attachments(&self, layer: usize) -> Vec<Attachment> {
        let attachment =
            |image: &Image, alpha| Attachment { view: image.layers[layer], clear: Some([0.0, 0.0, 0.0, alpha]) };
        iter::once(attachment(&self.color, 0.0)).chain(self.surface.as_ref().map(|i| attachment(i, FAR_AWAY))).collect()
    }

    /// Gives the images up after `frame`.
    pub fn retire(self, queue: &mut RetireQueue, frame: u64) {
        for image in [self.depth, self.color].into_iter().chain(self.surface) {
            queue.push(frame, Retired::Image(image));
        }
    }

    /// Destroys them at once; the device no longer uses them.
    pub fn destroy(self, context: &mut Context) {
        for image in [self.depth, self.color].into_iter().chain(self.surface) {
            image.destroy(context);
        }
    }
}
