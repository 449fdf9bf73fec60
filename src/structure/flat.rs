//! One array in stored order: what every point of a cloud costs on the device, and where blocks of it lie.

use glam::{DVec3, Vec3};

use super::packing::{Packed, Streams};
use super::{Groups, octahedral};
use crate::load::PointCloud;

/// Points a block. Blocks only bound what a frame may need (footprints beyond a sprite's limit), so a rough size does.
pub const BLOCK: usize = 1 << 14;

/// Coordinates beyond this are drawn nowhere: their squares would leave the range of floats.
const FARTHEST: f32 = 1e30;

/// A cloud as the device keeps it: 16 B of geometry a point, 4 B more for each of normal and colour, or less where it is
/// [packed](Flat::packed): then `geometry`, `normals` and `colors` are empty, and what asks point by point still gets the
/// same values as the device.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Flat {
    /// World position that the centres are relative to.
    pub origin: DVec3,
    /// Centre relative to `origin` (x, y, z) and covering radius (w) \[world units\].
    pub geometry: Vec<[f32; 4]>,
    /// [`octahedral`] codes; absent: all face the viewer.
    pub normals: Option<Vec<u32>>,
    /// sRGB bytes, red lowest, 255 on top; absent: all have the style's base colour.
    pub colors: Option<Vec<u32>>,
    /// Consecutive runs of [`BLOCK`] points, the last one shorter.
    pub blocks: Vec<Block>,
    /// See [`PointCloud::closed`].
    pub closed: bool,
    /// Groups of splats that do not overlap, a byte a point: for [`Blend::Groups`](crate::technique::Blend::Groups) alone.
    /// Absent until they are made ([`Groups::color`]) or loaded.
    pub groups: Option<Groups>,
    /// Largest radius of the points that stand for nothing but themselves; `None` where all do. The larger ones of a
    /// structure say nothing of where the surface is.
    pub finest: Option<f32>,
    /// The points of a packed cloud.
    pub packed: Option<Packed>,
}

/// Bounds of a run of points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Index of the first point.
    pub first: u32,
    /// Number of points, at least 1.
    pub count: u32,
    /// Corner of the box of the centres that can be drawn, relative to the origin; both corners 0 where none can.
    pub min: Vec3,
    /// Opposite corner.
    pub max: Vec3,
    /// Largest radius.
    pub radius: f32,
}

impl Block {
    /// Bounds of consecutive blocks together; of no point at all where there is none.
    pub fn around(blocks: &[Block]) -> Block {
        let mut all = Block { first: 0, count: 0, min: Vec3::INFINITY, max: Vec3::NEG_INFINITY, radius: 0.0 };
        all.first = blocks.first().map_or(0, |b| b.first);
        for block in blocks {
            all.count += block.count;
            // A block of nothing that can be drawn has no box.
            if block.radius > 0.0 {
                all.min = all.min.min(block.min);
                all.max = all.max.max(block.max);
                all.radius = all.radius.max(block.radius);
            }
        }
        if all.min.x > all.max.x {
            (all.min, all.max) = (Vec3::ZERO, Vec3::ZERO);
        }
        all
    }
}

impl Flat {
    /// The points of a cloud.
    ///
    /// Radii must be present (see `load::attributes`); at most 2³² − 1 points.
    pub fn new(cloud: &PointCloud) -> Flat {
        let radii = cloud.radii.as_ref().expect("radii are completed before a structure is built");
        // Devices may take subnormal numbers for 0, each stage as it likes: a radius that is not 0 must not become that.
        let radius = |r: f32| if r.is_subnormal() { f32::MIN_POSITIVE.copysign(r) } else { r };
        let geometry: Vec<[f32; 4]> =
            cloud.positions.iter().zip(radii).map(|(p, &r)| [p.x, p.y, p.z, radius(r)]).collect();
        Flat {
            origin: cloud.origin,
            blocks: blocks(geometry.len(), |i| geometry[i]),
            geometry,
            normals: cloud.normals.as_ref().map(|n| n.iter().map(|&n| octahedral::encode(n)).collect()),
            colors: cloud
                .colors
                .as_ref()
                .map(|c| c.iter().map(|&[r, g, b]| u32::from_le_bytes([r, g, b, 255])).collect()),
            closed: cloud.closed,
            groups: None,
            finest: None,
            packed: None,
        }
    }

