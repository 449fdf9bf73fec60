//! From memory to device buffers by way of staging: recorded into the host's command buffer, never submitted.

use ash::vk;

use super::context::Context;
use super::memory::Location;
use super::resource::Buffer;
use super::retire::{RetireQueue, Retired};
use super::staging::{Piece, Pool};
use crate::error::Result;

/// Kept until the frame that copies from it is complete.
#[derive(Debug)]
enum Staging {
    /// Memory of its own.
    Own(Buffer),
    /// Pieces of a pool, by its buffer.
    Pieces(vk::Buffer, Vec<Piece>),
}

/// Copies that wait to be recorded, and the staging memory that they come from.
#[derive(Debug)]
pub struct Upload {
    staging: Staging,
    copies: Vec<(vk::Buffer, vk::BufferCopy)>,
    /// Of the staging memory.
    used: u64,
}

impl Upload {
    /// Room for `size` > 0 bytes, each piece rounded up to 16.
    pub fn new(context: &mut Context, size: u64) -> Result<Upload> {
        let staging = Buffer::new(context, "staging", size, vk::BufferUsageFlags::TRANSFER_SRC, Location::Upload)?;
        Ok(Upload { staging: Staging::Own(staging), copies: Vec::new(), used: 0 })
    }

    /// Of pieces that others have filled.
    pub fn of_pieces(pool: &Pool) -> Upload {
        Upload { staging: Staging::Pieces(pool.buffer(), Vec::new()), copies: Vec::new(), used: 0 }
    }

    /// Writes `data` for the start of `to`. The memory is this upload's own.
    pub fn write(&mut self, to: &Buffer, data: &[u8]) {
        debug_assert!(data.len() as u64 <= to.size, "within the buffer");
        let Staging::Own(staging) = &mut self.staging else { unreachable!("pieces are filled already") };
        let at = self.used;
        staging.bytes()[at as usize..at as usize + data.len()].copy_from_slice(data);
        self.copies.push((to.handle, vk::BufferCopy { src_offset: at, dst_offset: 0, size: data.len() as u64 }));
        self.used += (data.len() as u64).next_multiple_of(16);
    }

    /// Copies `size` > 0 bytes at `from` in the pool's buffer to `to` from `offset` on.
    pub fn copy(&mut self, from: u64, to: &Buffer, offset: u64, size: u64) {
        debug_assert!(offset + size <= to.size, "within the buffer");
        self.copies.push((to.handle, vk::BufferCopy { src_offset: from, dst_offset: offset, size }));
        self.used += size;
    }

    /// Keeps a piece that is copied from.
    pub fn keep(&mut self, piece: Piece) {
        match &mut self.staging {
            Staging::Pieces(_, pieces) => pieces.push(piece),
            Staging::Own(_) => unreachable!("made of pieces"),
        }
    }

    /// How much is copied, or staged for it.
    pub fn bytes(&self) -> u64 {
        match &self.staging {
            Staging::Own(staging) => staging.size,
            Staging::Pieces(..) => self.used,
        }
    }

    /// Records the copies, those to one buffer that follow each other as one command.
    pub fn record(&self, context: &Context, cmd: vk::CommandBuffer) {
        let from = match &self.staging {
            Staging::Own(staging) => staging.handle,
            Staging::Pieces(buffer, _) => *buffer,
        };
        for copies in self.copies.chunk_by(|a, b| a.0 == b.0) {
            let regions: Vec<_> = copies.iter().map(|(_, copy)| *copy).collect();
            // SAFETY: recording outside a pass; both buffers live until the frame is complete and hold the ranges.
            unsafe { context.device.cmd_copy_buffer(cmd, from, copies[0].0, &regions) };
        }
    }

    /// Gives the staging memory up after `frame`.
    pub fn retire(self, queue: &mut RetireQueue, frame: u64) {
        queue.push(
            frame,
            match self.staging {
                Staging::Own(buffer) => Retired::Buffer(buffer),
                Staging::Pieces(_, pieces) => Retired::Pieces(pieces),
            },
        );
    }

    /// Destroys the staging memory: no frame copies from it, or those that do are complete.
    pub fn destroy(self, context: &mut Context) {
        if let Staging::Own(buffer) = self.staging {
            buffer.destroy(context);
        }
    }
}
