//! The bare rate of a device: points of one size, transformed once and blended additively into the format of the sums.
//! What every technique's rate is measured against.

use ash::vk;
use bytemuck::{Pod, Zeroable};
use glam::Mat4;

use super::device::Standalone;
use crate::draw::targets::SUMS;
use crate::error::Result;
use crate::gpu::barrier::Access;
use crate::gpu::memory::Location;
use crate::gpu::pass::{Attachment, Recorder, Targets, Use};
use crate::gpu::program::{BlendMode, ColorTarget, GraphicsInfo, Program, Stream};
use crate::gpu::query::Timestamps;
use crate::gpu::resource::{Buffer, Image};
use crate::gpu::spirv::generated as spirv;
use crate::gpu::upload::Upload;

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
/// `clip_from_cloud` must keep all points in front of the eye; at most what one buffer holds.
pub fn measure(
    standalone: &Standalone,
    points: &[[f32; 4]],
    clip_from_cloud: Mat4,
    size: f32,
    extent: vk::Extent2D,
    frames: usize,
) -> Result<Vec<f64>> {
    let mut context = standalone.context();
    let Some(mut timestamps) = Timestamps::new(&context)? else { return Ok(Vec::new()) };
    let data: &[u8] = bytemuck::cast_slice(points);
    let usage = vk::BufferUsageFlags::VERTEX_BUFFER | vk::BufferUsageFlags::TRANSFER_DST;
    let buffer = Buffer::new(&mut context, "bare.points", data.len() as u64, usage, Location::Device)?;
    let mut upload = Upload::new(&mut context, data.len() as u64)?;
    upload.write(&buffer, data);
    let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT;
    let mut image = Image::new(&mut context, "bare.sums", SUMS, extent, 1, usage)?;
    let push_range =
        vk::PushConstantRange { stage_flags: vk::ShaderStageFlags::VERTEX, offset: 0, size: size_of::<Push>() as u32 };
    let shaders = &[&spirv::BENCH_BARE_VERT, &spirv::BENCH_BARE_FRAG];
    let program = Program::new(&context, "bare", shaders, false, Some(push_range))?;
    let pipeline = program.graphics(
        &context,
        &GraphicsInfo {
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
        },
    )?;
    let cmd = standalone.command_buffer()?;
    let push = Push { clip_from_cloud: clip_from_cloud.to_cols_array_2d(), size };
    let mut times = Vec::new();
    for frame in 0..=frames {
        standalone.run(cmd, |cmd| {
            timestamps.reset(&context, cmd);
            if frame == 0 {
                upload.record(&context, cmd);
            }
            let target = [Attachment { view: image.layers[0], clear: Some([0.0; 4]) }];
            let uses =
                vec![Use::Discard(&mut image, Access::ColorWrite), Use::Memory(Access::CopyWrite, Access::VertexRead)];
            let targets = Targets { colors: &target, depth: None, extent };
            let mut recorder = Recorder::new(&context, cmd, Some(&mut timestamps));
            recorder.draw("bare", uses, &targets, |context, cmd| {
                // SAFETY: recording inside a pass that the pipeline was made for; the buffer holds all points.
                unsafe {
                    let device = &context.device;
                    device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
                    device.cmd_push_constants(
                        cmd,
                        program.layout,
                        vk::ShaderStageFlags::VERTEX,
                        0,
                        bytemuck::bytes_of(&push),
                    );
                    device.cmd_bind_vertex_buffers(cmd, 0, &[buffer.handle], &[0]);
                    device.cmd_draw(cmd, points.len() as u32, 1, 0, 0);
                }
            });
            Ok(())
        })?;
        if frame > 0 {
            times.extend(timestamps.read(&context)?.iter().map(|(_, ms)| *ms));
        }
    }
    context.destroy_pipeline(pipeline);
    program.destroy(&context);
    image.destroy(&mut context);
    upload.staging.destroy(&mut context);
    buffer.destroy(&mut context);
    timestamps.destroy(&context);
    Ok(times)
}
