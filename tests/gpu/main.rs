//! Tests that need a Vulkan device; each fails without one, and on any message of the layers.

#[path = "../common/vulkan.rs"]
mod vulkan;

mod canary;
mod harness;
mod host_contract;
mod host_engine;
mod host_faults;
mod host_frames;
mod host_scene;
mod host_table;
mod host_target;
mod host_targets;
mod selftest;