    /// Bounds of the surface itself: the blocks, without what stands for others.
    pub fn surface(&self) -> impl Iterator<Item = Block> + '_ {
        let most = self.finest.unwrap_or(f32::INFINITY);
        self.blocks.iter().map(move |b| Block { radius: b.radius.min(most), ..*b })
    }

    /// Two opposite corners of the centres' box, relative to the origin; both 0 without points.
    pub fn bounds(&self) -> [DVec3; 2] {
        let all = Block::around(&self.blocks);
        [all.min.as_dvec3(), all.max.as_dvec3()]
    }

    /// Centre of a point, relative to the origin.
    pub fn position(&self, i: u32) -> Vec3 {
        let [x, y, z, _] = self.point(i);
        Vec3::new(x, y, z)
    }

    /// Centre of a point relative to the origin, and its radius.
    pub fn point(&self, i: u32) -> [f32; 4] {
        self.packed.as_ref().map_or_else(|| self.geometry[i as usize], |packed| packed.point(i as usize))
    }

    /// [`octahedral`] code of a point's normal, [`octahedral::NONE`] without.
    pub fn normal(&self, i: u32) -> u32 {
        let i = i as usize;
        match (&self.packed, &self.normals) {
            (Some(packed), _) => packed.normal(i),
            (None, Some(normals)) => normals[i],
            (None, None) => octahedral::NONE,
        }
    }

    /// sRGB bytes of a point, if the cloud has colours.
    pub fn color(&self, i: u32) -> Option<[u8; 3]> {
        let i = i as usize;
        let bytes = |colors: &Vec<u32>| colors[i].to_le_bytes();
        self.packed
            .as_ref()
            .map_or_else(|| self.colors.as_ref().map(bytes).map(|[r, g, b, _]| [r, g, b]), |packed| packed.color(i))
    }

    /// Whether any point may have a normal.
    pub fn has_normals(&self) -> bool {
        self.packed.as_ref().map_or(self.normals.is_some(), Packed::has_normals)
    }

    /// Whether the points have colours.
    pub fn has_colors(&self) -> bool {
        self.packed.as_ref().map_or(self.colors.is_some(), Packed::has_colors)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.packed.as_ref().map_or(self.geometry.len(), Packed::len)
    }

    /// Whether there is no point at all.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes that the arrays take, here and on the device.
    pub fn bytes(&self) -> u64 {
        let Streams { geometry, normals, colors, frames } = self.streams(0..self.len());
        let groups = self.groups.as_ref().map(|groups| &groups.of[..]);
        [Some(geometry), normals, colors, frames, groups].into_iter().flatten().map(|s| s.len() as u64).sum()
    }
}

/// Whether a point can be drawn from anywhere: a place that is a number, and not too far, and a radius.
pub(super) fn is_splat(&[x, y, z, r]: &[f32; 4]) -> bool {
    [x, y, z].iter().all(|v| v.abs() < FARTHEST) && r > 0.0 && r.is_finite()
}

/// Bounds of every run of [`BLOCK`] of `len` points.
pub(super) fn blocks(len: usize, point: impl Fn(usize) -> [f32; 4]) -> Vec<Block> {
    (0..len)
        .step_by(BLOCK)
        .map(|first| {
            let count = BLOCK.min(len - first);
            let mut block = Block {
                first: first as u32,
                count: count as u32,
                min: Vec3::INFINITY,
                max: Vec3::NEG_INFINITY,
                radius: 0.0,
            };
            // What is drawn nowhere must not make the bounds useless.
            for [x, y, z, r] in (first..first + count).map(&point).filter(is_splat) {
                let p = Vec3::new(x, y, z);
                block.min = block.min.min(p);
                block.max = block.max.max(p);
                block.radius = block.radius.max(r);
            }
            if block.min.x > block.max.x {
                (block.min, block.max) = (Vec3::ZERO, Vec3::ZERO);
            }
            block
        })
        .collect()
}
