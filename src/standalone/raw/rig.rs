//! Draws cases: what they share is made once.

use std::collections::HashMap;

use ash::vk;
use bytemuck::{Pod, Zeroable};

use super::case::{Case, Color, Passes, Vertices};
use super::{Setup, scene};
use crate::error::{Error, Result};
use crate::gpu::barrier::Access;
use crate::gpu::download::Download;
use crate::gpu::pass::{Attachment, DepthAttachment, Recorder, Targets, Use};
use crate::gpu::program::{ColorTarget, DepthMode, GraphicsInfo, Stream};
use crate::gpu::resource::Image;
use crate::gpu::spirv::{Shader, generated as spirv};
use crate::standalone::device::Standalone;
use crate::standalone::held::Held;
use crate::technique::Primitive;

/// Quads whose vertices 16-bit indices reach: as many as the library draws at once.
const CHUNK: u32 = 1 << 14;

const COLORS: [&Shader; 4] =
    [&spirv::BENCH_RAW1_FRAG, &spirv::BENCH_RAW2_FRAG, &spirv::BENCH_RAW3_FRAG, &spirv::BENCH_RAW4_FRAG];

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Push {
    clip_from_cloud: [[f32; 4]; 4],
    half_size: [f32; 2],
    places: [u32; 2],
    size: f32,
}
const _: () = assert!(
    std::mem::offset_of!(Push, half_size) == spirv::raw_push::HALF_SIZE
        && std::mem::offset_of!(Push, places) == spirv::raw_push::PLACES
        && std::mem::offset_of!(Push, size) == spirv::raw_push::SIZE
);

/// A case with all that drawing it needs: numbers of what the rig holds.
pub struct Ready {
    case: Case,
    points: u32,
    push: Push,
    /// One a pass, in order.
    pipelines: Vec<vk::Pipeline>,
    stream: Option<usize>,
    colors: Vec<usize>,
    depth: Option<usize>,
}

/// What all cases share.
pub struct Rig<'a> {
    held: Held<'a>,
    setup: Setup,
    layout: vk::PipelineLayout,
    set: vk::DescriptorSet,
    indices: usize,
    pulled: usize,
    streams: HashMap<Vertices, usize>,
    colors: HashMap<(Color, u32), usize>,
    depths: HashMap<vk::Format, usize>,
}

