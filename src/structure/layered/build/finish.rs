//! From the samples of a node to its patch and its entry in the index, once all below it is known.

use glam::{DVec3, Vec3};

use super::region::{Cut, Region};
use super::spool::Writer;
use super::tree::Maker;
use crate::error::Result;
use crate::structure::file::Fnv;
use crate::structure::layered::Node;
use crate::structure::layered::patch::{self, Grid, Sample};
use crate::structure::morton::Cube;
use crate::structure::nodes::NONE;
use crate::structure::octahedral;

/// A node while it is made. Lengths in world units.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Draft {
    pub level: u8,
    pub centre: Vec3,
    /// Distance of the farthest sample below or in it.
    pub ball: f32,
    pub spacing: f32,
    pub most: f32,
    pub radius: f32,
    pub published: f32,
    pub total: f64,
    /// `None` for a leaf.
    pub cut: Option<Cut>,
}

/// A finished node with all below it.
pub(super) struct Grown {
    /// Without numbers of other nodes; `at` is where its patch is among those that were written.
    pub node: Node,
    pub children: [Option<Box<Grown>>; 2],
    /// Its patch, until it is written.
    patch: Vec<u8>,
    normals: DVec3,
    /// How far a sample below or in it was moved at most.
    error: f32,
    /// Radii of the ancestors' samples, until their nodes are finished.
    pub found: Vec<f32>,
}

impl Grown {
    /// The deepest node whose region has `p`, and the way to it: a bit a cut, highest first.
    fn deepest(&self, p: [f32; 3]) -> (&Grown, u128) {
        let (mut at, mut way) = (self, 0);
        for bit in (0..128).rev() {
            if at.node.split == 3 {
                break;
            }
            let side = (p[at.node.split as usize] >= at.node.plane) as usize;
            way |= (side as u128) << bit;
            let Some(child) = &at.children[side] else { break };
            at = child;
        }
        (at, way)
    }

    /// Writes the patches that are still in memory.
    pub fn flush(&mut self, to: &mut Writer<u8>) -> Result<()> {
        if !self.patch.is_empty() {
            self.node.at = to.count();
            to.push(&std::mem::take(&mut self.patch))?;
            for child in self.children.iter_mut().flatten() {
                child.flush(to)?;
            }
        }
        Ok(())
    }
}

impl Maker<'_> {
    /// Encodes the patch of a node whose children are finished.
    pub fn finish(
        &self,
        draft: Draft,
        own: Vec<Sample>,
        children: [Option<Box<Grown>>; 2],
        found: Vec<f32>,
    ) -> Result<Box<Grown>> {
        let below = || children.iter().flatten();
        // Nothing below is covered worse than the whole.
        let spacing = below().map(|c| c.node.spacing).fold(draft.spacing, f32::max);
        let node = Node {
            centre: draft.centre,
            ball: 0.0,
            reach: 0.0,
            axis: Vec3::Z,
            cone: -1.0,
            spacing: if spacing > 0.0 { spacing.clamp(f32::MIN_POSITIVE, f32::MAX) } else { 1.0 },
            published: draft.published.min(f32::MAX),
            split: draft.cut.map_or(3, |c| c.axis as u8),
            plane: draft.cut.map_or(0.0, |c| c.plane),
            children: [NONE; 2],
            parent: NONE,
            level: draft.level,
            samples: own.len() as u32,
            at: 0,
            bytes: 0,
            checksum: 0,
        };
        let mut grown = Box::new(Grown { node, children, patch: vec![], normals: DVec3::ZERO, error: 0.0, found });
        let own = self.patch(&mut grown, own)?;
        let below = || grown.children.iter().flatten();
        let reach = below().map(|c| c.node.reach).fold(0.0, f32::max);
        grown.node.reach = own.iter().map(|s| s.radius).fold(reach, f32::max);
        grown.error = below().map(|c| c.error).fold(grown.error, f32::max);
        // Rounded up: the distances are sums of f32.
        grown.node.ball = ((draft.ball as f64 * (1.0 + 1e-6) + grown.error as f64) as f32).min(f32::MAX);
        self.cone(&mut grown, &own);
        self.count(own.len());
        Ok(grown)
    }

    /// Orders and encodes the samples of a node; returns what decoding gives.
    fn patch(&self, grown: &mut Grown, mut own: Vec<Sample>) -> Result<Vec<Sample>> {
        for s in own.iter_mut().filter(|s| s.radius == 0.0) {
            s.radius = grown.deepest(s.position).0.node.spacing;
        }
        let exact = self.content.exact;
        // Nineteen in twenty are no smaller; a few that are crowded must not cost all others bits.
        let mut radii: Vec<f32> = own.iter().map(|s| s.radius).collect();
        let at = radii.len() / 20;
        let local = *radii.select_nth_unstable_by(at, f32::total_cmp).1;
        let error = if exact { 0.0 } else { self.options.precision * local };
        let grid = Grid::round(&own, error, self.content.lattice);
        let mut region = Region::EMPTY;
        own.iter().for_each(|s| region.add(s.position));
        let cube = Cube::round(region.low, region.high);
        // Where a sample is when it is decoded decides where it is stored: rounding may move it across a cut.
        let key = |s: &Sample| {
            let place = grid.place(grid.numbers(s.position));
            (grown.deepest(place).1, cube.code(place.into()))
        };
        own.sort_by_cached_key(key);
        grown.error = grid.error(region.low.abs().max(region.high.abs()).max_element());
        grown.patch = patch::encode(&mut own, &self.content, &grid).map_err(|e| self.folder.fails(e))?;
        let mut hash = Fnv::NEW;
        hash.add(&grown.patch);
        (grown.node.bytes, grown.node.checksum) = (grown.patch.len() as u32, hash.0);
        Ok(own)
    }

    /// The axis is the mean of all normals; children count with their own cones.
    fn cone(&self, grown: &mut Grown, own: &[Sample]) {
        if !self.content.normals {
            return;
        }
        let normals: Vec<Option<DVec3>> = own.iter().map(|s| octahedral::decode(s.normal)).collect();
        grown.normals = normals.iter().flatten().sum::<DVec3>();
        grown.normals += grown.children.iter().flatten().map(|c| c.normals).sum::<DVec3>();
        let axis = grown.normals.normalize_or(DVec3::Z).as_vec3();
        grown.node.axis = axis;
        let axis = axis.as_dvec3();
        // A splat without a normal faces everyone.
        let own = normals.iter().map(|n| n.map_or(-1.0, |n| n.dot(axis)));
        let below = grown.children.iter().flatten().map(|c| {
            let between = c.node.axis.as_dvec3().dot(axis).clamp(-1.0, 1.0).acos();
            let angle = between + (c.node.cone as f64).acos();
            if angle < std::f64::consts::PI { angle.cos() } else { -1.0 }
        });
        let cone = own.chain(below).fold(1.0, f64::min);
        // 10⁻⁶ is what rounding the axis to f32 turns it by, and more.
        grown.node.cone = (cone - 2e-6).max(-1.0) as f32;
    }
}
