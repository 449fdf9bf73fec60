//! The full-screen passes: what comes from the host before the splats, and what goes back to it after them.

pub mod resolve;

pub use resolve::{Before, Composite};
