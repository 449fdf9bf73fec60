//! The host's device as the rest of `gpu` sees it.

use std::ffi::CString;

use ash::{ext, vk};

use super::memory::GpuMemory;

/// Whether fragment shaders can take turns at a pixel, in the order of submission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interlock {
    /// They cannot.
    #[default]
    Absent,
    /// Extension `VK_EXT_fragment_shader_interlock` with its feature `fragmentShaderPixelInterlock`, and the core features
    /// `fragmentStoresAndAtomics` and `shaderStorageImageExtendedFormats`.
    Pixel,
    /// Without the extension, they do anyway: lavapipe runs the fragments of a pixel one after the other. Not by any
    /// promise of Vulkan, so nothing sets it but tests, which cover the interlock's path by it.
    Implicit,
}

/// What the host really enabled: nothing else is used, whatever the device could do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Enabled {
    /// Feature `largePoints`.
    pub large_points: bool,
    /// Extension `VK_EXT_rasterization_order_attachment_access` and its feature `rasterizationOrderColorAttachmentAccess`.
    pub rasterization_order: bool,
    /// Fragment shaders take turns at a pixel.
    pub interlock: Interlock,
    /// Vulkan 1.2 feature `shaderOutputLayer`.
    pub output_layer: bool,
    /// The queue family of the command buffers has timestamps.
    pub timestamps: bool,
    /// Extension `VK_EXT_conditional_rendering` and its feature `conditionalRendering`.
    pub conditional: bool,
    /// Extension `VK_EXT_multi_draw` and its feature `multiDraw`.
    pub multi_draw: bool,
    /// Instance extension `VK_EXT_debug_utils`.
    pub debug_utils: bool,
}

/// Device, what it can do, and where its memory comes from.
pub struct Context {
    /// The host's device.
    pub device: ash::Device,
    /// Limits of the physical device.
    pub limits: vk::PhysicalDeviceLimits,
    /// What the host enabled.
    pub enabled: Enabled,
    /// The host's cache, or null.
    pub pipeline_cache: vk::PipelineCache,
    /// The host's allocator.
    pub memory: Box<dyn GpuMemory>,
    /// Bytes of device memory held now.
    pub allocated: u64,
    debug: Option<ext::debug_utils::Device>,
    conditional: Option<ext::conditional_rendering::Device>,
    /// With how many draws one command may have.
    multi_draw: Option<(ext::multi_draw::Device, usize)>,
    instance: ash::Instance,
    physical_device: vk::PhysicalDevice,
}

