//! What the library asks of the engine that it lives in, and what it is lent.

use std::fmt;

use ash::{ext, vk};
use glam::DMat4;

use crate::draw::targets;
use crate::error::{Error, Result};
use crate::gpu::GpuMemory;
use crate::gpu::layout::MAX_VIEWS;
pub use crate::gpu::{Enabled, Interlock};
use crate::select::View;
use crate::style::Style;
use crate::technique::Technique;

/// One thing that the library needs or would use, and what goes without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Requirement {
    /// As the specification names it.
    pub name: &'static str,
    /// What is not there without it: the renderer itself, or one path that has a fallback.
    pub disables: &'static str,
    /// Whether `Renderer::new` refuses without it.
    pub required: bool,
    /// Whether this physical device has it.
    pub present: bool,
}

/// What to enable on a device, before the host creates it. No extension is required: those named are optional, and there.
///
/// The feature structs hold what is required and what is optional and present; a host merges them into its own chain.
#[derive(Debug, Clone)]
pub struct Requirements {
    /// Every item, required ones first.
    pub items: Vec<Requirement>,
    /// Device extensions to enable.
    pub extensions: Vec<&'static std::ffi::CStr>,
    /// Core features.
    pub features: vk::PhysicalDeviceFeatures,
    /// Vulkan 1.1 features.
    pub vulkan11: vk::PhysicalDeviceVulkan11Features<'static>,
    /// Vulkan 1.2 features.
    pub vulkan12: vk::PhysicalDeviceVulkan12Features<'static>,
    /// Vulkan 1.3 features.
    pub vulkan13: vk::PhysicalDeviceVulkan13Features<'static>,
    /// Of `VK_EXT_rasterization_order_attachment_access`; chain it where `extensions` has that name.
    pub rasterization_order: vk::PhysicalDeviceRasterizationOrderAttachmentAccessFeaturesEXT<'static>,
    /// Of `VK_EXT_fragment_shader_interlock`; chain it where `extensions` has that name.
    pub interlock: vk::PhysicalDeviceFragmentShaderInterlockFeaturesEXT<'static>,
    /// Of `VK_EXT_conditional_rendering`; chain it where `extensions` has that name.
    pub conditional: vk::PhysicalDeviceConditionalRenderingFeaturesEXT<'static>,
    /// Of `VK_EXT_multi_draw`; chain it where `extensions` has that name.
    pub multi_draw: vk::PhysicalDeviceMultiDrawFeaturesEXT<'static>,
}

/// Names of optional items that more than one place asks for.
const ORDER: &str = "rasterizationOrderColorAttachmentAccess";
const TURNS: &str = "fragmentShaderPixelInterlock";
const LAYER: &str = "shaderOutputLayer";
const CONDITION: &str = "conditionalRendering";
const MULTI: &str = "multiDraw";

/// Storage buffers that one stage may use: all shaders of the splats share a layout, which has 7 for points and 8 for
/// selection, cuts and counts. Vulkan alone guarantees 4 (1.3, "Required Limits").
const STORAGE_BUFFERS: u32 = 16;

