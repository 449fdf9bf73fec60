//! Layered point clouds (Gobbetti, Marton: Layered Point Clouds, 2004): a binary tree of patches of original samples. All
//! patches above a cut together are the picture, so that refining adds samples and takes none away.
//!
//! [`build`] makes a model of any size in bounded memory; [`Index::read`] and [`Patch::decode`] read it by ranges.

#[cfg(feature = "layered")]
mod build;
#[cfg(feature = "layered")]
mod file;
#[cfg(feature = "layered")]
mod in_view;
mod index;
mod model;
#[cfg(feature = "layered")]
mod patch;
#[cfg(feature = "layered")]
mod whole;

#[cfg(feature = "layered")]
pub use build::{Built, Normals, Options, Sampling, Told, build};
#[cfg(feature = "layered")]
pub use file::is_model;
#[cfg(feature = "layered")]
pub use in_view::{InView, Patience, in_view};
pub use index::{Index, Node};
pub use model::{Layered, Patch, Streaming};
#[cfg(feature = "layered")]
pub use whole::{coarse, verify, whole};

/// Most samples of one patch: what decoding takes is bounded by it, whatever an index says.
pub const MAX_SAMPLES: u32 = 1 << 22;
/// Deepest level of a tree.
pub const MAX_LEVEL: u8 = 96;
