//! From files and formulas to a [`PointCloud`].

mod cloud;

pub use cloud::{Mesh, PointCloud, Report};