impl Requirements {
    /// Asks a physical device. The instance must be of Vulkan 1.3 and the device belong to it.
    pub fn query(instance: &ash::Instance, physical_device: vk::PhysicalDevice) -> Requirements {
        // SAFETY: the physical device belongs to the instance (a precondition).
        let properties = unsafe { instance.get_physical_device_properties(physical_device) };
        let modern = properties.api_version >= vk::API_VERSION_1_3;
        let mut v11 = vk::PhysicalDeviceVulkan11Features::default();
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
        let mut order = vk::PhysicalDeviceRasterizationOrderAttachmentAccessFeaturesEXT::default();
        let mut turns = vk::PhysicalDeviceFragmentShaderInterlockFeaturesEXT::default();
        let mut condition = vk::PhysicalDeviceConditionalRenderingFeaturesEXT::default();
        let mut multi = vk::PhysicalDeviceMultiDrawFeaturesEXT::default();
        let mut core = vk::PhysicalDeviceFeatures::default();
        // SAFETY: as above. A device that cannot even list its extensions has none.
        let listed = unsafe { instance.enumerate_device_extension_properties(physical_device) }.unwrap_or_default();
        let has = |name| listed.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
        if modern {
            let mut chain =
                vk::PhysicalDeviceFeatures2::default().push_next(&mut v11).push_next(&mut v12).push_next(&mut v13);
            if has(ext::rasterization_order_attachment_access::NAME) {
                chain = chain.push_next(&mut order);
            }
            if has(ext::fragment_shader_interlock::NAME) {
                chain = chain.push_next(&mut turns);
            }
            if has(ext::conditional_rendering::NAME) {
                chain = chain.push_next(&mut condition);
            }
            if has(ext::multi_draw::NAME) {
                chain = chain.push_next(&mut multi);
            }
            // SAFETY: as above, and the chain's structs are known to Vulkan 1.3 or the extensions that are there.
            unsafe { instance.get_physical_device_features2(physical_device, &mut chain) };
            core = chain.features;
        }
        let order = order.rasterization_order_color_attachment_access == vk::TRUE;
        let turns = turns.fragment_shader_pixel_interlock == vk::TRUE
            && core.fragment_stores_and_atomics == vk::TRUE
            && core.shader_storage_image_extended_formats == vk::TRUE;
        let layer = v12.shader_output_layer == vk::TRUE;
        let condition = condition.conditional_rendering == vk::TRUE;
        let multi = multi.multi_draw == vk::TRUE;
        let supports = |format, wanted| {
            // SAFETY: as above.
            let found = unsafe { instance.get_physical_device_format_properties(physical_device, format) };
            found.optimal_tiling_features.contains(wanted | vk::FormatFeatureFlags::SAMPLED_IMAGE)
        };
        let sums = supports(targets::SUMS, vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND);
        let depth = supports(targets::DEPTH, vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT);
        let buffers = properties.limits.max_per_stage_descriptor_storage_buffers >= STORAGE_BUFFERS;
        let timestamps = properties.limits.timestamp_compute_and_graphics == vk::TRUE;
        let item = |name, disables, required, present| Requirement { name, disables, required, present };
        let all = "the renderer";
        let items = vec![
            item("Vulkan 1.3", all, true, modern),
            item("dynamicRendering", all, true, v13.dynamic_rendering == vk::TRUE),
            item("synchronization2", all, true, v13.synchronization2 == vk::TRUE),
            item("multiview", all, true, v11.multiview == vk::TRUE),
            item("independentBlend", all, true, core.independent_blend == vk::TRUE),
            item("maintenance4", all, true, v13.maintenance4 == vk::TRUE),
            item("blending to R32G32B32A32_SFLOAT", all, true, sums),
            item("D32_SFLOAT_S8_UINT attachments", all, true, depth),
            item("maxPerStageDescriptorStorageBuffers ≥ 16", all, true, buffers),
            item("largePoints", "point sprites: quads are drawn", false, core.large_points == vk::TRUE),
            item(ORDER, "fuzzy by attachments: the interlock is used, or else two-pass", false, order),
            item(TURNS, "fuzzy by interlock: two-pass is drawn, unless attachments can be read in order", false, turns),
            item(LAYER, "groups: two-pass is drawn", false, layer),
            item(CONDITION, "occlusion tests of layered point clouds: what is hidden is drawn too", false, condition),
            item(MULTI, "one command for many runs of points: each has its own", false, multi),
            item("timestampComputeAndGraphics", "GPU times in the statistics", false, timestamps),
        ];
        let mut extensions = Vec::new();
        extensions.extend(order.then_some(ext::rasterization_order_attachment_access::NAME));
        extensions.extend(turns.then_some(ext::fragment_shader_interlock::NAME));
        extensions.extend(condition.then_some(ext::conditional_rendering::NAME));
        extensions.extend(multi.then_some(ext::multi_draw::NAME));
        Requirements {
            items,
            extensions,
            features: vk::PhysicalDeviceFeatures::default()
                .independent_blend(true)
                .large_points(core.large_points == vk::TRUE)
                .fragment_stores_and_atomics(turns)
                .shader_storage_image_extended_formats(turns),
            vulkan11: vk::PhysicalDeviceVulkan11Features::default().multiview(true),
            vulkan12: vk::PhysicalDeviceVulkan12Features::default().shader_output_layer(layer),
            rasterization_order: vk::PhysicalDeviceRasterizationOrderAttachmentAccessFeaturesEXT::default()
                .rasterization_order_color_attachment_access(order),
            interlock: vk::PhysicalDeviceFragmentShaderInterlockFeaturesEXT::default()
                .fragment_shader_pixel_interlock(turns),
            conditional: vk::PhysicalDeviceConditionalRenderingFeaturesEXT::default().conditional_rendering(condition),
            multi_draw: vk::PhysicalDeviceMultiDrawFeaturesEXT::default().multi_draw(multi),
            vulkan13: vk::PhysicalDeviceVulkan13Features::default()
                .dynamic_rendering(true)
                .synchronization2(true)
                .maintenance4(true),
        }
    }

