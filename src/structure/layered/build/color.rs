//! Groups of a model's samples, once all of its patches are there (Zhang, Pajarola: Single-Pass Point Rendering and Transparent
//! Shading, 2006, section 4.1, for levels of detail).
//!
//! Coarse to fine, each sample beside what is drawn with it in the coarsest cut that has it: radii only shrink further down, so
//! what was free stays free. Subtrees of at most [`PART`] samples are coloured as one, whatever there is of memory, so that the
//! same input makes the same bytes; those before it are known by the samples near its borders.
//!
//! # In pseudo-code
//! ```text
//! visit(node, region, near):                     near: coloured samples that may touch the region
//!     part = the node's whole subtree if that is small, else the node alone
//!     for each level of the part: colour its samples beside those of this and coarser levels, of `near` and of the part,
//!         each with the radius that it has in the cut of that level
//!     unless small: for each child: visit(child, its half, what of near, part and the other child touches it)
//!     return the samples near the region's borders
//! ```

use glam::Vec3;

use super::spool::{Folder, Spool, Writer};
use crate::error::Result;
use crate::par;
use crate::structure::Flat;
use crate::structure::file::Fnv;
use crate::structure::groups::{Groups, Relax};
use crate::structure::layered::patch::encode_groups;
use crate::structure::layered::{Index, Node, Patch};
use crate::structure::nodes::NONE;

/// Most samples that are coloured as one, unless a patch has more: some 25 MB.
const PART: u64 = 1 << 16;

/// Beyond its region a sample meets others that are up to three times as wide.
const WIDER: f32 = 3.0;

/// Groups of all samples, node by node.
pub(super) struct Colored {
    /// Compressed.
    pub spool: Spool<u8>,
    /// By node.
    pub frames: Vec<Frame>,
    /// How many there are.
    pub count: u32,
    /// Samples that share one with a sample that they should not.
    pub conflicts: u64,
}

/// The groups of one patch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Frame {
    pub at: u64,
    pub bytes: u32,
    /// Of the patch with them.
    pub checksum: u64,
}

/// A sample with its group.
#[derive(Debug, Clone, Copy)]
struct Known {
    position: [f32; 3],
    radius: f32,
    normal: u32,
    /// Its node.
    node: u32,
    group: u8,
}

/// What a node's cuts leave of space.
#[derive(Debug, Clone, Copy)]
struct Space {
    low: Vec3,
    high: Vec3,
}

impl Space {
    const ALL: Space = Space { low: Vec3::NEG_INFINITY, high: Vec3::INFINITY };

    fn half(mut self, node: &Node, side: usize) -> Space {
        let end = if side == 0 { &mut self.high } else { &mut self.low };
        end[node.split as usize] = node.plane;
        self
    }

    /// How far a place is from it, 0 inside.
    fn distance(&self, p: Vec3) -> f32 {
        (self.low - p).max(p - self.high).max(Vec3::ZERO).length()
    }

    /// How far a place inside is from its border.
    fn depth(&self, p: Vec3) -> f32 {
        (p - self.low).min(self.high - p).min_element()
    }
}

/// Colours all samples. `patches` has those of the index's nodes where these say.
pub(super) fn color(
    index: &Index,
    patches: &Spool<u8>,
    folder: &std::sync::Arc<Folder>,
    relax: &Relax,
    told: impl Fn(u64),
) -> Result<Colored> {
    let mut below: Vec<u64> = index.nodes.iter().map(|n| u64::from(n.samples)).collect();
    for i in (1..index.nodes.len()).rev() {
        below[index.nodes[i].parent as usize] += below[i];
    }
    let frames = vec![Frame::default(); index.nodes.len()];
    let to = folder.writer()?;
    let mut painter =
        Painter { index, patches, folder, relax, below, to, frames, count: 1, conflicts: 0, done: 0, told };
    painter.visit(0, Space::ALL, Vec::new())?;
    let Painter { to, frames, count, conflicts, .. } = painter;
    Ok(Colored { spool: to.finish()?, frames, count, conflicts })
}

struct Painter<'a, F> {
    index: &'a Index,
    patches: &'a Spool<u8>,
    folder: &'a Folder,
    relax: &'a Relax,
    /// Samples of each node and of all below it.
    below: Vec<u64>,
    to: Writer<u8>,
    frames: Vec<Frame>,
    count: u32,
    conflicts: u64,
    done: u64,
    told: F,
}

