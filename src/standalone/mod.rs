//! Our own instance, device and queue: for the command line, tests and benchmarks. Embedders bring theirs.

pub mod bare;
pub mod canary;
mod clock;
mod device;
mod held;
mod offscreen;
pub mod raw;
pub mod selftest;
#[cfg(feature = "reference")]
pub mod stress;
pub mod validation;

pub use device::{DeviceInfo, Options, Standalone};
pub use offscreen::{FrameTimes, Offscreen, Shot};
pub use validation::{Layers, Message};
