//! Vulkan, and nothing of points: the only home of routine `unsafe`.

pub mod barrier;
mod command;
pub mod context;
pub mod download;
pub mod layout;
pub mod memory;
pub mod ordered;
pub mod pass;
pub mod program;
pub mod query;
pub mod resource;
pub mod retire;
pub mod spirv;
pub mod staging;
pub mod upload;

pub use context::{Context, Enabled, Interlock};
pub use memory::{GpuMemory, Location, Memory, MemoryRequest, SharedAllocator};