impl<'a> Rig<'a> {
    pub fn new(standalone: &'a Standalone, setup: &Setup) -> Result<Rig<'a>> {
        let mut held = Held::new(standalone)?;
        let vertex = [
            &spirv::BENCH_RAW_POINT_VERT,
            &spirv::BENCH_RAW_PULLED_VERT,
            &spirv::BENCH_RAW_COMPUTED_VERT,
            &spirv::BENCH_RAW_QUAD_VERT,
        ];
        let mut shaders = vec![&spirv::BENCH_RAW_DEPTH_FRAG];
        shaders.extend(vertex);
        shaders.extend(COLORS);
        let program = held.program("raw", &shaders, size_of::<Push>())?;
        let (layout, sets) = (program.layout, program.sets.clone());
        let quads = setup.points.min(CHUNK);
        let corners: Vec<u16> =
            (0..quads * 4).step_by(4).flat_map(|v| [0, 1, 2, 2, 1, 3].map(|k| (v + k) as u16)).collect();
        let indices = held.buffer("raw.indices", bytemuck::cast_slice(&corners), vk::BufferUsageFlags::INDEX_BUFFER)?;
        let positions = scene::vertices(Vertices::Pulled, setup.points, setup.extent);
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::VERTEX_BUFFER;
        let pulled = held.buffer("raw.points", &positions, usage)?;
        let size = vk::DescriptorPoolSize { ty: vk::DescriptorType::STORAGE_BUFFER, descriptor_count: 1 };
        held.pool = held.context.descriptor_pool("raw", 1, &[size])?;
        let set = held.context.descriptor_sets(held.pool, &sets)?[0];
        if positions.len() as u64 <= held.context.limits.max_storage_buffer_range as u64 {
            let whole = [vk::DescriptorBufferInfo::default().buffer(held.buffers[pulled].handle).range(vk::WHOLE_SIZE)];
            held.context.write_sets(&[vk::WriteDescriptorSet::default()
                .dst_set(set)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .buffer_info(&whole)]);
        }
        let streams = HashMap::from([(Vertices::F32x4, pulled)]);
        let (colors, depths) = Default::default();
        Ok(Rig { held, setup: *setup, layout, set, indices, pulled, streams, colors, depths })
    }

    /// What the device lacks for a case, if anything.
    pub fn lacks(&self, case: &Case) -> Option<String> {
        let limits = &self.held.context.limits;
        let size = case.size as f32;
        if case.primitive == Primitive::Point && size > 1.0 {
            if !self.held.context.enabled.large_points {
                return Some("largePoints".into());
            }
            if size > limits.point_size_range[1] {
                return Some(format!("points of {size} px: it has up to {}", limits.point_size_range[1]));
            }
        }
        let pulls = case.primitive == Primitive::Quad || case.vertices == Vertices::Pulled;
        let bytes = self.held.buffers[self.pulled].size;
        if pulls && bytes > limits.max_storage_buffer_range as u64 {
            return Some(format!("storage buffers of {bytes} bytes: it has up to {}", limits.max_storage_buffer_range));
        }
        if case.attachments > limits.max_color_attachments.min(limits.max_fragment_output_attachments) {
            return Some(format!("{} colour attachments", case.attachments));
        }
        if case.attachments == 0 {
            return None;
        }
        let standalone = self.held.standalone;
        // SAFETY: the physical device belongs to the instance, and both live.
        let has = unsafe {
            standalone.instance.get_physical_device_format_properties(standalone.physical_device, case.color.format())
        };
        let mut needed = vk::FormatFeatureFlags::COLOR_ATTACHMENT | vk::FormatFeatureFlags::TRANSFER_SRC;
        if case.blend {
            needed |= vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND;
        }
        (!has.optimal_tiling_features.contains(needed))
            .then(|| format!("{}{}", if case.blend { "blending in " } else { "" }, case.color.name()))
    }

    /// Makes what a case needs and the rig has not. The device lacks nothing for it.
    pub fn ready(&mut self, case: &Case) -> Result<Ready> {
        let quads = case.primitive == Primitive::Quad;
        assert!(!quads || case.vertices == Vertices::Pulled, "quads are pulled");
        assert!((1..=scene::LARGEST).contains(&case.size), "a size between 1 and {}", scene::LARGEST);
        assert_eq!(case.attachments == 0, case.passes == Passes::Depth, "colours, or depth alone");
        let extent = extent(&self.setup);
        let stream = match case.vertices {
            _ if case.vertices.stream().is_none() => None,
            format => Some(match self.streams.get(&format) {
                Some(there) => *there,
                None => {
                    let data = scene::vertices(format, self.setup.points, self.setup.extent);
                    let made = self.held.buffer("raw.stream", &data, vk::BufferUsageFlags::VERTEX_BUFFER)?;
                    self.streams.insert(format, made);
                    made
                }
            }),
        };
        let mut colors = Vec::new();
        for i in 0..case.attachments {
            let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::TRANSFER_SRC;
            colors.push(match self.colors.get(&(case.color, i)) {
                Some(there) => *there,
                None => {
                    let made = self.held.image("raw.color", case.color.format(), extent, usage)?;
                    self.colors.insert((case.color, i), made);
                    made
                }
            });
        }
        let depth = match case.depth_format() {
            None => None,
            Some(format) => Some(match self.depths.get(&format) {
                Some(there) => *there,
                None => {
                    let usage = vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT | vk::ImageUsageFlags::TRANSFER_SRC;
                    let made = self.held.image("raw.depth", format, extent, usage)?;
                    self.depths.insert(format, made);
                    made
                }
            }),
        };
        let pipelines = self.pipelines(case)?;
        let [width, height] = self.setup.extent.map(|side| side as f32);
        let size = case.size as f32;
        // From fractions of 65535 to the centres of squares whose corners they are [px], then to clip coordinates.
        let scale = [65535.0 * 2.0 / width, 65535.0 * 2.0 / height];
        let half_size = [size / width, size / height];
        let push = Push {
            clip_from_cloud: [
                [scale[0], 0.0, 0.0, 0.0],
                [0.0, scale[1], 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
                [half_size[0] - 1.0, half_size[1] - 1.0, 0.0, 1.0],
            ],
            half_size,
            places: scene::places(self.setup.extent),
            size,
        };
        Ok(Ready { case: *case, points: self.setup.points(case), push, pipelines, stream, colors, depth })
    }

    fn pipelines(&mut self, case: &Case) -> Result<Vec<vk::Pipeline>> {
        let vertex = match (case.primitive, case.vertices) {
            (Primitive::Quad, _) => &spirv::BENCH_RAW_QUAD_VERT,
            (Primitive::Point, Vertices::Pulled) => &spirv::BENCH_RAW_PULLED_VERT,
            (Primitive::Point, Vertices::Computed) => &spirv::BENCH_RAW_COMPUTED_VERT,
            (Primitive::Point, _) => &spirv::BENCH_RAW_POINT_VERT,
        };
        let streams: Vec<_> =
            case.vertices.stream().map(|(format, stride)| Stream { stride, format }).into_iter().collect();
        let colors: Vec<_> = (0..case.attachments)
            .map(|i| ColorTarget { format: case.color.format(), blend: case.blend_mode(i) })
            .collect();
        let format = case.depth_format();
        let depth =
            |compare, write, mark_hidden| format.map(|format| DepthMode { format, compare, write, mark_hidden });
        let nearest = depth(vk::CompareOp::GREATER, true, false);
        let visible = depth(vk::CompareOp::GREATER_OR_EQUAL, false, true);
        let passes = match case.passes {
            Passes::Color => vec![(true, None)],
            Passes::Depth => vec![(false, nearest)],
            Passes::Opaque => vec![(true, nearest)],
            Passes::TwoPass => vec![(false, nearest), (true, visible)],
        };
        let mut made = Vec::new();
        for (colored, depth) in passes {
            made.push(self.held.pipeline(&GraphicsInfo {
                name: "raw",
                vertex,
                fragment: if colored { COLORS[case.attachments as usize - 1] } else { &spirv::BENCH_RAW_DEPTH_FRAG },
                constants: &[(case.color == Color::Rgba8) as u32],
                streams: &streams,
                topology: match case.primitive {
                    Primitive::Point => vk::PrimitiveTopology::POINT_LIST,
                    Primitive::Quad => vk::PrimitiveTopology::TRIANGLE_LIST,
                },
                colors: if colored { &colors } else { &[] },
                depth,
                samples: vk::SampleCountFlags::TYPE_1,
                view_mask: 0,
                render_pass: None,
                ordered: false,
            })?);
        }
        Ok(made)
    }

    /// Draws once, and gives the device's time of all passes \[ms\].
    pub fn time(&mut self, ready: &Ready) -> Result<f64> {
        let (standalone, cmd) = (self.held.standalone, self.held.cmd);
        standalone.run(cmd, |cmd| {
            self.draw(ready, cmd);
            Ok(())
        })?;
        let times = self.held.timestamps.as_ref().map_or(Ok(Vec::new()), |t| t.read(&self.held.context))?;
        let sum: f64 = times.iter().map(|(_, ms)| ms).sum();
        if times.len() != ready.pipelines.len() || sum <= 0.0 {
            return Err(Error::Unsupported(format!("{}: the device gave no times", ready.case)));
        }
        Ok(sum)
    }

    fn draw(&mut self, ready: &Ready, cmd: vk::CommandBuffer) {
        let Held { context, timestamps, images, buffers, .. } = &mut self.held;
        if let Some(timestamps) = timestamps {
            timestamps.reset(context, cmd);
        }
        let mut recorder = Recorder::new(context, cmd, timestamps.as_mut());
        let (layout, set, indices, extent) = (self.layout, self.set, buffers[self.indices].handle, extent(&self.setup));
        let last = ready.pipelines.len() - 1;
        for (pass, &pipeline) in ready.pipelines.iter().enumerate() {
            let first = pass == 0;
            let colored = pass == last && !ready.colors.is_empty();
            let colors = if colored { ready.colors.as_slice() } else { &[] };
            let targets: Vec<_> =
                colors.iter().map(|&i| Attachment { view: images[i].layers[0], clear: Some([0.0; 4]) }).collect();
            let depth = ready.depth.map(|i| DepthAttachment {
                view: images[i].layers[0],
                format: images[i].format,
                clear: first.then_some(0.0),
            });
            let mut uses = Vec::new();
            for (i, image) in images.iter_mut().enumerate() {
                if Some(i) == ready.depth {
                    uses.push(Use::layer(image, Access::DepthWrite, first));
                } else if colors.contains(&i) {
                    uses.push(Use::Discard(image, Access::ColorWrite));
                }
            }
            let targets = Targets { colors: &targets, depth, extent, layers: 1 };
            recorder.draw("raw", uses, &targets, |context, cmd| {
                let graphics = vk::PipelineBindPoint::GRAPHICS;
                context.bind_pipeline(cmd, graphics, pipeline);
                context.push(cmd, layout, vk::ShaderStageFlags::VERTEX, bytemuck::bytes_of(&ready.push));
                context.bind_sets(cmd, graphics, layout, 0, &[set], &[]);
                if let Some(stream) = ready.stream {
                    context.bind_streams(cmd, &[buffers[stream].handle]);
                }
                if ready.case.primitive == Primitive::Point {
                    context.draw(cmd, 0, ready.points);
                    return;
                }
                context.bind_indices(cmd, indices);
                for start in (0..ready.points).step_by(CHUNK as usize) {
                    let count = (ready.points - start).min(CHUNK);
                    context.draw_indexed(cmd, 6 * count, 4 * start as i32);
                }
            });
        }
    }

    /// Draws once and compares every pixel with the prediction: the fragments counted, where they are added up in floats,
    /// or how the picture differs.
    pub fn check(&mut self, ready: &Ready) -> Result<Result<Option<u64>, String>> {
        self.time(ready)?;
        let case = &ready.case;
        let predicted = scene::predict(case, ready.points, self.setup.extent);
        let width = self.setup.extent[0] as usize;
        let wrong = |what: &str, i: usize, found: f32, expected: f32| {
            Ok(Err(format!("pixel {}, {} of {what} is {found}, not {expected}", i % width, i / width)))
        };
        if case.passes == Passes::Depth {
            let bytes = self.read(ready.depth.expect("depth alone"))?;
            let found = bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            for (i, (found, &expected)) in found.zip(&predicted.depth).enumerate() {
                // A fraction of 16 bits through a matrix of ones and zeros: exact but for the division by 65535.
                if (found - expected).abs() > 2f32.powi(-22) {
                    return wrong("the depth", i, found, expected);
                }
            }
            return Ok(Ok(None));
        }
        let most = case.color.most();
        let mut counted = 0;
        for (k, &image) in ready.colors.iter().enumerate() {
            let values = case.color.decode(&self.read(image)?);
            // Of the second sum's alpha the greatest stays.
            let mark = case.passes == Passes::TwoPass && k == 1;
            for (i, pixel) in values.chunks_exact(case.color.channels()).enumerate() {
                let fragments = predicted.fragments[i].min(most);
                for (channel, &found) in pixel.iter().enumerate() {
                    let expected = if mark && channel == 3 { fragments.min(1) } else { fragments } as f32;
                    if found != expected {
                        return wrong(&format!("attachment {k}"), i, found, expected);
                    }
                }
                if k == 0 {
                    counted += pixel[0] as u64;
                }
            }
        }
        let adds = case.blend && matches!(case.color, Color::Rgba32f | Color::R32f);
        Ok(Ok(adds.then_some(counted)))
    }

    /// The bytes of an image, tightly packed.
    fn read(&mut self, image: usize) -> Result<Vec<u8>> {
        let Held { standalone, context, images, cmd, .. } = &mut self.held;
        let (image, extent): (&mut Image, _) = (&mut images[image], extent(&self.setup));
        let mut download = Download::new(context, extent.width as u64 * extent.height as u64 * texel(image.format))?;
        let done = standalone.run(*cmd, |cmd| {
            let (handle, format) = (image.handle, image.format);
            let mut recorder = Recorder::new(context, cmd, None);
            recorder.barrier(vec![Use::Image(image, Access::CopyRead)]);
            download.record(context, cmd, handle, format, extent, 0);
            recorder.barrier(vec![Use::Memory(Access::CopyWrite, Access::HostRead)]);
            Ok(())
        });
        let bytes = done.map(|()| download.bytes().to_vec());
        download.destroy(context);
        bytes
    }
}

fn extent(setup: &Setup) -> vk::Extent2D {
    vk::Extent2D { width: setup.extent[0], height: setup.extent[1] }
}

/// Bytes of a texel of one of the formats that are drawn to and read.
fn texel(format: vk::Format) -> u64 {
    match format {
        vk::Format::R32G32B32A32_SFLOAT => 16,
        vk::Format::R16G16B16A16_SFLOAT => 8,
        _ => 4,
    }
}