    /// Chains the feature structs into a description that has none of them yet. A host with structs of its own of these
    /// kinds merges instead.
    pub fn chain<'a>(&'a mut self, info: vk::DeviceCreateInfo<'a>) -> vk::DeviceCreateInfo<'a> {
        let mut info = info.push_next(&mut self.vulkan11).push_next(&mut self.vulkan12).push_next(&mut self.vulkan13);
        if self.extensions.contains(&ext::rasterization_order_attachment_access::NAME) {
            info = info.push_next(&mut self.rasterization_order);
        }
        if self.extensions.contains(&ext::fragment_shader_interlock::NAME) {
            info = info.push_next(&mut self.interlock);
        }
        if self.extensions.contains(&ext::conditional_rendering::NAME) {
            info = info.push_next(&mut self.conditional);
        }
        if self.extensions.contains(&ext::multi_draw::NAME) {
            info = info.push_next(&mut self.multi_draw);
        }
        info
    }

    /// Required items that this device lacks; empty: the renderer will run.
    pub fn missing(&self) -> Vec<Requirement> {
        self.items.iter().filter(|i| i.required && !i.present).copied().collect()
    }

    /// Does without optional items, by name: nothing of them is enabled. Fails for a name that is none of theirs.
    pub fn without(&mut self, names: &[String]) -> Result<()> {
        for name in names {
            let optional: Vec<&str> = self.items.iter().filter(|i| !i.required).map(|i| i.name).collect();
            let Some(item) = self.items.iter_mut().find(|i| !i.required && i.name == name) else {
                let text = format!("to do without {name}: optional are {}", optional.join(", "));
                return Err(Error::Unsupported(text));
            };
            item.present = false;
            match item.name {
                "largePoints" => self.features.large_points = vk::FALSE,
                ORDER => self.extensions.retain(|e| *e != ext::rasterization_order_attachment_access::NAME),
                TURNS => self.extensions.retain(|e| *e != ext::fragment_shader_interlock::NAME),
                LAYER => self.vulkan12.shader_output_layer = vk::FALSE,
                CONDITION => self.extensions.retain(|e| *e != ext::conditional_rendering::NAME),
                MULTI => self.extensions.retain(|e| *e != ext::multi_draw::NAME),
                _ => {}
            }
        }
        Ok(())
    }

    /// What is enabled on a device that is created with exactly these features. `debug_utils`: the instance has
    /// `VK_EXT_debug_utils`.
    pub fn enabled(&self, debug_utils: bool) -> Enabled {
        let has = |name| self.items.iter().any(|i| i.name == name && i.present);
        Enabled {
            large_points: has("largePoints"),
            timestamps: has("timestampComputeAndGraphics"),
            rasterization_order: has(ORDER),
            interlock: if has(TURNS) { Interlock::Pixel } else { Interlock::Absent },
            output_layer: has(LAYER),
            conditional: has(CONDITION),
            multi_draw: has(MULTI),
            debug_utils,
        }
    }
}

impl fmt::Display for Requirement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (disables {})", self.name, self.disables)
    }
}

/// What the host lends. All of it outlives the renderer, and stays the host's to destroy.
pub struct Host {
    /// Made for Vulkan 1.3.
    pub instance: ash::Instance,
    /// Of that instance.
    pub physical_device: vk::PhysicalDevice,
    /// Of that physical device, with at least the required features.
    pub device: ash::Device,
    /// What was enabled on it.
    pub enabled: Enabled,
    /// Where device memory comes from.
    pub memory: Box<dyn GpuMemory>,
    /// Or null.
    pub pipeline_cache: vk::PipelineCache,
}

/// What `composite` draws into. Fixed for a renderer's life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TargetFormats {
    /// Of the host's only colour attachment. Formats that end in `_SRGB` are encoded by the device.
    pub color: vk::Format,
    /// Of the host's depth attachment, if it has one.
    pub depth: Option<vk::Format>,
    /// Samples a pixel of both.
    pub samples: vk::SampleCountFlags,
    /// Views of the host's pass, as bits from bit 0 without gaps; 0 without multiview.
    pub view_mask: u32,
    /// How the host draws.
    pub pass: PassKind,
    /// Encode to sRGB in the shader: for a `_UNORM` target that is shown as it is. The host's blending is then in
    /// encoded values too.
    pub encode_srgb: bool,
}

