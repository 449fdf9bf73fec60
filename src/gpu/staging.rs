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

    /// Its bytes. The pool's buffer has not been destroyed, and no frame copies from it yet.
    pub fn bytes(&mut self) -> &mut [u8] {
        // SAFETY: within the mapping, which lives as long as the buffer (a precondition); no two pieces have the same
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

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::thread;
    use std::time::Duration;

    use super::*;

    /// Longer than any thread takes to be woken.
    const LONG: Duration = Duration::from_secs(60);

    fn pieces(bytes: &mut [u8], size: u64) -> Arc<Pieces> {
        let count = (bytes.len() as u64 / size) as u32;
        let state = Mutex::new(State { free: (0..count).rev().collect(), closed: false });
        Arc::new(Pieces { base: NonNull::from(bytes).cast(), size, state, freed: Condvar::new() })
    }

    #[test]
    fn pieces_are_apart_and_waited_for() {
        let mut bytes = [0u8; 48];
        let pieces = pieces(&mut bytes, 16);
        let mut all: Vec<Piece> = (0..3).map(|_| pieces.take().expect("a piece")).collect();
        all.iter_mut().zip(1..).for_each(|(piece, value)| piece.bytes().fill(value));
        assert_eq!(all.iter().map(Piece::offset).collect::<Vec<_>>(), [0, 16, 32]);
        let (tell, told) = mpsc::channel();
        let waiting = Arc::clone(&pieces);
        let other = thread::spawn(move || {
            for _ in 0..2 {
                tell.send(waiting.take().map(|piece| piece.offset())).expect("someone listens");
            }
        });
        assert!(told.try_recv().is_err(), "there is none");
        drop(all.remove(1));
        assert_eq!(told.recv_timeout(LONG), Ok(Some(16)));
        // That one was dropped again, and is taken again.
        assert_eq!(told.recv_timeout(LONG), Ok(Some(16)));
        other.join().expect("no panic");
        drop(all);
        assert_eq!(bytes.map(|b| b as u64), std::array::from_fn(|i| i as u64 / 16 + 1));
    }

    #[test]
    fn who_waits_when_it_closes_gets_none() {
        let mut bytes = [0u8; 16];
        let pieces = pieces(&mut bytes, 16);
        let held = pieces.take().expect("a piece");
        let (tell, told) = mpsc::channel();
        let waiting = Arc::clone(&pieces);
        let other = thread::spawn(move || tell.send(waiting.take().is_none()).expect("someone listens"));
        drop(Open(Arc::clone(&pieces)));
        assert_eq!(told.recv_timeout(LONG), Ok(true));
        other.join().expect("no panic");
        drop(held);
        assert!(pieces.take().is_none(), "closed for good");
    }
}
