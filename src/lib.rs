//! surfel
pub mod color;
pub mod error;
pub mod load;
pub mod measure;
#[cfg(feature = "reference")]
pub mod reference;
pub mod select;
pub mod structure;
pub mod style;
pub mod technique;
pub use ash;
pub use error::{Error, Place, Result};
