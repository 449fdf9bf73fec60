//! The few commands and descriptor calls that passes are made of.
//!
//! All of them record into a buffer that is recording, with handles that live until its frame is complete: that is the
//! contract of `Renderer`'s entry points, from which every call comes.

use ash::vk;

use super::context::Context;
use super::resource::Buffer;
use crate::error::{Named, Result};

impl Context {
    /// Binds a pipeline made for the pass that is recorded, or a compute pipeline outside passes.
    pub fn bind_pipeline(&self, cmd: vk::CommandBuffer, point: vk::PipelineBindPoint, pipeline: vk::Pipeline) {
        // SAFETY: the module's contract; the pipeline is of this kind.
        unsafe { self.device.cmd_bind_pipeline(cmd, point, pipeline) };
    }

    /// Binds sets from number `first` on, each of its layout in `layout`, with as many offsets as they have dynamic
    /// buffers.
    pub fn bind_sets(
        &self,
        cmd: vk::CommandBuffer,
        point: vk::PipelineBindPoint,
        layout: vk::PipelineLayout,
        first: u32,
        sets: &[vk::DescriptorSet],
        offsets: &[u32],
    ) {
        // SAFETY: the module's contract; offsets are multiples of the alignment and within the buffers (the callers').
        unsafe { self.device.cmd_bind_descriptor_sets(cmd, point, layout, first, sets, offsets) };
    }

    /// Sets the push constants of a stage, as many bytes as the layout has for it.
    pub fn push(&self, cmd: vk::CommandBuffer, layout: vk::PipelineLayout, stage: vk::ShaderStageFlags, bytes: &[u8]) {
        // SAFETY: the module's contract; the range is the layout's.
        unsafe { self.device.cmd_push_constants(cmd, layout, stage, 0, bytes) };
    }

    /// Binds vertex streams from their starts.
    pub fn bind_streams<const N: usize>(&self, cmd: vk::CommandBuffer, streams: &[vk::Buffer; N]) {
        // SAFETY: the module's contract; the buffers were made for vertices.
        unsafe { self.device.cmd_bind_vertex_buffers(cmd, 0, streams, &[0; N]) };
    }

    /// Binds 16-bit indices.
    pub fn bind_indices(&self, cmd: vk::CommandBuffer, buffer: vk::Buffer) {
        // SAFETY: the module's contract; the buffer was made for indices.
        unsafe { self.device.cmd_bind_index_buffer(cmd, buffer, 0, vk::IndexType::UINT16) };
    }

    /// Binds 32-bit indices.
    pub fn bind_list(&self, cmd: vk::CommandBuffer, buffer: vk::Buffer) {
        // SAFETY: the module's contract; the buffer was made for indices.
        unsafe { self.device.cmd_bind_index_buffer(cmd, buffer, 0, vk::IndexType::UINT32) };
    }

    /// Draws what a `VkDrawIndirectCommand` at `offset` says.
    pub fn draw_indirect(&self, cmd: vk::CommandBuffer, commands: vk::Buffer, offset: u64) {
        // SAFETY: the module's contract; the buffer holds a whole command there, a multiple of four from its start, written
        // before by a pass whose writes were made visible, and what it leads to lies within what is bound.
        unsafe { self.device.cmd_draw_indirect(cmd, commands, offset, 1, 0) };
    }

    /// Draws what a `VkDrawIndexedIndirectCommand` at `offset` says.
    pub fn draw_indexed_indirect(&self, cmd: vk::CommandBuffer, commands: vk::Buffer, offset: u64) {
        // SAFETY: as for `draw_indirect`; the indices that it takes are bound, and lie within the bound streams.
        unsafe { self.device.cmd_draw_indexed_indirect(cmd, commands, offset, 1, 0) };
    }

    /// Copies all of `from` to where `at` bytes of `to` end.
    pub fn copy(&self, cmd: vk::CommandBuffer, from: &Buffer, to: &Buffer, at: u64) {
        let copy = vk::BufferCopy { src_offset: 0, dst_offset: at, size: from.size };
        // SAFETY: the module's contract, outside passes; `to` is that much larger, and both were made for copies.
        unsafe { self.device.cmd_copy_buffer(cmd, from.handle, to.handle, &[copy]) };
    }

    /// Draws `count` vertices from `first` on; bound streams hold as many.
    pub fn draw(&self, cmd: vk::CommandBuffer, first: u32, count: u32) {
        // SAFETY: the module's contract; all that the pipeline reads is bound.
        unsafe { self.device.cmd_draw(cmd, count, 1, first, 0) };
    }

