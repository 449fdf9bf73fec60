//! The bare rate of a device: points of one size, transformed once and blended additively into the format of the sums.
//! What every technique's rate is measured against.

use ash::vk;
use bytemuck::{Pod, Zeroable};
use glam::Mat4;

use super::device::Standalone;
use super::held::Held;
use crate::draw::targets::SUMS;
use crate::error::Result;
use crate::gpu::barrier::Access;
use crate::gpu::pass::{Attachment, Recorder, Targets, Use};
use crate::gpu::program::{BlendMode, ColorTarget, GraphicsInfo, Stream};
use crate::gpu::spirv::generated as spirv;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Push {
    clip_from_cloud: [[f32; 4]; 4],
    size: f32,
}
const _: () = assert!(std::mem::offset_of!(Push, size) == spirv::bare_push::SIZE);

/// Draws `points` (x, y, z, any) as squares of `size` px into a picture of `extent`, `frames` times after one to warm
/// up. Returns the device's time of each frame \[ms\], from timestamps; empty where the device has none.
///
/// `clip_from_cloud` must keep all points in front of the eye; at least one, at most what one buffer holds.
pub fn measure(
    standalone: &Standalone,
    points: &[[f32; 4]],
    clip_from_cloud: Mat4,
    size: f32,
    extent: vk::Extent2D,
    frames: usize,
) -> Result<Vec<f64>> {
    let mut held = Held::new(standalone)?;
    let buffer = held.buffer("bare.points", bytemuck::cast_slice(points), vk::BufferUsageFlags::VERTEX_BUFFER)?;
    let image = held.image("bare.sums", SUMS, extent, vk::ImageUsageFlags::COLOR_ATTACHMENT)?;
    let layout = held.program("bare", &[&spirv::BENCH_BARE_VERT, &spirv::BENCH_BARE_FRAG], size_of::<Push>())?.layout;
    let pipeline = held.pipeline(&GraphicsInfo {
        name: "bare",
        vertex: &spirv::BENCH_BARE_VERT,
        fragment: &spirv::BENCH_BARE_FRAG,
        constants: &[],
        streams: &[Stream { stride: 16, format: vk::Format::R32G32B32A32_SFLOAT }],
        topology: vk::PrimitiveTopology::POINT_LIST,
        colors: &[ColorTarget { format: SUMS, blend: BlendMode::Add }],
        depth: None,
        samples: vk::SampleCountFlags::TYPE_1,
        view_mask: 0,
        render_pass: None,
        ordered: false,
    })?;
    let push = Push { clip_from_cloud: clip_from_cloud.to_cols_array_2d(), size };
    let mut times = Vec::new();
    for frame in 0..=frames {
        let Held { context, timestamps, images, buffers, cmd, .. } = &mut held;
        let Some(timestamps) = timestamps else { break };
        standalone.run(*cmd, |cmd| {
            timestamps.reset(context, cmd);
            let target = [Attachment { view: images[image].layers[0], clear: Some([0.0; 4]) }];
            let uses = vec![Use::Discard(&mut images[image], Access::ColorWrite)];
            let targets = Targets { colors: &target, depth: None, extent, layers: 1 };
            Recorder::new(context, cmd, Some(timestamps)).draw("bare", uses, &targets, |context, cmd| {
                context.bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
                context.push(cmd, layout, vk::ShaderStageFlags::VERTEX, bytemuck::bytes_of(&push));
                context.bind_streams(cmd, &[buffers[buffer].handle]);
                context.draw(cmd, 0, points.len() as u32);
            });
            Ok(())
        })?;
        if frame > 0 {
            times.extend(timestamps.read(context)?.iter().map(|(_, ms)| *ms));
        }
    }
    Ok(times)
}
