//! What a picture and a frame are judged by: image errors and timing statistics.
#![forbid(unsafe_code)]

pub mod compare;
pub mod pareto;
pub mod timing;

pub use compare::{Difference, Image, Incomparable, compare};
pub use pareto::pareto;
pub use timing::Summary;
