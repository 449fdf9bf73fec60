//! The library's own attachments: one pool, shared by all blends, remade when the picture's size changes.

use ash::vk;

use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::pass::Attachment;
use crate::gpu::resource::Image;
use crate::gpu::retire::{RetireQueue, Retired};

/// Depth of the splat passes: reversed, so floats are dense where the far things are.
pub const DEPTH: vk::Format = vk::Format::D32_SFLOAT;
/// Nothing is farther away: the front's −z starts below every real one.
const FAR_AWAY: f32 = f32::MIN;
/// −z of the front.
pub const FRONT: vk::Format = vk::Format::R32_SFLOAT;

/// Size and content of the attachments, a pure function of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TargetPlan {
    /// [px]
    pub extent: vk::Extent2D,
    /// One layer a view.
    pub layers: u32,
    /// Format of the sums.
    pub sums: vk::Format,
    /// Sums of normals are kept.
    pub lit: bool,
    /// The front's depth is kept.
    pub front: bool,
}

impl TargetPlan {
    /// Bytes a pixel and view.
    pub fn bytes_per_pixel(&self) -> u64 {
        let sum = if self.sums == vk::Format::R32G32B32A32_SFLOAT { 16 } else { 8 };
        sum + 4 + if self.lit { sum } else { 0 } + if self.front { 4 } else { 0 }
    }
}

/// The attachments.
#[derive(Debug)]
pub struct Targets {
    /// What they were made for.
    pub plan: TargetPlan,
    /// Σ w c, Σ w.
    pub color: Image,
    /// Σ w n.
    pub normal: Option<Image>,
    /// −z of the front.
    pub front: Option<Image>,
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
            make(context, "depth", DEPTH, vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT)?;
            make(context, "color_sum", plan.sums, usage)?;
            if plan.lit {
                make(context, "normal_sum", plan.sums, usage)?;
            }
            if plan.front {
                make(context, "front", FRONT, usage)?;
            }
            Ok(())
        })();
        if let Err(e) = all {
            made.into_iter().for_each(|image| image.destroy(context));
            return Err(e);
        }
        let mut made = made.into_iter();
        let (Some(depth), Some(color)) = (made.next(), made.next()) else { unreachable!("both were made") };
        let normal = if plan.lit { made.next() } else { None };
        Ok(Targets { plan, color, normal, front: made.next(), depth })
    }

    /// Depth, and the images that splats are summed into.
    pub fn split(&mut self) -> (&mut Image, impl Iterator<Item = &mut Image>) {
        (&mut self.depth, [Some(&mut self.color), self.normal.as_mut(), self.front.as_mut()].into_iter().flatten())
    }

    /// The attachments of a layer of the sums by location, cleared.
    pub fn sum_attachments(&self, layer: usize) -> [Attachment; 3] {
        let view = |image: Option<&Image>| image.map_or(vk::ImageView::null(), |i| i.layers[layer]);
        [
            Attachment { view: view(Some(&self.color)), clear: Some([0.0; 4]) },
            Attachment { view: view(self.normal.as_ref()), clear: Some([0.0; 4]) },
            Attachment { view: view(self.front.as_ref()), clear: Some([FAR_AWAY; 4]) },
        ]
    }

    /// Gives the images up after `frame`.
    pub fn retire(self, queue: &mut RetireQueue, frame: u64) {
        for image in [Some(self.depth), Some(self.color), self.normal, self.front].into_iter().flatten() {
            queue.push(frame, Retired::Image(image));
        }
    }

    /// Destroys them at once; the device no longer uses them.
    pub fn destroy(self, context: &mut Context) {
        for image in [Some(self.depth), Some(self.color), self.normal, self.front].into_iter().flatten() {
            image.destroy(context);
        }
    }
}
