#[path = "../common/vulkan.rs"]
mod vulkan;

mod harness;
