//! Tests without Vulkan.

mod reference_common;
mod reference_fragments;
mod reference_light;
mod reference_oracle;
