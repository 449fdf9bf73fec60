//! Views, and which points a frame draws in which order. No Vulkan here.
#![forbid(unsafe_code)]

mod ball;
pub mod cut;
pub mod draw_list;
pub mod layered;
pub mod sight;
pub mod slabs;
pub mod view;

pub use draw_list::{DrawList, Span};
pub use sight::Sight;
pub use slabs::Slabs;
pub use view::{DepthConvention, View};
