//! How points are arranged. No Vulkan here.
#![forbid(unsafe_code)]

pub mod arrange;
mod file;
pub mod flat;
pub mod groups;
mod morton;
pub mod nodes;
pub mod octahedral;
pub mod sequential;

pub use arrange::Arrangement;
pub use flat::Flat;
pub use groups::Groups;
pub use nodes::{Node, Nodes};
pub use sequential::Sequential;
