//! Draw calls for everything a view shows: the same for every blend.

use ash::vk;

use crate::gpu::Context;
use crate::gpu::program::Program;
use crate::gpu::resource::Buffer;
use crate::stats::OrderedAccess;
use crate::structure::flat::{BLOCK, Block};

use super::cloud::{Chunk, DeviceCloud};
use super::variant::{Pipelines, Role, Variant};

/// Indices of one block of quads: 0 1 2, 2 1 3, then four on.
pub fn quad_indices() -> Vec<u16> {
    (0..BLOCK).flat_map(|q| [0, 1, 2, 2, 1, 3].map(|i| (4 * q + i) as u16)).collect()
}

/// One cloud in one view.
#[derive(Debug, Clone)]
pub struct Draw {
    /// Index into the renderer's clouds of this frame.
    pub cloud: usize,
    /// Byte offset of its parameters.
    pub params: u32,
    /// Variant for everything.
    pub main: Variant,
    /// Indices of blocks that may hold splats beyond a sprite, and the variant that draws those.
    pub large: Vec<u32>,
    /// Variant for those.
    pub large_variant: Variant,
}

/// What drawing needs besides the draws.
pub struct Bindings<'a> {
    /// Layouts.
    pub program: &'a Program,
    /// Pipelines, all built.
    pub pipelines: &'a Pipelines,
    /// Set 0: parameters, with a dynamic offset.
    pub params: vk::DescriptorSet,
    /// See [`quad_indices`]; there whenever quads are drawn.
    pub indices: Option<&'a Buffer>,
    /// The frame's clouds.
    pub clouds: &'a [&'a DeviceCloud],
}

impl Bindings<'_> {
    /// Records one role's draws of a view. Returns the number of draw calls.
    pub fn draw(&self, context: &Context, cmd: vk::CommandBuffer, role: Role, draws: &[Draw]) -> u32 {
        let mut calls = 0;
        for draw in draws {
            let cloud = self.clouds[draw.cloud];
            self.bind(context, cmd, draw.params, Variant { role, ..draw.main });
            for chunk in &cloud.chunks {
                calls += if draw.main.quads {
                    let blocks = (0..chunk.count).step_by(BLOCK).map(|at| (at, BLOCK.min((chunk.count - at) as usize)));
                    self.quads(context, cmd, chunk, blocks)
                } else {
                    points(context, cmd, chunk)
                };
            }
            if draw.large.is_empty() {
                continue;
            }
            self.bind(context, cmd, draw.params, Variant { role, ..draw.large_variant });
            for chunk in &cloud.chunks {
                let in_chunk = draw
                    .large
                    .iter()
                    .map(|b| &cloud.flat.blocks[*b as usize])
                    .filter(|b| (chunk.first..chunk.first + chunk.count).contains(&b.first))
                    .map(|b| (b.first - chunk.first, b.count as usize));
                calls += self.quads(context, cmd, chunk, in_chunk);
            }
        }
        calls
    }

    /// Binds what `fuzzy` reads and writes, for all draws of a pass.
    pub fn bind_ordered(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        access: OrderedAccess,
        set: vk::DescriptorSet,
    ) {
        let number = match access {
            OrderedAccess::RasterizationOrder => 3,
            OrderedAccess::Interlock => 4,
        };
        self.bind_set(context, cmd, number, set, &[]);
    }

    /// The same for blends that depend on the order: every cloud in stored order, whatever a sprite can hold. Returns the
    /// number of draw calls.
    pub fn draw_ordered(&self, context: &Context, cmd: vk::CommandBuffer, role: Role, draws: &[Draw]) -> u32 {
        let mut calls = 0;
        for draw in draws {
            let cloud = self.clouds[draw.cloud];
            for chunk in &cloud.chunks {
                let blocks = cloud.flat.blocks.iter().enumerate().map(|(i, b)| (i as u32, b));
                let in_chunk = blocks.filter(|(_, b)| (chunk.first..chunk.first + chunk.count).contains(&b.first));
                for (large, first, count) in runs(in_chunk.map(|(i, b)| (draw.large.binary_search(&i).is_ok(), b))) {
                    let variant = if large { draw.large_variant } else { draw.main };
                    self.bind(context, cmd, draw.params, Variant { role, ..variant });
                    calls += if variant.quads {
                        let end = first + count;
                        let blocks = (first..end).step_by(BLOCK).map(|at| (at, BLOCK.min((end - at) as usize)));
                        self.quads(context, cmd, chunk, blocks.map(|(at, n)| (at - chunk.first, n)))
                    } else {
                        context.bind_streams(cmd, &chunk.streams());
                        context.draw(cmd, first - chunk.first, count);
                        1
                    };
                }
            }
        }
        calls
    }

    fn bind(&self, context: &Context, cmd: vk::CommandBuffer, params: u32, variant: Variant) {
        context.bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.pipelines.get(&variant));
        self.bind_set(context, cmd, 0, self.params, &[params]);
        if let Some(indices) = self.indices.filter(|_| variant.quads) {
            context.bind_indices(cmd, indices.handle);
        }
    }

    fn bind_set(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        number: u32,
        set: vk::DescriptorSet,
        offsets: &[u32],
    ) {
        context.bind_sets(cmd, vk::PipelineBindPoint::GRAPHICS, self.program.layout, number, &[set], offsets);
    }

    fn quads(
        &self,
        context: &Context,
        cmd: vk::CommandBuffer,
        chunk: &Chunk,
        blocks: impl Iterator<Item = (u32, usize)>,
    ) -> u32 {
        let mut calls = 0;
        for (first, count) in blocks {
            if calls == 0 {
                self.bind_set(context, cmd, 1, chunk.set, &[]);
            }
            // A block has at most as many quads as there are indices, and its vertices lie in the chunk's buffers.
            context.draw_indexed(cmd, 6 * count as u32, 4 * first as i32);
            calls += 1;
        }
        calls
    }
}

/// Consecutive blocks of one kind as (kind, first point, number of points).
fn runs<'a>(blocks: impl Iterator<Item = (bool, &'a Block)>) -> Vec<(bool, u32, u32)> {
    let mut runs: Vec<(bool, u32, u32)> = Vec::new();
    for (kind, block) in blocks {
        match runs.last_mut() {
            Some((last, _, count)) if *last == kind => *count += block.count,
            _ => runs.push((kind, block.first, block.count)),
        }
    }
    runs
}

fn points(context: &Context, cmd: vk::CommandBuffer, chunk: &Chunk) -> u32 {
    context.bind_streams(cmd, &chunk.streams());
    context.draw(cmd, 0, chunk.count);
    1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_keep_the_order() {
        let blocks: Vec<Block> = (0..5)
            .map(|i| Block {
                first: 10 * i,
                count: 10 - i / 4,
                min: glam::Vec3::ZERO,
                max: glam::Vec3::ZERO,
                radius: 1.0,
            })
            .collect();
        let kinds = [false, false, true, false, false];
        let found = runs(kinds.into_iter().zip(&blocks));
        assert_eq!(found, [(false, 0, 20), (true, 20, 10), (false, 30, 19)]);
        assert_eq!(runs([].into_iter()), []);
    }

    #[test]
    fn a_block_of_quads_just_fits_sixteen_bit_indices() {
        let indices = quad_indices();
        assert_eq!(indices.len(), 6 * BLOCK);
        assert_eq!(indices[..12], [0, 1, 2, 2, 1, 3, 4, 5, 6, 6, 5, 7]);
        assert_eq!(*indices.last().unwrap() as usize, 4 * BLOCK - 1);
    }
}