impl Context {
    /// Wraps the host's handles, which outlive the context.
    pub fn new(
        instance: &ash::Instance,
        physical_device: vk::PhysicalDevice,
        device: ash::Device,
        enabled: Enabled,
        pipeline_cache: vk::PipelineCache,
        memory: Box<dyn GpuMemory>,
    ) -> Context {
        // SAFETY: the physical device belongs to the instance (a precondition of `Host`).
        let limits = unsafe { instance.get_physical_device_properties(physical_device) }.limits;
        let debug = enabled.debug_utils.then(|| ext::debug_utils::Device::new(instance, &device));
        let conditional = enabled.conditional.then(|| ext::conditional_rendering::Device::new(instance, &device));
        let multi_draw = enabled.multi_draw.then(|| {
            let mut most = vk::PhysicalDeviceMultiDrawPropertiesEXT::default();
            let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut most);
            // SAFETY: as above; the device has the extension that knows the struct.
            unsafe { instance.get_physical_device_properties2(physical_device, &mut properties) };
            (ext::multi_draw::Device::new(instance, &device), most.max_multi_draw_count.max(1) as usize)
        });
        Context {
            device,
            limits,
            enabled,
            pipeline_cache,
            memory,
            allocated: 0,
            debug,
            conditional,
            multi_draw,
            instance: instance.clone(),
            physical_device,
        }
    }

    /// Most bytes that an image of this format and use may take; 0 where the device has none.
    pub fn max_image_bytes(&self, format: vk::Format, usage: vk::ImageUsageFlags) -> u64 {
        let (kind, tiling) = (vk::ImageType::TYPE_2D, vk::ImageTiling::OPTIMAL);
        let flags = vk::ImageCreateFlags::empty();
        // SAFETY: the physical device belongs to the instance, and both outlive the context (preconditions of `Host`).
        let found = unsafe {
            self.instance.get_physical_device_image_format_properties(
                self.physical_device,
                format,
                kind,
                tiling,
                usage,
                flags,
            )
        };
        found.map_or(0, |properties| properties.max_resource_size)
    }

    /// Names an object in the host's captures: `surfel.` and `name`.
    pub fn name<T: vk::Handle>(&self, object: T, name: &str) {
        if let Some(debug) = &self.debug {
            let name = c_name(name);
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
            // SAFETY: the object lives and is not used by another thread now. A refusal costs only the name.
            let _ = unsafe { debug.set_debug_utils_object_name(&info) };
        }
    }

    /// Runs the commands that follow only where the word at `offset` of a buffer is not 0. The buffer was made for that, and lives
    /// until the frame is complete; its word was made visible to [`Access::Condition`](super::barrier::Access).
    pub fn begin_condition(&self, cmd: vk::CommandBuffer, buffer: vk::Buffer, offset: u64) {
        if let Some(conditional) = &self.conditional {
            let info = vk::ConditionalRenderingBeginInfoEXT::default().buffer(buffer).offset(offset);
            // SAFETY: recording, none is open, and the offset is a multiple of four within the buffer (the callers').
            unsafe { (conditional.fp().cmd_begin_conditional_rendering_ext)(cmd, &info) };
        }
    }

    /// Ends that, in the same pass.
    pub fn end_condition(&self, cmd: vk::CommandBuffer) {
        if let Some(conditional) = &self.conditional {
            // SAFETY: recording, and one was begun in the same pass by `begin_condition`.
            unsafe { (conditional.fp().cmd_end_conditional_rendering_ext)(cmd) };
        }
    }

    /// Draws runs of vertices one after the other, by as few commands as the device can; returns how many. Bound streams hold them.
    pub fn draw_each(&self, cmd: vk::CommandBuffer, runs: &[vk::MultiDrawInfoEXT]) -> u32 {
        match &self.multi_draw {
            Some((multi, most)) if runs.len() > 1 => {
                let stride = size_of::<vk::MultiDrawInfoEXT>() as u32;
                for part in runs.chunks(*most) {
                    // SAFETY: recording, all that the pipeline reads is bound (the callers'), and no more draws than the device takes.
                    unsafe {
                        (multi.fp().cmd_draw_multi_ext)(cmd, part.len() as u32, part.as_ptr(), 1, 0, stride);
                    }
                }
                runs.len().div_ceil(*most) as u32
            }
            _ => {
                runs.iter().for_each(|run| self.draw(cmd, run.first_vertex, run.vertex_count));
                runs.len() as u32
            }
        }
    }

    /// Opens a label in a command buffer.
    pub fn begin_label(&self, cmd: vk::CommandBuffer, name: &str) {
        if let Some(debug) = &self.debug {
            let name = c_name(name);
            let label = vk::DebugUtilsLabelEXT::default().label_name(&name);
            // SAFETY: the buffer is recording (a precondition of every caller).
            unsafe { debug.cmd_begin_debug_utils_label(cmd, &label) };
        }
    }

    /// Closes the last label.
    pub fn end_label(&self, cmd: vk::CommandBuffer) {
        if let Some(debug) = &self.debug {
            // SAFETY: the buffer is recording and a label was opened in it by `begin_label`.
            unsafe { debug.cmd_end_debug_utils_label(cmd) };
        }
    }
}

fn c_name(name: &str) -> CString {
    CString::new(format!("surfel.{name}")).unwrap_or_default()
}
