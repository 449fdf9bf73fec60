//! Groups of splats without self-overlap (Zhang, Pajarola: Single-Pass Point Rendering and Transparent Shading, 2006,
//! section 4.1).

/// When two splats that overlap may still share a group.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relax {
    /// c in |p_i − p_j| < c (r_i + r_j), 0 to 1: 1 allows no overlap.
    pub factor: f32,
    /// Splats of one plane and one colour may overlap.
    pub coplanar: bool,
    /// Splats whose normals point against each other may overlap.
    pub opposing: bool,
    /// Most groups that are made, 1 to 256. Where that is not enough, splats join the group that they overlap least, and
    /// are counted.
    pub limit: u32,
}

/// Which group each point of a cloud is in.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Groups {
    /// The group of every point, below `count`.
    pub of: Vec<u8>,
    /// K, at least 1 where there are points.
    pub count: u32,
    /// Splats of one group may overlap: relaxed, or the limit was not enough.
    pub overlapping: bool,
}
