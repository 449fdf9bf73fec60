//! What a picture and a frame are judged by: image errors and timing statistics.
#![forbid(unsafe_code)]

pub mod baseline;
pub mod compare;
mod depth;
pub mod difference;
#[cfg(feature = "flip")]
pub mod flip;
mod image;
mod interior;
pub mod pareto;
pub mod published;
mod silhouette;
mod ssim;
pub mod timing;

pub use compare::{Difference, Incomparable, compare};
pub use depth::DepthError;
pub use image::Image;
pub use interior::Interior;
pub use pareto::pareto;
pub use silhouette::Silhouette;
pub use timing::Summary;

/// Whether `test` holds for every pixel within `radius` \[px\] of pixel (x, y), diagonally too; what lies outside the
/// picture of this size is left out.
fn all_around(size: [usize; 2], [x, y]: [usize; 2], radius: usize, test: impl Fn(usize) -> bool) -> bool {
    let range = |at: usize, side: usize| at.saturating_sub(radius)..(at + radius + 1).min(side);
    range(y, size[1]).all(|y| range(x, size[0]).all(|x| test(y * size[0] + x)))
}
