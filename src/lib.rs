//! `surfel` renders point-sampled surfaces — scans, LiDAR, dense meshes — with Vulkan, inside an engine that has its own.
//!
//! # The contract in a page
//!
//! 1. **Ask.** [`Requirements::query`] says what to enable on a device, before it is made.
//! 2. **Lend.** [`Renderer::new`] takes a [`Host`]: instance, device, what was enabled, where memory comes from.
//!    Everything stays the host's.
//! 3. **Add.** A [`PointCloud`](load::PointCloud) becomes a [`Flat`](structure::Flat), and [`Renderer::add`] takes it in.
//! 4. **Record.** Each frame is plain data, a [`FrameInput`]: views as two f64 matrices, instances, a
//!    [`Technique`](technique::Technique), a [`Style`](style::Style).
//!    - [`Renderer::prepare`], outside a pass: uploads and parameters.
//!    - [`Renderer::render`], outside a pass, after the host's opaque geometry: splats, into the library's own targets.
//!    - [`Renderer::composite`], inside the host's pass: one triangle, premultiplied colour and depth.
//! 5. **Retire.** [`Renderer::retire`] with the host's own counter of completed frames frees what only they used, and
//!    returns their [`FrameStats`].
//! 6. **Destroy.** [`Renderer::destroy`] leaves nothing alive.
//!
//! Nothing here submits, waits, presents or makes a device, except `standalone`, which is for tools and tests.
//! `docs/EMBEDDING.md` has the layouts, stages and clobbered state of every entry point.
//!
//! # Frames and units
//!
//! World coordinates are f64 in the input's own unit, written "world units". Eye space is right-handed with the viewer
//! looking along −Z; linear depth is z = −z_eye. Pixels count from the top left, centres at halves.

pub mod color;
pub mod composite;
pub mod draw;
pub mod error;
#[cfg(feature = "exr")]
pub mod exr;
pub mod gpu;
pub mod host;
pub mod load;
pub mod measure;
mod par;
pub mod readback;
#[cfg(feature = "reference")]
pub mod reference;
pub mod renderer;
mod rng;
pub mod select;
#[cfg(feature = "standalone")]
pub mod standalone;
pub mod stats;
pub mod stream;
pub mod structure;
pub mod style;
pub mod technique;

pub use ash;
pub use error::{Error, Place, Result};
pub use gpu::layout::MAX_VIEWS;
pub use gpu::{GpuMemory, Location, Memory, MemoryRequest, SharedAllocator};
pub use host::{
    CloudId, Enabled, FrameInput, Host, HostDepth, Instance, Interlock, PassKind, Requirements, TargetFormats,
};
pub use renderer::Renderer;
pub use stats::FrameStats;

/// Compiles the sample of the page.
#[cfg(doctest)]
#[doc = include_str!("../docs/EMBEDDING.md")]
struct Embedding;
