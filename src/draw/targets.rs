//! The library's own attachments: one pool, shared by all blends, remade when the picture's size changes.

use std::iter;

use ash::vk;

use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::barrier::Access;
use crate::gpu::ordered::OrderedTarget;
use crate::gpu::pass::{Attachment, DepthAttachment};
use crate::gpu::program::Program;
use crate::gpu::resource::Image;
use crate::gpu::retire::{RetireQueue, Retired};
use crate::stats::OrderedAccess;
use crate::style::SumPrecision;

use super::variant::OrderedPasses;

/// Depth of the splat passes: reversed, so floats are dense where the far things are. The stencil marks pixels where the
/// front hides something.
pub const DEPTH: vk::Format = vk::Format::D32_SFLOAT_S8_UINT;
/// Format of the sums, unless the style asks for less. Thousands of splats may meet in a pixel, and half floats stop
/// counting at 2048.
pub const SUMS: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
/// What it asks for then: Vulkan demands that every device blends into it.
const HALF: vk::Format = vk::Format::R16G16B16A16_SFLOAT;
/// Format of the sums of normals. The fourth component is the front's depth, which 16 bits would ruin: it has 32 whatever
/// the sums have.
pub const SURFACE: vk::Format = SUMS;
/// Format of limit and front \[world units\], where a blend keeps them itself.
pub const FRONT: vk::Format = vk::Format::R32G32_SFLOAT;
/// Farther than everything: how limit and front begin.
pub const NOTHING: f32 = f32::MAX;

/// Format of the sums of colours and weights.
pub fn sums_format(sums: SumPrecision) -> vk::Format {
    match sums {
        SumPrecision::Single => SUMS,
        SumPrecision::Half => HALF,
    }
}
/// Nothing is farther away: the front's −z starts below every real one.
const FAR_AWAY: f32 = f32::MIN;
/// What the attachments of `fuzzy` begin with: no sums; limit and front behind everything; no normals.
pub const ORDERED_CLEARS: [[f32; 4]; 3] = [[0.0; 4], [NOTHING, NOTHING, 0.0, 0.0], [0.0; 4]];

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
    /// Limit and front are kept, for `fuzzy`, and how its fragments reach them.
    pub ordered: Option<OrderedAccess>,
}

impl TargetPlan {
    /// Bytes a pixel and view.
    pub fn bytes_per_pixel(&self) -> u64 {
        let sums = match self.sums {
            SumPrecision::Single => 16,
            SumPrecision::Half => 8,
        };
        8 + sums + if self.surface { 16 } else { 0 } + if self.ordered.is_some() { 8 } else { 0 }
    }
}

/// The attachments.
#[derive(Debug)]
pub struct Targets {
    /// What they were made for.
    pub plan: TargetPlan,
    /// Σ w c, Σ w.
    pub color: Image,
    /// Σ w n, and for most blends the greatest −z.
    pub surface: Option<Image>,
    /// Limit and front of `fuzzy`.
    pub front: Option<Image>,
    /// How `fuzzy` reaches them: one a layer.
    pub ordered: Vec<Ordered>,
    /// Of the sets of `ordered`, or null.
    pool: vk::DescriptorPool,
    /// Internal depth.
    pub depth: Image,
}

/// One layer of the attachments as `fuzzy` reads and writes them.
#[derive(Debug)]
pub struct Ordered {
    /// The pass's target; none for the interlock, which has no attachments.
    pub target: Option<OrderedTarget>,
    /// Set 3 or 4 of the splats.
    pub set: vk::DescriptorSet,
}

