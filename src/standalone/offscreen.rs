//! Frames without a window: the smallest complete host, one frame at a time.

use std::time::Instant;

use ash::vk;

use super::clock::thread_ms;
use super::device::Standalone;
use crate::error::Result;
use crate::gpu::Context;
use crate::gpu::barrier::Access;
use crate::gpu::download::Download;
use crate::gpu::pass::{Attachment, DepthAttachment, Recorder, Targets, Use};
use crate::gpu::resource::Image;
use crate::host::{FrameInput, Instance, PassKind, TargetFormats};
use crate::readback::Picture;
use crate::renderer::Renderer;
use crate::select::View;
use crate::stats::FrameStats;
use crate::style::Style;
use crate::technique::Technique;

/// What to draw, without what a window would add.
#[derive(Debug, Clone, Copy)]
pub struct Shot<'a> {
    /// Where from.
    pub view: &'a View,
    /// What.
    pub instances: &'a [Instance],
    /// How.
    pub technique: Technique,
    /// And how it looks.
    pub style: &'a Style,
    /// Count what is drawn and culled.
    pub count: bool,
}

/// Times of one frame on the processor's clock \[ms\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameTimes {
    /// From the start of recording to the device's completion.
    pub frame: f64,
    /// `prepare` alone.
    pub prepare: f64,
    /// What `prepare` used of the processor, without what others did meanwhile; `None` where the system does not tell.
    pub prepare_cpu: Option<f64>,
}

/// A renderer with a float target of its own.
pub struct Offscreen {
    /// The renderer; clouds are added to it directly.
    pub renderer: Renderer,
    /// See [`FrameInput::keep_lists`]; off at first.
    pub keep_lists: bool,
    context: Context,
    color: Image,
    depth: Option<Image>,
    extent: vk::Extent2D,
    cmd: vk::CommandBuffer,
    frame: u64,
    // Last: everything above is made from it.
    standalone: Standalone,
}

/// Linear light, so that nothing is rounded before the one encoding.
const COLOR: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
const DEPTH: vk::Format = vk::Format::D32_SFLOAT;
const COLOR_USAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::COLOR_ATTACHMENT.as_raw() | vk::ImageUsageFlags::TRANSFER_SRC.as_raw(),
);
const DEPTH_USAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT.as_raw() | vk::ImageUsageFlags::TRANSFER_SRC.as_raw(),
);

/// Refuses what the device has no images for.
fn fits(context: &Context, extent: vk::Extent2D) -> Result<()> {
    let limit = context.limits.max_framebuffer_width.min(context.limits.max_framebuffer_height);
    let limit = limit.min(context.limits.max_image_dimension2_d);
    if extent.width.max(extent.height) <= limit {
        return Ok(());
    }
    let vk::Extent2D { width, height } = extent;
    Err(crate::Error::Unsupported(format!("a picture of {width}x{height}: this device's limit is {limit} a side")))
}

impl Offscreen {
    /// A target of `extent` pixels, at least 1 × 1. `depth`: the front's depth is wanted too.
    pub fn new(standalone: Standalone, extent: vk::Extent2D, depth: bool) -> Result<Offscreen> {
        let host = standalone.host();
        let mut context = standalone.context();
        fits(&context, extent)?;
        let color = Image::new(&mut context, "target.color", COLOR, extent, 1, COLOR_USAGE)?;
        let made = (|| {
            let depth = match depth {
                true => Some(Image::new(&mut context, "target.depth", DEPTH, extent, 1, DEPTH_USAGE)?),
                false => None,
            };
            let formats = TargetFormats {
                color: COLOR,
                depth: depth.is_some().then_some(DEPTH),
                samples: vk::SampleCountFlags::TYPE_1,
                view_mask: 0,
                pass: PassKind::Dynamic,
                encode_srgb: false,
            };
            let rest = (|| {
                // SAFETY: the handles are the standalone's, which is dropped after the renderer, and `enabled` is what
                // it enabled.
                let renderer = unsafe { Renderer::new(host, formats) }?;
                match standalone.command_buffer() {
                    Ok(cmd) => Ok((renderer, cmd)),
                    Err(e) => {
                        // SAFETY: nothing was recorded.
                        unsafe { renderer.destroy() };
                        Err(e)
                    }
                }
            })();
            match rest {
                Ok((renderer, cmd)) => Ok((depth, renderer, cmd)),
                Err(e) => {
                    if let Some(depth) = depth {
                        depth.destroy(&mut context);
                    }
                    Err(e)
                }
            }
        })();
        match made {
            Ok((depth, renderer, cmd)) => {
                Ok(Offscreen { renderer, keep_lists: false, context, color, depth, extent, cmd, frame: 0, standalone })
            }
            Err(e) => {
                color.destroy(&mut context);
                Err(e)
            }
        }
    }

