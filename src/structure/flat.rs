//! One array in stored order: what every point of a cloud costs on the device, and where blocks of it lie.

use glam::{DVec3, Vec3};

use super::{Groups, octahedral};
use crate::load::PointCloud;

/// Points a block. Blocks only bound what a frame may need (footprints beyond a sprite's limit), so a rough size does.
pub const BLOCK: usize = 1 << 14;

/// Coordinates beyond this are drawn nowhere: their squares would leave the range of floats.
const FARTHEST: f32 = 1e30;

/// A cloud as the device keeps it: 16 B of geometry a point, 4 B more for each of normal and colour.
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
    /// Packs a cloud.
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
            blocks: blocks(&geometry),
            geometry,
            normals: cloud.normals.as_ref().map(|n| n.iter().map(|&n| octahedral::encode(n)).collect()),
            colors: cloud
                .colors
                .as_ref()
                .map(|c| c.iter().map(|&[r, g, b]| u32::from_le_bytes([r, g, b, 255])).collect()),
            closed: cloud.closed,
            groups: None,
            finest: None,
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
        let [x, y, z, _] = self.geometry[i as usize];
        Vec3::new(x, y, z)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.geometry.len()
    }

    /// Whether there is no point at all.
    pub fn is_empty(&self) -> bool {
        self.geometry.is_empty()
    }

    /// Bytes that the arrays take, here and on the device.
    pub fn bytes(&self) -> u64 {
        let n = self.len() as u64;
        let [normals, colors, groups] = [self.normals.is_some(), self.colors.is_some(), self.groups.is_some()];
        n * (16 + 4 * normals as u64 + 4 * colors as u64 + groups as u64)
    }
}

/// Bounds of every run of [`BLOCK`] points.
pub(super) fn blocks(geometry: &[[f32; 4]]) -> Vec<Block> {
    geometry
        .chunks(BLOCK)
        .enumerate()
        .map(|(i, run)| {
            let mut block = Block {
                first: (i * BLOCK) as u32,
                count: run.len() as u32,
                min: Vec3::INFINITY,
                max: Vec3::NEG_INFINITY,
                radius: 0.0,
            };
            // What is drawn nowhere must not make the bounds useless.
            let drawn = |[x, y, z, r]: &&[f32; 4]| {
                Vec3::new(*x, *y, *z).abs().max_element() < FARTHEST && *r > 0.0 && r.is_finite()
            };
            for &[x, y, z, r] in run.iter().filter(drawn) {
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