impl Targets {
    /// Makes the attachments. `splats` and `passes` are what draws into them.
    pub fn new(
        context: &mut Context,
        plan: TargetPlan,
        splats: &Program,
        passes: &mut OrderedPasses,
    ) -> Result<Targets> {
        let limit = context.limits.max_framebuffer_width.min(context.limits.max_framebuffer_height);
        let limit = limit.min(context.limits.max_image_dimension2_d);
        let vk::Extent2D { width, height } = plan.extent;
        if width == 0 || height == 0 || width > limit || height > limit {
            return Err(Error::Unsupported(format!("a picture of {width} × {height}: this device has 1 to {limit}")));
        }
        let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT
            | vk::ImageUsageFlags::SAMPLED
            | match plan.ordered {
                None => vk::ImageUsageFlags::empty(),
                Some(OrderedAccess::RasterizationOrder) => vk::ImageUsageFlags::INPUT_ATTACHMENT,
                Some(OrderedAccess::Interlock) => vk::ImageUsageFlags::STORAGE,
            };
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
            make(context, "color_sum", sums_format(plan.sums), usage)?;
            if plan.surface {
                make(context, "surface_sum", SURFACE, usage)?;
            }
            if plan.ordered.is_some() {
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
        let surface = if plan.surface { made.next() } else { None };
        let front = made.next();
        let mut targets =
            Targets { plan, color, surface, depth, front, ordered: Vec::new(), pool: vk::DescriptorPool::null() };
        match targets.order(context, splats, passes) {
            Ok(()) => Ok(targets),
            Err(e) => {
                targets.destroy(context);
                Err(e)
            }
        }
    }

    /// Makes what `fuzzy` reaches the attachments by.
    fn order(&mut self, context: &Context, splats: &Program, passes: &mut OrderedPasses) -> Result<()> {
        let (Some(access), Some(front)) = (self.plan.ordered, &self.front) else { return Ok(()) };
        let (number, ty, layout) = match access {
            OrderedAccess::RasterizationOrder => {
                (3, vk::DescriptorType::INPUT_ATTACHMENT, Access::ColorOrdered.layout())
            }
            OrderedAccess::Interlock => (4, vk::DescriptorType::STORAGE_IMAGE, Access::FragmentStorage.layout()),
        };
        let layers = self.plan.layers;
        self.pool = context.descriptor_pool(
            "ordered.sets",
            layers,
            &[vk::DescriptorPoolSize { ty, descriptor_count: 3 * layers }],
        )?;
        for layer in 0..layers as usize {
            let set = context.descriptor_sets(self.pool, &[splats.sets[number]])?[0];
            // Without light nothing reads the normals: the colours, of a fitting format, stand in.
            let normals = self.surface.as_ref().unwrap_or(&self.color);
            let views = [&self.color, front, normals].map(|i| i.layers[layer]);
            let infos = views.map(|image_view| {
                [vk::DescriptorImageInfo { sampler: vk::Sampler::null(), image_view, image_layout: layout }]
            });
            let writes = [0, 1, 2].map(|binding| {
                vk::WriteDescriptorSet::default()
                    .dst_set(set)
                    .dst_binding(binding)
                    .descriptor_type(ty)
                    .image_info(&infos[binding as usize])
            });
            context.write_sets(&writes);
            let target = match access {
                OrderedAccess::Interlock => None,
                OrderedAccess::RasterizationOrder => {
                    let pass = passes.get(context, self.plan.sums, self.plan.surface)?;
                    let views = if self.plan.surface { &views[..] } else { &views[..2] };
                    Some(context.ordered_target(pass, views, self.plan.extent)?)
                }
            };
            self.ordered.push(Ordered { target, set });
        }
        Ok(())
    }

    /// Depth, and the images that splats are summed into.
    pub fn split(&mut self) -> (&mut Image, impl Iterator<Item = &mut Image>) {
        (&mut self.depth, iter::once(&mut self.color).chain(self.surface.as_mut()))
    }

    /// All of them.
    pub fn images(&mut self) -> impl Iterator<Item = &mut Image> {
        [&mut self.color, &mut self.depth].into_iter().chain(self.surface.as_mut()).chain(self.front.as_mut())
    }

    /// What `fuzzy` draws into, in the order of its attachments, and how it reaches a layer of them.
    pub fn split_ordered(&mut self, layer: usize) -> (Vec<&mut Image>, &Ordered) {
        let images = iter::once(&mut self.color).chain(self.front.as_mut()).chain(self.surface.as_mut());
        (images.collect(), &self.ordered[layer])
    }

    /// The same as attachments of another pass, cleared.
    pub fn ordered_attachments(&self, layer: usize) -> Vec<Attachment> {
        let images = iter::once(&self.color).chain(&self.front).chain(&self.surface);
        let attachment = |(image, clear): (&Image, _)| Attachment { view: image.layers[layer], clear: Some(clear) };
        images.zip(ORDERED_CLEARS).map(attachment).collect()
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
        for target in self.ordered.into_iter().filter_map(|o| o.target) {
            queue.push(frame, Retired::OrderedTarget(target));
        }
        if self.pool != vk::DescriptorPool::null() {
            queue.push(frame, Retired::DescriptorPool(self.pool));
        }
        for image in [self.depth, self.color].into_iter().chain(self.surface).chain(self.front) {
            queue.push(frame, Retired::Image(image));
        }
    }

    /// Destroys them at once; the device no longer uses them.
    pub fn destroy(self, context: &mut Context) {
        for target in self.ordered.into_iter().filter_map(|o| o.target) {
            context.destroy_ordered_target(target);
        }
        context.destroy_pool(self.pool);
        for image in [self.depth, self.color].into_iter().chain(self.surface).chain(self.front) {
            image.destroy(context);
        }
    }
}