impl<F: Fn(u64)> Painter<'_, F> {
    fn visit(&mut self, node: u32, space: Space, near: Vec<Known>) -> Result<Vec<Known>> {
        let small = self.below[node as usize] <= PART;
        let part = if small { self.subtree(node) } else { vec![node] };
        let mut own = self.paint(&part, &near)?;
        if !small {
            let at = &self.index.nodes[node as usize];
            for (side, child) in at.children.into_iter().enumerate().filter(|(_, child)| *child != NONE) {
                let half = space.half(at, side);
                let touching = near.iter().chain(&own).filter(|k| half.distance(k.position.into()) < self.reach(k));
                let touching = touching.copied().collect();
                own.extend(self.visit(child, half, touching)?);
            }
        }
        own.retain(|k| space.depth(k.position.into()) < self.reach(k));
        Ok(own)
    }

    /// The nodes from this one down, level by level.
    fn subtree(&self, node: u32) -> Vec<u32> {
        let mut all = vec![node];
        let mut at = 0;
        while at < all.len() {
            all.extend(self.index.nodes[all[at] as usize].children());
            at += 1;
        }
        all
    }

    /// How far from a sample others may be that it must not share a group with.
    fn reach(&self, sample: &Known) -> f32 {
        (1.0 + WIDER) * self.relax.factor * radius(&self.index.nodes[sample.node as usize], sample.radius)
    }

    /// Colours the samples of some nodes, level by level, and writes their groups.
    fn paint(&mut self, part: &[u32], near: &[Known]) -> Result<Vec<Known>> {
        let mut bytes = Vec::with_capacity(part.len());
        for &i in part {
            let node = &self.index.nodes[i as usize];
            let mut patch = vec![0; node.bytes as usize];
            self.patches.read(node.at, &mut patch)?;
            bytes.push((i, patch));
        }
        let index = self.index;
        let mut own: Vec<Known> = Vec::new();
        for (&node, patch) in part.iter().zip(par::map(&bytes, |(i, bytes)| Patch::decode(index, *i, bytes))) {
            let Patch { positions, radii, normals, .. } = patch?;
            own.extend(positions.into_iter().zip(radii).enumerate().map(|(i, (position, radius))| {
                let normal = normals.as_ref().map_or(0, |normals| normals[i]);
                Known { position, radius, normal, node, group: 0 }
            }));
        }
        let nodes = &self.index.nodes;
        let all = || near.iter().chain(&own);
        let flat = Flat {
            geometry: all().map(|k| [k.position[0], k.position[1], k.position[2], k.radius]).collect(),
            normals: index.normals.then(|| all().map(|k| k.normal).collect()),
            ..Flat::default()
        };
        let levels: Vec<u8> = all().map(|k| nodes[k.node as usize].level).collect();
        let known: Vec<u8> = near.iter().map(|k| k.group).collect();
        // The deepest node at each sample, down to the step's level.
        let mut deepest: Vec<u32> = all().map(|k| k.node).collect();
        let radii = |level: u8| {
            let of = |(at, [x, y, z, own]): (&mut u32, &[f32; 4])| {
                *at = descend(nodes, *at, [*x, *y, *z], level);
                radius(&nodes[*at as usize], *own)
            };
            deepest.iter_mut().zip(&flat.geometry).map(of).collect()
        };
        let last = part.iter().map(|i| nodes[*i as usize].level).max().unwrap_or(0);
        let groups = Groups::by_level(&flat, &levels, nodes[part[0] as usize].level..=last, self.relax, &known, radii);
        let own_groups = &groups.of[near.len()..];
        own.iter_mut().zip(own_groups).for_each(|(k, group)| k.group = *group);
        self.count = self.count.max(groups.count);
        self.conflicts += groups.conflicts;
        let mut first = 0;
        for &i in part {
            let node = &nodes[i as usize];
            let frame =
                encode_groups(&own_groups[first..first + node.samples as usize]).map_err(|e| self.folder.fails(e))?;
            let mut hash = Fnv(node.checksum);
            hash.add(&frame);
            self.frames[i as usize] = Frame { at: self.to.count(), bytes: frame.len() as u32, checksum: hash.0 };
            self.to.push(&frame)?;
            first += node.samples as usize;
        }
        self.done += own.len() as u64;
        (self.told)(self.done);
        Ok(own)
    }
}

/// Of a sample in whose region this node is the deepest that is drawn.
fn radius(deepest: &Node, own: f32) -> f32 {
    if deepest.split > 2 { own } else { own.max(deepest.spacing) }
}

/// The deepest node at a place, from `at` down to a level.
fn descend(nodes: &[Node], mut at: u32, p: [f32; 3], level: u8) -> u32 {
    loop {
        let node = &nodes[at as usize];
        if node.split > 2 || node.level >= level {
            return at;
        }
        match node.children[(p[node.split as usize] >= node.plane) as usize] {
            NONE => return at,
            child => at = child,
        }
    }
}