impl TargetFormats {
    /// Refuses here what could not be drawn to later.
    pub(crate) fn check(&self, instance: &ash::Instance, physical_device: vk::PhysicalDevice) -> Result<()> {
        let refuse = |what: String| Err(Error::Unsupported(what));
        let mask = self.view_mask;
        if mask.trailing_ones() != u32::BITS - mask.leading_zeros() || mask.count_ones() as usize > MAX_VIEWS {
            return refuse(format!("view mask {mask:#b}: bits from 0 without gaps, at most {MAX_VIEWS}"));
        }
        let lacks = |format, wanted| {
            // SAFETY: the physical device belongs to the instance (a precondition).
            let found = unsafe { instance.get_physical_device_format_properties(physical_device, format) };
            !found.optimal_tiling_features.contains(wanted)
        };
        if lacks(self.color, vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND) {
            return refuse(format!("a colour target of format {:?}: this device cannot blend into it", self.color));
        }
        if let Some(depth) = self.depth.filter(|d| lacks(*d, vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT)) {
            return refuse(format!("a depth target of format {depth:?}: this device cannot draw to it"));
        }
        // SAFETY: as above.
        let limits = unsafe { instance.get_physical_device_properties(physical_device) }.limits;
        let mut samples = limits.framebuffer_color_sample_counts;
        if self.depth.is_some() {
            samples &= limits.framebuffer_depth_sample_counts;
        }
        if self.samples.as_raw().count_ones() != 1 || !samples.contains(self.samples) {
            return refuse(format!("{:?} samples a pixel: this device has {samples:?}", self.samples));
        }
        Ok(())
    }
}

/// How the host begins the pass that `composite` is recorded in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PassKind {
    /// `vkCmdBeginRendering`.
    Dynamic,
    /// `vkCmdBeginRenderPass` with a compatible render pass.
    RenderPass {
        /// A compatible render pass; only used to make the pipeline.
        pass: vk::RenderPass,
        /// Index of the subpass, with one colour attachment.
        subpass: u32,
    },
}

/// A cloud that was handed to a renderer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CloudId(pub(crate) u64);

/// A cloud in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instance {
    /// Which cloud.
    pub cloud: CloudId,
    /// From the cloud's world to the scene's: rotation, uniform scale, translation.
    pub transform: DMat4,
}

/// The host's depth, to be hidden by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostDepth {
    /// A `2D_ARRAY` view of the depth aspect, single-sampled, a layer a view, covering the target.
    pub view: vk::ImageView,
    /// The layout that the image is in while `render`'s commands run, one that allows sampling.
    pub layout: vk::ImageLayout,
}

/// One frame as plain data.
#[derive(Debug, Clone, Copy)]
pub struct FrameInput<'a> {
    /// The host's counter, from 1: greater than that of every earlier frame.
    pub id: u64,
    /// Size of the picture \[px\], at least 1 × 1.
    pub extent: vk::Extent2D,
    /// Where in the host's target the picture begins \[px\].
    pub offset: vk::Offset2D,
    /// One view, or as many as the target's mask has bits; at most [`MAX_VIEWS`].
    pub views: &'a [View],
    /// What is drawn, in this order.
    pub instances: &'a [Instance],
    /// How.
    pub technique: Technique,
    /// And how it looks.
    pub style: &'a Style,
    /// Depth of the host's opaque geometry, if there is any.
    pub host_depth: Option<HostDepth>,
    /// Count what is drawn and culled: one compute pass more.
    pub count: bool,
    /// Copy the numbers that compaction lists ([`Selection::Compute`](crate::technique::Selection::Compute)) back to the
    /// processor, for [`FrameStats::lists`](crate::FrameStats::lists): to look into a frame, not for every one.
    pub keep_lists: bool,
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::draw::variant::shaders;
    use crate::gpu::spirv::Kind;

    #[test]
    fn the_splats_layout_has_no_more_storage_buffers_than_are_required() {
        for interlock in [Interlock::Absent, Interlock::Pixel, Interlock::Implicit] {
            let enabled = Enabled {
                large_points: true,
                timestamps: true,
                rasterization_order: true,
                interlock,
                output_layer: true,
                conditional: true,
                multi_draw: true,
                debug_utils: true,
            };
            let bindings = shaders(&enabled).into_iter().flat_map(|shader| shader.bindings);
            let buffers = bindings.filter(|b| b.kind == Kind::StorageBuffer).map(|b| (b.set, b.binding));
            let found = buffers.collect::<BTreeSet<_>>().len();
            // A layout's binding counts in every stage that it names: no stage has more than all of them.
            assert!((15..=STORAGE_BUFFERS as usize).contains(&found), "{found} storage buffers");
        }
    }
}
