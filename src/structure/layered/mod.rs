//! Layered point clouds (Gobbetti, Marton: Layered Point Clouds, 2004): a binary tree of patches of original samples. All
//! patches above a cut together are the picture, so that refining adds samples and takes none away.

mod index;

pub use index::{Index, Node};
