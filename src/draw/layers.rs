//! The layers of `groups`: one a group, shared by all views, which are drawn and folded one after the other.

use ash::vk;

use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::pass::{Attachment, DepthAttachment};
use crate::gpu::program::Program;
use crate::gpu::resource::Image;
use crate::gpu::retire::{RetireQueue, Retired};
use crate::style::SumPrecision;

use super::targets::{FRONT, NOTHING, SURFACE, sums_format};

/// Depth that decides within a layer.
pub const LAYER_DEPTH: vk::Format = vk::Format::D32_SFLOAT;

/// Size and content of the layers, a pure function of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LayerPlan {
    /// \[px\]
    pub extent: vk::Extent2D,
    /// K.
    pub count: u32,
    /// Normals are kept, for light.
    pub normals: bool,
    /// Precision of colours and weights.
    pub sums: SumPrecision,
}

impl LayerPlan {
    /// Bytes a pixel of all layers: 28 B a layer, 16 B more with normals, 8 B less in half precision.
    pub fn bytes_per_pixel(&self) -> u64 {
        self.count as u64 * (self.color_bytes() + 8 + 4 + if self.normals { 16 } else { 0 })
    }
}

impl LayerPlan {
    fn color_bytes(&self) -> u64 {
        match self.sums {
            SumPrecision::Single => 16,
            SumPrecision::Half => 8,
        }
    }
}

/// The layers.
#[derive(Debug)]
pub struct Layers {
    /// What they were made for.
    pub plan: LayerPlan,
    /// w c, w.
    pub color: Image,
    /// z + ε, z.
    pub front: Image,
    /// w n.
    pub normals: Option<Image>,
    /// What decides.
    pub depth: Image,
    /// Set 1 of the full-screen passes.
    pub set: vk::DescriptorSet,
    pool: vk::DescriptorPool,
}

impl Layers {
    /// Makes them. `composite` is what folds them.
    pub fn new(context: &mut Context, plan: LayerPlan, composite: &Program, sampler: vk::Sampler) -> Result<Layers> {
        let limit = context.limits.max_framebuffer_layers.min(context.limits.max_image_array_layers);
        if plan.count > limit {
            return Err(Error::Unsupported(format!(
                "{} groups: this device draws to {limit} layers at most; fewer come of a smaller factor or limit",
                plan.count
            )));
        }
        let sampled = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::SAMPLED;
        let mut pool = vk::DescriptorPool::null();
        let mut made: Vec<Image> = Vec::new();
        let all = (|| -> Result<vk::DescriptorSet> {
            let pixels = plan.extent.width as u64 * plan.extent.height as u64 * plan.count as u64;
            let mut make = |name: &str, format, texel: u64, usage| {
                let requested = pixels * texel;
                if requested > context.max_image_bytes(format, usage) {
                    let what = format!("{name} of {} groups", plan.count);
                    return Err(Error::OutOfDeviceMemory { what, requested });
                }
                made.push(Image::new(context, name, format, plan.extent, plan.count, usage)?);
                Ok(())
            };
            make("layers.depth", LAYER_DEPTH, 4, vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT)?;
            make("layers.color", sums_format(plan.sums), plan.color_bytes(), sampled)?;
            make("layers.front", FRONT, 8, sampled)?;
            if plan.normals {
                make("layers.normals", SURFACE, 16, sampled)?;
            }
            let ty = vk::DescriptorType::COMBINED_IMAGE_SAMPLER;
            pool = context.descriptor_pool("layers.set", 1, &[vk::DescriptorPoolSize { ty, descriptor_count: 3 }])?;
            let set = context.descriptor_sets(pool, &[composite.sets[1]])?[0];
            // Without light nothing reads the normals: the colours stand in.
            let infos = [1, 2, if plan.normals { 3 } else { 1 }].map(|i: usize| {
                let image_layout = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;
                [vk::DescriptorImageInfo { sampler, image_view: made[i].array, image_layout }]
            });
            let writes = [0, 1, 2].map(|binding| {
                vk::WriteDescriptorSet::default()
                    .dst_set(set)
                    .dst_binding(binding)
                    .descriptor_type(ty)
                    .image_info(&infos[binding as usize])
            });
            context.write_sets(&writes);
            Ok(set)
        })();
        let mut images = made.into_iter();
        match (all, images.next(), images.next(), images.next()) {
            (Ok(set), Some(depth), Some(color), Some(front)) => {
                Ok(Layers { plan, color, front, normals: images.next(), depth, set, pool })
            }
            (Err(e), a, b, c) => {
                [a, b, c].into_iter().flatten().chain(images).for_each(|image| image.destroy(context));
                context.destroy_pool(pool);
                Err(e)
            }
            _ => unreachable!("all three were made"),
        }
    }

    /// All layers at once by location; cleared: no colour, nothing in front.
    pub fn attachments(&self, cleared: bool) -> (Vec<Attachment>, DepthAttachment) {
        let attachment = |image: &Image, clear| Attachment { view: image.array, clear: cleared.then_some(clear) };
        let mut colors = vec![attachment(&self.color, [0.0; 4]), attachment(&self.front, [NOTHING, NOTHING, 0.0, 0.0])];
        colors.extend(self.normals.as_ref().map(|image| attachment(image, [0.0; 4])));
        (colors, DepthAttachment { view: self.depth.array, format: LAYER_DEPTH, clear: cleared.then_some(0.0) })
    }

    /// What is drawn into and then folded, and the depth.
    pub fn split(&mut self) -> (impl Iterator<Item = &mut Image>, &mut Image) {
        ([&mut self.color, &mut self.front].into_iter().chain(self.normals.as_mut()), &mut self.depth)
    }

    /// Gives the images up after `frame`.
    pub fn retire(self, queue: &mut RetireQueue, frame: u64) {
        queue.push(frame, Retired::DescriptorPool(self.pool));
        for image in [self.depth, self.color, self.front].into_iter().chain(self.normals) {
            queue.push(frame, Retired::Image(image));
        }
    }

    /// Destroys them at once; the device no longer uses them.
    pub fn destroy(self, context: &mut Context) {
        context.destroy_pool(self.pool);
        for image in [self.depth, self.color, self.front].into_iter().chain(self.normals) {
            image.destroy(context);
        }
    }
}
