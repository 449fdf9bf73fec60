//! Buffers and images with their memory, named and counted.

use ash::vk;

use super::barrier::Access;
use super::context::Context;
use super::memory::{Location, Memory, MemoryRequest};
use crate::error::{Named, Result};

/// A buffer with its own memory.
#[derive(Debug)]
pub struct Buffer {
    /// The handle.
    pub handle: vk::Buffer,
    /// Bytes asked for.
    pub size: u64,
    memory: Memory,
}

impl Buffer {
    /// A buffer of `size` > 0 bytes.
    pub fn new(
        context: &mut Context,
        name: &str,
        size: u64,
        usage: vk::BufferUsageFlags,
        location: Location,
    ) -> Result<Buffer> {
        let info = vk::BufferCreateInfo::default().size(size).usage(usage).sharing_mode(vk::SharingMode::EXCLUSIVE);
        // SAFETY: the device lives; the size is not zero (a precondition).
        let handle = unsafe { context.device.create_buffer(&info, None) }.named("vkCreateBuffer")?;
        context.name(handle, name);
        // SAFETY: the handle was made just above.
        let requirements = unsafe { context.device.get_buffer_memory_requirements(handle) };
        let request = MemoryRequest { name, requirements, location, linear: true };
        let bound = context.memory.allocate(&request).and_then(|memory| {
            // SAFETY: memory of a fitting type, big enough and aligned, as the allocator promises; bound once.
            let bound = unsafe { context.device.bind_buffer_memory(handle, memory.memory, memory.offset) };
            match bound.named("vkBindBufferMemory") {
                Ok(()) => Ok(memory),
                Err(e) => {
                    context.memory.free(memory);
                    Err(e)
                }
            }
        });
        match bound {
            Ok(memory) => {
                context.allocated += memory.size;
                Ok(Buffer { handle, size, memory })
            }
            Err(e) => {
                // SAFETY: nothing uses the buffer yet.
                unsafe { context.device.destroy_buffer(handle, None) };
                Err(e)
            }
        }
    }

    /// The mapped bytes of an upload or readback buffer.
    ///
    /// The device must not be writing them, nor reading those that are written here.
    pub fn bytes(&mut self) -> &mut [u8] {
        let start = self.memory.mapped.expect("only host-visible buffers are mapped").cast::<u8>();
        // SAFETY: the mapping holds at least `size` bytes of initialised plain memory that is this buffer's alone, and
        // `self` is borrowed as long as the slice.
        unsafe { std::slice::from_raw_parts_mut(start.as_ptr(), self.size as usize) }
    }

    /// Destroys the buffer; the device no longer uses it.
    pub fn destroy(self, context: &mut Context) {
        // SAFETY: not in use (a precondition), destroyed once since `self` is consumed.
        unsafe { context.device.destroy_buffer(self.handle, None) };
        context.allocated -= self.memory.size;
        context.memory.free(self.memory);
    }
}

/// A two-dimensional array image with one view of everything and one of each layer.
#[derive(Debug)]
pub struct Image {
    /// The handle.
    pub handle: vk::Image,
    /// View of all layers, as an array: of the stencil where there is one, since that is what is sampled.
    pub array: vk::ImageView,
    /// Views of single layers, to draw to.
    pub layers: Vec<vk::ImageView>,
    /// Format.
    pub format: vk::Format,
    /// Last recorded use.
    pub access: Access,
    memory: Memory,
}

impl Image {
    /// An image of `extent` with `layers` layers.
    pub fn new(
        context: &mut Context,
        name: &str,
        format: vk::Format,
        extent: vk::Extent2D,
        layers: u32,
        usage: vk::ImageUsageFlags,
    ) -> Result<Image> {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width: extent.width, height: extent.height, depth: 1 })
            .mip_levels(1)
            .array_layers(layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(usage)
            .sharing_mode(vk::SharingMode::EXCLUSIVE)
            .initial_layout(vk::ImageLayout::UNDEFINED);
        // SAFETY: the device lives; extent and layers are within its limits (checked by the caller).
        let handle = unsafe { context.device.create_image(&info, None) }.named("vkCreateImage")?;
        context.name(handle, name);
        // SAFETY: the handle was made just above.
        let requirements = unsafe { context.device.get_image_memory_requirements(handle) };
        let request = MemoryRequest { name, requirements, location: Location::Device, linear: false };
        let memory = match context.memory.allocate(&request) {
            Ok(memory) => memory,
            Err(e) => {
                // SAFETY: nothing uses the image yet.
                unsafe { context.device.destroy_image(handle, None) };
                return Err(e);
            }
        };
        context.allocated += memory.size;
        let mut image = Image {
            handle,
            array: vk::ImageView::null(),
            layers: Vec::new(),
            format,
            access: Access::Undefined,
            memory,
        };
        match image.bind_and_view(context, name, layers) {
            Ok(()) => Ok(image),
            Err(e) => {
                image.destroy(context);
                Err(e)
            }
        }
    }

    fn bind_and_view(&mut self, context: &Context, name: &str, layers: u32) -> Result<()> {
        // SAFETY: memory of a fitting type, big enough and aligned, as the allocator promises; bound once.
        unsafe { context.device.bind_image_memory(self.handle, self.memory.memory, self.memory.offset) }
            .named("vkBindImageMemory")?;
        let attached = aspect(self.format);
        let stencil = attached & vk::ImageAspectFlags::STENCIL;
        let sampled = if stencil.is_empty() { attached } else { stencil };
        let view = |kind, aspect, first, count| {
            let info = vk::ImageViewCreateInfo::default()
                .image(self.handle)
                .view_type(kind)
                .format(self.format)
                .subresource_range(
                    vk::ImageSubresourceRange::default()
                        .aspect_mask(aspect)
                        .level_count(1)
                        .base_array_layer(first)
                        .layer_count(count),
                );
            // SAFETY: image and device live, and the range lies within the image.
            unsafe { context.device.create_image_view(&info, None) }.named("vkCreateImageView")
        };
        self.array = view(vk::ImageViewType::TYPE_2D_ARRAY, sampled, 0, layers)?;
        context.name(self.array, &format!("{name}.array"));
        for layer in 0..layers {
            let one = view(vk::ImageViewType::TYPE_2D, attached, layer, 1)?;
            context.name(one, &format!("{name}.layer{layer}"));
            self.layers.push(one);
        }
        Ok(())
    }

    /// Destroys the image; the device no longer uses it.
    pub fn destroy(self, context: &mut Context) {
        // SAFETY: not in use (a precondition), destroyed once since `self` is consumed; null views are allowed.
        unsafe {
            for view in self.layers {
                context.device.destroy_image_view(view, None);
            }
            context.device.destroy_image_view(self.array, None);
            context.device.destroy_image(self.handle, None);
        }
        context.allocated -= self.memory.size;
        context.memory.free(self.memory);
    }
}

/// The aspects that a format's attachments have.
pub fn aspect(format: vk::Format) -> vk::ImageAspectFlags {
    match format {
        vk::Format::D32_SFLOAT | vk::Format::D16_UNORM | vk::Format::X8_D24_UNORM_PACK32 => vk::ImageAspectFlags::DEPTH,
        vk::Format::D24_UNORM_S8_UINT | vk::Format::D32_SFLOAT_S8_UINT => {
            vk::ImageAspectFlags::DEPTH | vk::ImageAspectFlags::STENCIL
        }
        _ => vk::ImageAspectFlags::COLOR,
    }
}