    /// Draws the first `count` indices, `offset` added to each.
    pub fn draw_indexed(&self, cmd: vk::CommandBuffer, count: u32, offset: i32) {
        // SAFETY: the module's contract; indices are bound, and what they lead to lies within the bound storage.
        unsafe { self.device.cmd_draw_indexed(cmd, count, 1, 0, offset, 0) };
    }

    /// Runs `groups` groups, at most 65,535.
    pub fn dispatch(&self, cmd: vk::CommandBuffer, groups: u32) {
        // SAFETY: the module's contract, outside passes; all that the pipeline reads is bound.
        unsafe { self.device.cmd_dispatch(cmd, groups, 1, 1) };
    }

    /// Fills a buffer, whose size is a multiple of four, with zeros.
    pub fn zero(&self, cmd: vk::CommandBuffer, buffer: vk::Buffer) {
        // SAFETY: the module's contract, outside passes; the buffer was made to be copied to.
        unsafe { self.device.cmd_fill_buffer(cmd, buffer, 0, vk::WHOLE_SIZE, 0) };
    }

    /// Viewport and scissor of an area.
    pub fn set_area(&self, cmd: vk::CommandBuffer, area: vk::Rect2D) {
        let viewport = vk::Viewport {
            x: area.offset.x as f32,
            y: area.offset.y as f32,
            width: area.extent.width as f32,
            height: area.extent.height as f32,
            min_depth: 0.0,
            max_depth: 1.0,
        };
        // SAFETY: the module's contract; pipelines have it as dynamic state.
        unsafe { self.device.cmd_set_viewport(cmd, 0, &[viewport]) };
        self.set_scissor(cmd, area);
    }

    /// Scissor alone: part of an area.
    pub fn set_scissor(&self, cmd: vk::CommandBuffer, area: vk::Rect2D) {
        // SAFETY: the module's contract; pipelines have it as dynamic state.
        unsafe { self.device.cmd_set_scissor(cmd, 0, &[area]) };
    }

    /// A pool for `sets` sets.
    pub fn descriptor_pool(
        &self,
        name: &str,
        sets: u32,
        sizes: &[vk::DescriptorPoolSize],
    ) -> Result<vk::DescriptorPool> {
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(sets).pool_sizes(sizes);
        // SAFETY: the device lives.
        let pool = unsafe { self.device.create_descriptor_pool(&info, None) }.named("vkCreateDescriptorPool")?;
        self.name(pool, name);
        Ok(pool)
    }

    /// A set of each layout; the pool has room for them.
    pub fn descriptor_sets(
        &self,
        pool: vk::DescriptorPool,
        layouts: &[vk::DescriptorSetLayout],
    ) -> Result<Vec<vk::DescriptorSet>> {
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(layouts);
        // SAFETY: pool and layouts live.
        unsafe { self.device.allocate_descriptor_sets(&info) }.named("vkAllocateDescriptorSets")
    }

    /// Writes sets that no pending frame uses, with buffers, views and samplers that live.
    pub fn write_sets(&self, writes: &[vk::WriteDescriptorSet]) {
        // SAFETY: as said.
        unsafe { self.device.update_descriptor_sets(writes, &[]) };
    }

    /// Destroys a pool with its sets, none in use; null is ignored.
    pub fn destroy_pool(&self, pool: vk::DescriptorPool) {
        // SAFETY: as said, and once: callers give the handle up.
        unsafe { self.device.destroy_descriptor_pool(pool, None) };
    }

    /// Destroys a pipeline that is not in use; null is ignored.
    pub fn destroy_pipeline(&self, pipeline: vk::Pipeline) {
        // SAFETY: as said, and once: callers give the handle up.
        unsafe { self.device.destroy_pipeline(pipeline, None) };
    }

    /// A sampler of nearest texels.
    pub fn nearest_sampler(&self) -> Result<vk::Sampler> {
        let info = vk::SamplerCreateInfo::default()
            .mag_filter(vk::Filter::NEAREST)
            .min_filter(vk::Filter::NEAREST)
            .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE);
        // SAFETY: the device lives.
        let sampler = unsafe { self.device.create_sampler(&info, None) }.named("vkCreateSampler")?;
        self.name(sampler, "nearest");
        Ok(sampler)
    }

    /// Destroys a sampler that is not in use; null is ignored.
    pub fn destroy_sampler(&self, sampler: vk::Sampler) {
        // SAFETY: as said, and once: callers give the handle up.
        unsafe { self.device.destroy_sampler(sampler, None) };
    }
}
