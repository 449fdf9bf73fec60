//! What a measurement makes on the device, freed when it ends, however it ends.

use ash::vk;

use super::device::Standalone;
use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::barrier::Access;
use crate::gpu::memory::Location;
use crate::gpu::pass::{Recorder, Use};
use crate::gpu::program::{GraphicsInfo, Program};
use crate::gpu::query::Timestamps;
use crate::gpu::resource::{Buffer, Image};
use crate::gpu::spirv::Shader;
use crate::gpu::upload::Upload;

/// Things are named by their numbers, from 0, in the order in which they were made.
pub(super) struct Held<'a> {
    pub standalone: &'a Standalone,
    pub context: Context,
    pub cmd: vk::CommandBuffer,
    /// `None` where the device has none.
    pub timestamps: Option<Timestamps>,
    pub buffers: Vec<Buffer>,
    pub images: Vec<Image>,
    pub program: Option<Program>,
    pub pipelines: Vec<vk::Pipeline>,
    pub pool: vk::DescriptorPool,
}

impl<'a> Held<'a> {
    /// Nothing but a command buffer and timestamps.
    pub fn new(standalone: &'a Standalone) -> Result<Held<'a>> {
        let context = standalone.context();
        let cmd = standalone.command_buffer()?;
        let timestamps = Timestamps::new(&context)?;
        Ok(Held {
            standalone,
            context,
            cmd,
            timestamps,
            buffers: Vec::new(),
            images: Vec::new(),
            program: None,
            pipelines: Vec::new(),
            pool: vk::DescriptorPool::null(),
        })
    }

    /// A buffer on the device with this content, which is not empty, to be read by vertex shaders and as indices.
    pub fn buffer(&mut self, name: &str, data: &[u8], usage: vk::BufferUsageFlags) -> Result<usize> {
        let usage = usage | vk::BufferUsageFlags::TRANSFER_DST;
        let buffer = Buffer::new(&mut self.context, name, data.len() as u64, usage, Location::Device)?;
        self.buffers.push(buffer);
        let at = self.buffers.len() - 1;
        let mut upload = Upload::new(&mut self.context, data.len() as u64)?;
        upload.write(&self.buffers[at], data);
        let done = self.standalone.run(self.cmd, |cmd| {
            upload.record(&self.context, cmd);
            let visible = vec![Use::Memory(Access::CopyWrite, Access::VertexRead)];
            Recorder::new(&self.context, cmd, None).barrier(visible);
            Ok(())
        });
        upload.destroy(&mut self.context);
        done.map(|()| at)
    }

    /// An image of one layer.
    pub fn image(
        &mut self,
        name: &str,
        format: vk::Format,
        extent: vk::Extent2D,
        usage: vk::ImageUsageFlags,
    ) -> Result<usize> {
        let limits = &self.context.limits;
        let limit = limits.max_framebuffer_width.min(limits.max_framebuffer_height).min(limits.max_image_dimension2_d);
        let vk::Extent2D { width, height } = extent;
        if width == 0 || height == 0 || width.max(height) > limit {
            return Err(Error::Unsupported(format!("a picture of {width}×{height}: this device has 1 to {limit}")));
        }
        self.images.push(Image::new(&mut self.context, name, format, extent, 1, usage)?);
        Ok(self.images.len() - 1)
    }

    /// The program of all pipelines, with `push` bytes of constants for the vertex stage.
    pub fn program(&mut self, name: &str, shaders: &[&'static Shader], push: usize) -> Result<&Program> {
        assert!(self.program.is_none(), "one program");
        let stage_flags = vk::ShaderStageFlags::VERTEX;
        let range = vk::PushConstantRange { stage_flags, offset: 0, size: push as u32 };
        Ok(self.program.insert(Program::new(&self.context, name, shaders, false, Some(range))?))
    }

    /// A pipeline of the program, which must be there.
    pub fn pipeline(&mut self, info: &GraphicsInfo) -> Result<vk::Pipeline> {
        let program = self.program.as_ref().expect("a program was made");
        let pipeline = program.graphics(&self.context, info)?;
        self.pipelines.push(pipeline);
        Ok(pipeline)
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        // Every run waits for the device, so nothing is in use.
        let context = &mut self.context;
        self.pipelines.drain(..).for_each(|p| context.destroy_pipeline(p));
        context.destroy_pool(self.pool);
        if let Some(program) = self.program.take() {
            program.destroy(context);
        }
        self.images.drain(..).for_each(|i| i.destroy(context));
        self.buffers.drain(..).for_each(|b| b.destroy(context));
        if let Some(timestamps) = self.timestamps.take() {
            timestamps.destroy(context);
        }
    }
}
