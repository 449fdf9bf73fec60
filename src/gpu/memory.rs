//! Where device memory comes from: a small seam that a host fills with its own allocator.

use std::collections::HashMap;
use std::ffi::c_void;
use std::ptr::NonNull;
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator};

use crate::error::{Error, Result};

/// Who reads and writes the memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Location {
    /// The device alone.
    Device,
    /// Written by the processor once, read by the device. Mapped.
    Upload,
    /// Written by the device, read by the processor. Mapped.
    Readback,
}

/// What is asked of an allocator.
#[derive(Debug, Clone, Copy)]
pub struct MemoryRequest<'a> {
    /// Debug name of the resource.
    pub name: &'a str,
    /// As the device states them.
    pub requirements: vk::MemoryRequirements,
    /// Who reads and writes it.
    pub location: Location,
    /// A buffer (true) or an image of optimal tiling (false).
    pub linear: bool,
}

/// A piece of device memory, bound by the caller at `offset`.
#[derive(Debug)]
pub struct Memory {
    /// The allocation it lies in.
    pub memory: vk::DeviceMemory,
    /// Byte offset in it.
    pub offset: u64,
    /// Bytes.
    pub size: u64,
    /// Start of the piece in the address space, for [`Location::Upload`] and [`Location::Readback`]; coherent.
    pub mapped: Option<NonNull<c_void>>,
    /// The allocator's own key.
    pub token: u64,
}

// SAFETY: the mapping is plain memory that belongs to this piece alone; Vulkan asks for external synchronisation only
// of map and unmap, which the allocator does.
unsafe impl Send for Memory {}
// SAFETY: as above; shared access only reads the fields.
unsafe impl Sync for Memory {}

/// Gives and takes device memory. Called while recording, never from another thread at the same time.
pub trait GpuMemory: Send {
    /// A piece that fulfils the request. Host-visible pieces are mapped and coherent.
    fn allocate(&mut self, request: &MemoryRequest) -> Result<Memory>;

    /// Takes a piece back. The device no longer uses it.
    fn free(&mut self, memory: Memory);
}

/// The host's `gpu_allocator`, shared.
pub struct SharedAllocator {
    allocator: Arc<Mutex<Allocator>>,
    pieces: HashMap<u64, Allocation>,
    next: u64,
}

impl SharedAllocator {
    /// Allocates from `allocator`; it must outlive the renderer's last `destroy`, and its device the allocator.
    pub fn new(allocator: Arc<Mutex<Allocator>>) -> Self {
        SharedAllocator { allocator, pieces: HashMap::new(), next: 0 }
    }
}

impl GpuMemory for SharedAllocator {
    fn allocate(&mut self, request: &MemoryRequest) -> Result<Memory> {
        let location = match request.location {
            Location::Device => MemoryLocation::GpuOnly,
            Location::Upload => MemoryLocation::CpuToGpu,
            Location::Readback => MemoryLocation::GpuToCpu,
        };
        let piece = self
            .allocator
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .allocate(&AllocationCreateDesc {
                name: request.name,
                requirements: request.requirements,
                location,
                linear: request.linear,
                allocation_scheme: AllocationScheme::GpuAllocatorManaged,
            })
            .map_err(|e| match e {
                gpu_allocator::AllocationError::OutOfMemory => {
                    Error::OutOfDeviceMemory { what: request.name.to_owned(), requested: request.requirements.size }
                }
                other => Error::Unsupported(format!("memory for {}: {other}", request.name)),
            })?;
        let token = self.next;
        self.next += 1;
        // SAFETY: the handle is only bound to a resource of this request, and the piece is kept until `free`.
        let memory = unsafe { piece.memory() };
        let result = Memory { memory, offset: piece.offset(), size: piece.size(), mapped: piece.mapped_ptr(), token };
        self.pieces.insert(token, piece);
        Ok(result)
    }

    fn free(&mut self, memory: Memory) {
        if let Some(piece) = self.pieces.remove(&memory.token) {
            let freed = self.allocator.lock().unwrap_or_else(PoisonError::into_inner).free(piece);
            debug_assert!(freed.is_ok(), "a piece of this allocator");
        }
    }
}
