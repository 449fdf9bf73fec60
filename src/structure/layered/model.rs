//! A model that a renderer streams.

use std::sync::Arc;

use super::Index;
use crate::error::Result;
use crate::select::layered::Rule;
use crate::stream::{Access, FetchOptions};
use crate::structure::Flat;
#[cfg(feature = "layered")]
use crate::structure::groups::Groups;

/// The samples of a node, decoded. All arrays have the same length, in the order of storage: those that lie in the region
/// of any descendant of the node are consecutive.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Patch {
    /// Centres relative to the index's origin \[world units\].
    pub positions: Vec<[f32; 3]>,
    /// Each sample's own covering radius, among all samples of the model \[world units\]; finite and > 0.
    pub radii: Vec<f32>,
    /// [`octahedral`](crate::structure::octahedral) codes.
    pub normals: Option<Vec<u32>>,
    /// sRGB bytes, red lowest, 255 on top.
    pub colors: Option<Vec<u32>>,
    /// Their [groups](crate::structure::groups).
    pub groups: Option<Vec<u8>>,
}

/// How a renderer streams a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Streaming {
    /// Device memory for patches, of which there is room for at least two; no more is taken than the whole model needs \[bytes\].
    pub cache: u64,
    /// Threads, requests, pauses.
    pub fetch: FetchOptions,
    /// What a frame asks for at most; the rest is forgotten, and asked for again while it is wanted \[bytes as stored\].
    pub wishes: u64,
    /// Samples drawn at most over all views: the threshold rises until there are no more.
    pub samples: Option<u64>,
    /// Which spacing decides.
    pub rule: Rule,
    /// A patch that has come is shown over so many frames more; 0: at once.
    pub ramp: u32,
    /// As [`Refine::fade`](crate::select::layered::Refine::fade).
    pub fade: f64,
    /// As [`Refine::prefetch`](crate::select::layered::Refine::prefetch).
    pub prefetch: f64,
    /// Patches behind what was visible are tested for being hidden, and then neither drawn nor refined nor fetched.
    pub occlusion: bool,
}

impl Default for Streaming {
    /// For moving cameras: 512 MiB, 8 MiB a frame, no limit of samples, patches come in over 6 frames and levels from 1 to 1.25 times
    /// the threshold, what is within a fifth of being wanted is fetched ahead, occlusion.
    fn default() -> Self {
        Streaming { ramp: 6, fade: 1.25, prefetch: 0.8, ..Streaming::STILL }
    }
}

impl Streaming {
    /// For pictures: the cut itself, as soon as it is there.
    pub const STILL: Streaming = Streaming {
        cache: 512 << 20,
        fetch: FetchOptions::DEFAULT,
        wishes: 8 << 20,
        samples: None,
        rule: Rule::Measured,
        ramp: 0,
        fade: 1.0,
        prefetch: 1.0,
        occlusion: true,
    };
}

/// A layered point cloud that is fetched as views need it.
#[derive(Debug, Clone)]
pub struct Layered {
    /// What is known of every patch.
    pub index: Arc<Index>,
    /// Where its bytes are.
    pub access: Arc<dyn Access>,
    /// How it is streamed.
    pub streaming: Streaming,
    /// No points: origin, bounds, and which attributes there are.
    pub flat: Flat,
    /// Without the entropy stage (`zstd`) there is no model.
    decode: fn(&Index, u32, &[u8]) -> Result<Patch>,
}

#[cfg(feature = "layered")]
impl Layered {
    /// Opens a model in a file or at an address, and reads its index.
    ///
    /// # Errors
    /// As [`stream::open`](crate::stream::open) and [`Index::read`].
    pub fn open(location: &str, streaming: Streaming) -> Result<Layered> {
        let access = crate::stream::open(location)?;
        Ok(Layered::new(Arc::new(Index::read(&*access)?), access, streaming))
    }

    /// Of an index that was read.
    pub fn new(index: Arc<Index>, access: Arc<dyn Access>, streaming: Streaming) -> Layered {
        let root = index.nodes.first();
        let around = |n: &super::Node| crate::structure::flat::Block {
            first: 0,
            count: 0,
            min: n.centre - glam::Vec3::splat(n.ball),
            max: n.centre + glam::Vec3::splat(n.ball),
            // Before a node is refined, its samples are as large as its spacing.
            radius: n.reach.max(n.spacing),
        };
        let flat = Flat {
            origin: index.origin,
            normals: index.normals.then(Vec::new),
            colors: index.colors.then(Vec::new),
            closed: index.closed,
            // Made for whole levels; where a cut has several, neighbours may share one.
            groups: index.groups.map(|count| Groups { count, overlapping: true, ..Groups::default() }),
            blocks: root.map(around).into_iter().collect(),
            ..Flat::default()
        };
        Layered { index, access, streaming, flat, decode: Patch::decode }
    }
}

impl Layered {
    /// As [`Patch::decode`].
    pub(crate) fn decode(&self, node: u32, bytes: &[u8]) -> Result<Patch> {
        (self.decode)(&self.index, node, bytes)
    }

    /// Most samples that a patch has.
    pub fn largest(&self) -> u32 {
        self.index.nodes.iter().map(|n| n.samples).max().unwrap_or(1)
    }
}
