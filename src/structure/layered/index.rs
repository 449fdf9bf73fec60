//! What is known of every patch without its samples.

use glam::{DVec3, Vec3};

use crate::structure::nodes::NONE;

/// The tree of a model: small enough to be kept whole, whatever the size of its samples.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Index {
    /// World position that all coordinates are relative to.
    pub origin: DVec3,
    /// In the order of the repository: by level, then by the Morton code of the ball's centre. The root is the first.
    pub nodes: Vec<Node>,
    /// Whether patches have normals.
    pub normals: bool,
    /// Whether patches have colours.
    pub colors: bool,
    /// See [`PointCloud::closed`](crate::load::PointCloud::closed).
    pub closed: bool,
    /// Which way is up, where the input said so.
    pub up: Option<Vec3>,
    /// Whether patches hold every attribute as it was given.
    pub exact: bool,
    /// Steps that coordinates are whole multiples of along x, y and z, where an exact model came from integers \[world
    /// units\].
    pub lattice: Option<DVec3>,
    /// Number of groups that patches tell the samples' of, for [`Blend::Groups`](crate::technique::Blend::Groups); 1 to 256.
    pub groups: Option<u32>,
    /// The file's path or address, for messages.
    pub name: String,
}

/// A patch, without its samples. Lengths are world units, relative to the index's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Centre of a ball around the centres of all samples of the node and its descendants.
    pub centre: Vec3,
    /// Radius of that ball.
    pub ball: f32,
    /// Largest covering radius of a sample, of the node's and its descendants' own.
    pub reach: f32,
    /// Axis of a cone around all their normals, unit; any where `cone` is −1.
    pub axis: Vec3,
    /// Cosine of the angle between the axis and the farthest normal, rounded down; −1 where there is no bound.
    pub cone: f32,
    /// Covering radius of what is drawn in this node's region when it is the deepest drawn there: its samples and those of
    /// its ancestors. As measured; never larger than the parent's.
    pub spacing: f32,
    /// The same by equations 1 and 2 of the paper, from counts alone.
    pub published: f32,
    /// Axis along which the region was cut in two, 0 to 2; 3 for a leaf.
    pub split: u8,
    /// Where: samples with a coordinate below it belong to the first child.
    pub plane: f32,
    /// Numbers of the two children; [`NONE`]: there is none.
    pub children: [u32; 2],
    /// Number of the parent; [`NONE`] for the root.
    pub parent: u32,
    /// Depth, 0 for the root.
    pub level: u8,
    /// Number of samples.
    pub samples: u32,
    /// Where its patch lies in the file.
    pub at: u64,
    /// Bytes of its patch in the file.
    pub bytes: u32,
    /// Checksum of those bytes.
    pub checksum: u64,
}

impl Node {
    /// Children that there are.
    pub fn children(&self) -> impl Iterator<Item = u32> {
        self.children.into_iter().filter(|c| *c != NONE)
    }
}
