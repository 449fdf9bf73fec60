//! How points are arranged. No Vulkan here.
#![forbid(unsafe_code)]

pub mod flat;
pub mod octahedral;

pub use flat::Flat;
