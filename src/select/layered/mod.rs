//! What views draw of a layered point cloud, what they miss, and which patches stay on the device (Gobbetti, Marton: Layered
//! Point Clouds, 2004, section 4). It lies here and not with the structure or the streams, since all of it is decided by views
//! and frames; neither bytes nor Vulkan are known here.
//!
//! A frame of one model, drawn by any number of views and instances, asks and answers in this order:
//!
//! 1. [`Cache::begin`] with the frame's number and the host's counter of completed frames.
//! 2. [`factor_for`]: the factor on all thresholds at which the views want no more patches than there are slots, or samples than
//!    there is time for ([`TimeBudget`]).
//! 3. [`refine`] for each view and instance, with [`Cache::presence`]; then [`Cache::mark`] each [`Cut`].
//! 4. [`wishes`] of all cuts in order; of those the first [`affordable`] are fetched, the rest forgotten.
//! 5. [`Cache::insert`] gives what has arrived a slot: here, or between 1 and 3, so that this very frame draws it.
//!
//! Nothing is remembered from one frame to the next but the cache and the measured times: with every patch there, the picture is a
//! function of the view.
//!
//! **Radii.** A drawn sample's radius is that of the deepest node containing its place that the cut has, [`Cut::radius_of`], or its
//! own where that is larger, and its own in a leaf that is there in full. The deepest node is found
//! from the sample's own node down, to the child on the sample's side of the plane, as long as the cut has that child. The cut
//! also has nodes that are not drawn but refined all the same: what lies outside the frustum, one level of it, and what faces
//! away. Their ancestors' samples keep the radius that they have when those nodes come into sight, so that nothing changes its
//! size at the border of the picture or at a contour.

mod budget;
mod cache;
mod cut;
mod fade;
mod occlusion;
mod refine;
mod time_budget;
mod wish;

pub use budget::{Limit, factor_for, factor_visible};
pub use cache::{Cache, Refused, Room, Slot};
pub use cut::{Counts, Cut, Role, Step};
pub use fade::{rank, shown};
pub use occlusion::{Occlusion, Verdict, tested_ball};
pub use refine::{Refine, Rule, refine, refine_visible};
pub use time_budget::TimeBudget;
pub use wish::{Wish, affordable, wishes};
