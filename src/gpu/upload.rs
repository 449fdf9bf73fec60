//! From memory to device buffers by way of staging: recorded into the host's command buffer, never submitted.

use ash::vk;

use super::context::Context;
use super::memory::Location;
use super::resource::Buffer;
use crate::error::Result;

/// Copies that wait to be recorded, and the staging memory that they come from.
#[derive(Debug)]
pub struct Upload {
    /// Destroyed when the frame that copies from it is complete.
    pub staging: Buffer,
    copies: Vec<(vk::Buffer, vk::BufferCopy)>,
    used: u64,
}

impl Upload {
    /// Room for `size` > 0 bytes, each piece rounded up to 16.
    pub fn new(context: &mut Context, size: u64) -> Result<Upload> {
        let staging = Buffer::new(context, "staging", size, vk::BufferUsageFlags::TRANSFER_SRC, Location::Upload)?;
        Ok(Upload { staging, copies: Vec::new(), used: 0 })
    }

    /// Writes `data` for the start of `to`.
    pub fn write(&mut self, to: &Buffer, data: &[u8]) {
        self.write_at(to, 0, data);
    }

    /// Writes `data`, not empty, for the bytes of `to` from `offset` on.
    pub fn write_at(&mut self, to: &Buffer, offset: u64, data: &[u8]) {
        debug_assert!(offset + data.len() as u64 <= to.size, "within the buffer");
        let at = self.used;
        self.staging.bytes()[at as usize..at as usize + data.len()].copy_from_slice(data);
        let copy = vk::BufferCopy { src_offset: at, dst_offset: offset, size: data.len() as u64 };
        self.copies.push((to.handle, copy));
        self.used += (data.len() as u64).next_multiple_of(16);
    }

    /// Records the copies.
    pub fn record(&self, context: &Context, cmd: vk::CommandBuffer) {
        for (to, copy) in &self.copies {
            // SAFETY: recording outside a pass; both buffers live until the frame is complete and hold the range.
            unsafe { context.device.cmd_copy_buffer(cmd, self.staging.handle, *to, &[*copy]) };
        }
    }
}
