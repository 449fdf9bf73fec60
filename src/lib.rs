//! surfel
pub mod color;
pub mod composite;
pub mod draw;
pub mod error;
pub mod gpu;
pub mod host;
pub mod load;
pub mod readback;
pub mod renderer;
pub mod select;
#[cfg(feature = "standalone")]
pub mod standalone;
pub mod stats;
pub mod structure;
pub mod style;
pub mod technique;
pub use ash;
pub use error::{Error, Place, Result};
pub use gpu::layout::MAX_VIEWS;
pub use gpu::{GpuMemory, Location, Memory, MemoryRequest, SharedAllocator};
pub use host::{CloudId, Enabled, FrameInput, Host, HostDepth, Instance, PassKind, Requirements, TargetFormats};
pub use renderer::Renderer;
pub use stats::FrameStats;

/// Compiles the sample of the page.
#[cfg(doctest)]
#[doc = include_str!("../docs/EMBEDDING.md")]
struct Embedding;
