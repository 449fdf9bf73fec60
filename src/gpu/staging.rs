//! Staging memory in pieces of equal size that other threads fill, so that a frame has nothing left to copy itself.

use std::ptr::NonNull;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use ash::vk;

use super::context::Context;
use super::memory::Location;
use super::resource::Buffer;
use crate::error::Result;

#[derive(Debug)]
struct State {
    /// Used last, handed out first: it is in the processor's caches.
    free: Vec<u32>,
    closed: bool,
}

/// What the threads share of a pool.
#[derive(Debug)]
pub struct Pieces {
    base: NonNull<u8>,
    size: u64,
    state: Mutex<State>,
    freed: Condvar,
}

// SAFETY: the base is only read, and what it points to only through pieces, each of which has bytes of its own.
unsafe impl Send for Pieces {}
// SAFETY: as above; the state has a lock.
unsafe impl Sync for Pieces {}

impl Pieces {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A piece, once one is free; `None` when the pool is gone. Not for the frame's thread: it may wait for the device.
    pub fn take(self: &Arc<Pieces>) -> Option<Piece> {
        let mut state = self.state();
        while !state.closed {
            if let Some(index) = state.free.pop() {
                return Some(Piece { of: Arc::clone(self), index });
            }
            state = self.freed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        None
    }

    /// Wakes those that wait for a piece: none comes any more.
    fn close(&self) {
        self.state().closed = true;
        self.freed.notify_all();
    }
}

/// Some staging memory that is written by its holder alone. Dropped when the frame that copies from it is complete.
#[derive(Debug)]
pub struct Piece {
    of: Arc<Pieces>,
    index: u32,
}

impl Piece {
    /// Offset in the pool's buffer.
    pub fn offset(&self) -> u64 {
        u64::from(self.index) * self.of.size
    }

    /// Its bytes. The pool has not been closed, and no frame copies from it yet.
    pub fn bytes(&mut self) -> &mut [u8] {
        // SAFETY: within the mapping, which lives until the pool is closed (a precondition); no two pieces have the same
        // index at a time, and `self` is borrowed as long as the slice.
        unsafe {
            let start = self.of.base.add(self.offset() as usize);
            std::slice::from_raw_parts_mut(start.as_ptr(), self.of.size as usize)
        }
    }
}

impl Drop for Piece {
    fn drop(&mut self) {
        self.of.state().free.push(self.index);
        self.of.freed.notify_one();
    }
}

/// Closes the pieces, also where the pool is forgotten by an error.
#[derive(Debug)]
struct Open(Arc<Pieces>);

impl Drop for Open {
    fn drop(&mut self) {
        self.0.close();
    }
}

/// A mapped buffer in pieces.
#[derive(Debug)]
pub struct Pool {
    pieces: Open,
    buffer: Buffer,
}

impl Pool {
    /// Of `count` pieces of `size` bytes, both more than 0; the size is a multiple of 16.
    pub fn new(context: &mut Context, size: u64, count: u32) -> Result<Pool> {
        debug_assert!(size.is_multiple_of(16), "offsets of copies");
        let (usage, bytes) = (vk::BufferUsageFlags::TRANSFER_SRC, size * u64::from(count));
        let mut buffer = Buffer::new(context, "staging.pieces", bytes, usage, Location::Upload)?;
        let base = NonNull::from(buffer.bytes()).cast();
        let state = Mutex::new(State { free: (0..count).rev().collect(), closed: false });
        Ok(Pool { pieces: Open(Arc::new(Pieces { base, size, state, freed: Condvar::new() })), buffer })
    }

    /// For the threads that fill.
    pub fn pieces(&self) -> Arc<Pieces> {
        Arc::clone(&self.pieces.0)
    }

    /// Where copies come from.
    pub fn buffer(&self) -> vk::Buffer {
        self.buffer.handle
    }

    /// Closes the pool. Its buffer may go once no thread writes a piece and no frame copies from one.
    pub fn close(self) -> Buffer {
        self.buffer
    }
}
