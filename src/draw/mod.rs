//! The passes that draw splats into the library's own targets: one file a blend.

pub mod area;
pub mod assemble;
pub mod cloud;
pub mod count;
pub mod cuts;
pub mod faces;
pub mod fuzzy;
pub mod groups;
pub mod large;
pub mod layers;
pub mod list;
pub mod occlusion;
pub mod opaque;
pub mod params;
pub mod patches;
pub mod plan;
pub mod slot;
pub mod splats;
pub mod split;
pub mod targets;
pub mod two_pass;
pub mod variant;
