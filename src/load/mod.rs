//! From files and formulas to a [`PointCloud`].

#[cfg(feature = "preprocess")]
pub mod attributes;
mod cloud;

pub use cloud::{Mesh, PointCloud, Report};
