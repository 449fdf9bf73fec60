//! A cloud in whichever structure: one array of points, and what says which of them a view needs.

use std::sync::Arc;

use super::flat::Block;
use super::hybrid::Triangles;
use super::layered::Layered;
use super::nodes::ErrorRule;
use super::octree::Preset;
use super::{Flat, Hybrid, Nodes, Octree, Packing, Sequential};
use crate::technique::Structure;

/// What a renderer takes in. Cheap to copy.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Cloud {
    /// Every point is drawn, in stored order.
    Flat(Arc<Flat>),
    /// Whole levels of blocks.
    Octree(Arc<Octree>),
    /// Entries tested point by point.
    Sequential(Arc<Sequential>),
    /// The same, with the faces that are drawn where they are large enough.
    Hybrid(Arc<Hybrid>),
    /// Patches of a model on disk or behind a server: a renderer fetches them as views need them.
    Layered(Arc<Layered>),
}

impl Cloud {
    /// All points that any view may need, in stored order. Of a layered point cloud no points, but bounds and attributes.
    pub fn flat(&self) -> &Flat {
        match self {
            Cloud::Flat(flat) => flat,
            Cloud::Octree(octree) => &octree.flat,
            Cloud::Sequential(tree) => &tree.flat,
            Cloud::Hybrid(hybrid) => &hybrid.tree.flat,
            Cloud::Layered(model) => &model.flat,
        }
    }

    /// What is tested point by point, if anything is.
    pub fn nodes(&self) -> Option<&Nodes> {
        match self {
            Cloud::Flat(_) | Cloud::Octree(_) | Cloud::Layered(_) => None,
            Cloud::Sequential(tree) => Some(&tree.nodes),
            Cloud::Hybrid(hybrid) => Some(&hybrid.tree.nodes),
        }
    }

    /// Faces that are drawn besides points.
    pub fn triangles(&self) -> Option<&Triangles> {
        match self {
            Cloud::Flat(_) | Cloud::Octree(_) | Cloud::Sequential(_) | Cloud::Layered(_) => None,
            Cloud::Hybrid(hybrid) => Some(&hybrid.triangles),
        }
    }

    /// Bounds of the surface itself: see [`Flat::surface`]; faces included.
    pub fn surface(&self) -> impl Iterator<Item = Block> + '_ {
        self.flat().surface().chain(self.triangles().into_iter().flat_map(|t| t.blocks.iter().copied()))
    }

    /// The model that patches come from.
    pub fn layered(&self) -> Option<&Arc<Layered>> {
        match self {
            Cloud::Layered(model) => Some(model),
            _ => None,
        }
    }

    /// Points of the input.
    pub fn points(&self) -> usize {
        match self {
            Cloud::Flat(flat) => flat.len(),
            Cloud::Octree(octree) => octree.points as usize,
            Cloud::Sequential(tree) => tree.leaves as usize,
            Cloud::Hybrid(hybrid) => hybrid.tree.leaves as usize,
            Cloud::Layered(model) => model.index.nodes.iter().map(|n| n.samples as usize).sum(),
        }
    }

    /// Bytes of all that a view needs, here and on the device. Of a layered point cloud the index alone.
    pub fn bytes(&self) -> u64 {
        match self {
            Cloud::Flat(flat) => flat.bytes(),
            Cloud::Octree(octree) => octree.bytes(),
            Cloud::Sequential(tree) => tree.bytes(),
            Cloud::Hybrid(hybrid) => hybrid.bytes(),
            Cloud::Layered(model) => size_of_val(&model.index.nodes[..]) as u64,
        }
    }

    /// The same cloud in fewer bytes, or more. Takes as much memory again for a while; an [`Arc`] that is held elsewhere is
    /// copied. Layered point clouds are not: their patches are kept as they are.
    pub fn packed(self, packing: Packing) -> Cloud {
        if packing == self.flat().packing() {
            return self;
        }
        match self {
            Cloud::Flat(flat) => Cloud::Flat(Arc::new(Arc::unwrap_or_clone(flat).packed(packing))),
            Cloud::Octree(octree) => Cloud::Octree(Arc::new(Arc::unwrap_or_clone(octree).packed(packing))),
            Cloud::Sequential(tree) => Cloud::Sequential(Arc::new(Arc::unwrap_or_clone(tree).packed(packing))),
            Cloud::Hybrid(hybrid) => Cloud::Hybrid(Arc::new(Arc::unwrap_or_clone(hybrid).packed(packing))),
            Cloud::Layered(model) => Cloud::Layered(model),
        }
    }

    /// The value on the axis of structures.
    pub fn structure(&self) -> Structure {
        match self {
            Cloud::Flat(_) => Structure::Flat,
            Cloud::Octree(octree) => match octree.preset {
                Preset::VboR => Structure::VboR,
                Preset::Espt => Structure::Espt,
                Preset::Mospt => Structure::Mospt,
                Preset::RGrid => Structure::RGrid,
                Preset::Poisson => Structure::Poisson,
            },
            Cloud::Sequential(tree) => match (tree.options.rule, tree.options.blocks) {
                (ErrorRule::Cell, 0) => Structure::OneSpt,
                (ErrorRule::Cell, _) => Structure::SptR,
                _ => Structure::Sequential,
            },
            Cloud::Hybrid(_) => Structure::Hybrid,
            Cloud::Layered(_) => Structure::Layered,
        }
    }
}

impl From<Arc<Flat>> for Cloud {
    fn from(flat: Arc<Flat>) -> Cloud {
        Cloud::Flat(flat)
    }
}

impl From<Flat> for Cloud {
    fn from(flat: Flat) -> Cloud {
        Cloud::Flat(Arc::new(flat))
    }
}

impl From<Arc<Octree>> for Cloud {
    fn from(octree: Arc<Octree>) -> Cloud {
        Cloud::Octree(octree)
    }
}

impl From<Arc<Sequential>> for Cloud {
    fn from(tree: Arc<Sequential>) -> Cloud {
        Cloud::Sequential(tree)
    }
}

impl From<Arc<Hybrid>> for Cloud {
    fn from(hybrid: Arc<Hybrid>) -> Cloud {
        Cloud::Hybrid(hybrid)
    }
}

impl From<Layered> for Cloud {
    fn from(model: Layered) -> Cloud {
        Cloud::Layered(Arc::new(model))
    }
}
