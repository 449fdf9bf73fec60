//! How points are arranged. No Vulkan here.
#![forbid(unsafe_code)]

pub mod arrange;
pub mod cloud;
mod file;
pub mod flat;
pub mod groups;
pub mod hybrid;
pub mod layered;
mod morton;
pub mod nodes;
pub mod octahedral;
pub mod octree;
pub mod packing;
pub mod sequential;

pub use arrange::Arrangement;
pub use cloud::Cloud;
pub use flat::Flat;
pub use groups::Groups;
pub use hybrid::Hybrid;
pub use layered::Index;
pub use nodes::{Node, Nodes};
pub use octree::Octree;
pub use packing::Packing;
pub use sequential::Sequential;