    /// Makes the target of another size, at least 1 × 1; the clouds stay. The picture is lost, and kept if this fails.
    pub fn resize(&mut self, extent: vk::Extent2D) -> Result<()> {
        fits(&self.context, extent)?;
        let color = Image::new(&mut self.context, "target.color", COLOR, extent, 1, COLOR_USAGE)?;
        if let Some(depth) = &mut self.depth {
            match Image::new(&mut self.context, "target.depth", DEPTH, extent, 1, DEPTH_USAGE) {
                Ok(made) => std::mem::replace(depth, made).destroy(&mut self.context),
                Err(e) => {
                    color.destroy(&mut self.context);
                    return Err(e);
                }
            }
        }
        // Every frame was waited for.
        std::mem::replace(&mut self.color, color).destroy(&mut self.context);
        self.extent = extent;
        Ok(())
    }

    /// The device that it runs on.
    pub fn standalone(&self) -> &Standalone {
        &self.standalone
    }

    /// Draws one frame and waits for it.
    pub fn draw(&mut self, shot: &Shot) -> Result<(FrameStats, FrameTimes)> {
        self.frame += 1;
        let input = FrameInput {
            id: self.frame,
            extent: self.extent,
            offset: vk::Offset2D::default(),
            views: std::slice::from_ref(shot.view),
            instances: shot.instances,
            technique: shot.technique,
            style: shot.style,
            host_depth: None,
            count: shot.count,
            keep_lists: self.keep_lists,
        };
        let (renderer, context) = (&mut self.renderer, &self.context);
        let (color, depth, extent) = (&mut self.color, &mut self.depth, self.extent);
        let start = Instant::now();
        let (mut prepare, mut prepare_cpu) = (0.0, None);
        self.standalone.run(self.cmd, |cmd| {
            let before = thread_ms();
            // SAFETY: the buffer is recording, outside a pass; ids grow, frames are waited for one by one; clouds in
            // `shot` are the caller's to keep (a panic, not worse, otherwise).
            unsafe { renderer.prepare(cmd, &input) }?;
            prepare_cpu = before.and_then(|before| Some(thread_ms()? - before));
            prepare = start.elapsed().as_secs_f64() * 1e3;
            // SAFETY: as above; there is no host depth.
            unsafe { renderer.render(cmd) }?;
            let mut recorder = Recorder::new(context, cmd, None);
            let target = [Attachment { view: color.layers[0], clear: Some([0.0; 4]) }];
            let far = shot.view.depth.far() as f32;
            let depth_target =
                depth.as_ref().map(|d| DepthAttachment { view: d.layers[0], format: DEPTH, clear: Some(far) });
            let mut uses = vec![Use::Discard(color, Access::ColorWrite)];
            uses.extend(depth.as_mut().map(|d| Use::Discard(d, Access::DepthWrite)));
            let targets = Targets { colors: &target, depth: depth_target, extent, layers: 1 };
            let mut composited = Ok(());
            recorder.draw("host", uses, &targets, |_, cmd| {
                // SAFETY: inside a pass of the formats given to `new`.
                composited = unsafe { renderer.composite(cmd) };
            });
            composited
        })?;
        let times = FrameTimes { frame: start.elapsed().as_secs_f64() * 1e3, prepare, prepare_cpu };
        let mut stats = self.renderer.retire(self.frame)?;
        Ok((stats.pop().unwrap_or_default(), times))
    }

    /// Copies the last frame's picture into memory.
    pub fn read(&mut self) -> Result<Picture> {
        let pixels = self.extent.width as u64 * self.extent.height as u64;
        let rgba = self.fetch(pixels * 16, false)?;
        let depth = match self.depth {
            Some(_) => Some(bytemuck::pod_collect_to_vec(&self.fetch(pixels * 4, true)?)),
            None => None,
        };
        Ok(Picture {
            width: self.extent.width,
            height: self.extent.height,
            rgba: bytemuck::pod_collect_to_vec(&rgba),
            depth,
        })
    }

    fn fetch(&mut self, bytes: u64, depth: bool) -> Result<Vec<u8>> {
        let image = match &mut self.depth {
            Some(image) if depth => image,
            _ => &mut self.color,
        };
        let mut download = Download::new(&mut self.context, bytes)?;
        let (context, extent) = (&self.context, self.extent);
        let done = self.standalone.run(self.cmd, |cmd| {
            let mut recorder = Recorder::new(context, cmd, None);
            recorder.barrier(vec![Use::Image(image, Access::CopyRead)]);
            download.record(context, cmd, image.handle, image.format, extent, 0);
            recorder.barrier(vec![Use::Memory(Access::CopyWrite, Access::HostRead)]);
            Ok(())
        });
        let result = done.map(|()| download.bytes().to_vec());
        download.destroy(&mut self.context);
        result
    }

    /// Destroys everything but the device, which is returned: its messages then tell of leaks too.
    pub fn destroy(self) -> Standalone {
        let Offscreen { renderer, mut context, color, depth, standalone, .. } = self;
        // SAFETY: every frame was waited for.
        unsafe { renderer.destroy() };
        color.destroy(&mut context);
        if let Some(depth) = depth {
            depth.destroy(&mut context);
        }
        standalone
    }
}
