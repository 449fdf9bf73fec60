//! Tests with Vulkan.

mod cli;
#[path = "../common/mod.rs"]
mod common;
