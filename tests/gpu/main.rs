//! Tests with Vulkan.

mod against_reference;
mod bench;
mod canary;
mod cli;
mod cli_structures;
#[path = "../common/mod.rs"]
mod common;
mod fly;
#[path = "../common/folder.rs"]
mod folder;
mod golden;
mod harness;
mod host_contract;
mod host_depth;
mod host_engine;
mod host_faults;
mod host_frames;
mod host_scene;
mod host_table;
mod host_target;
mod host_targets;
mod hybrid;
#[path = "../common/hybrid.rs"]
mod hybrid_common;
#[path = "../common/golden.rs"]
mod kept;
mod layered;
mod levels;
mod one_pass;
mod packing;
mod raw;
mod scene_files;
mod seeded;
mod selftest;
#[cfg(target_os = "linux")]
mod steady;
mod stress;
#[path = "../common/vulkan.rs"]
mod vulkan;
