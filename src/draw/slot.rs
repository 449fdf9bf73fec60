//! What one frame in flight needs for itself: parameters, sets, counters, timestamps. Reused once its frame is complete.

use ash::vk;

use super::cuts::CutTable;
use super::layers::Layers;
use super::list::{Listing, Lists};
use super::occlusion::{Tested, Tests};
use super::targets::Targets;
use crate::composite::Composite;
use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::layout::{Counts, DrawParams, FrameParams};
use crate::gpu::memory::Location;
use crate::gpu::program::Program;
use crate::gpu::query::Timestamps;
use crate::gpu::resource::Buffer;
use crate::host::{CloudId, HostDepth};
use crate::stats::FrameStats;

/// One frame in flight.
#[derive(Debug)]
pub struct Slot {
    /// The frame that uses it, or used it last.
    pub frame: u64,
    /// Statistics so far, taken when the frame is complete.
    pub stats: Option<FrameStats>,
    /// What the device counted, where it was asked to.
    pub counted: bool,
    /// Times.
    pub timestamps: Option<Timestamps>,
    /// Set 0 of the splats.
    pub params_set: vk::DescriptorSet,
    /// Set 2 of the splats: counters and lists.
    pub select_set: vk::DescriptorSet,
    /// Set 0 of the full-screen passes.
    pub frame_set: vk::DescriptorSet,
    /// Counters, read by the processor.
    pub counts: Buffer,
    /// What compaction takes, where there was any.
    pub lists: Option<Lists>,
    /// Occlusion queries, where there were any, and what they are of.
    pub tests: Option<Tests>,
    /// By number.
    pub tested: Vec<Tested>,
    /// Layered point clouds of the frame, in the order of its statistics.
    pub models: Vec<CloudId>,
    /// What the frame's lists are of, where they are kept for the processor.
    pub kept: Option<Listing>,
    params: Buffer,
    frame_params: Buffer,
    /// Stands in for all of them where nothing is compacted, and for the table of cuts where there is none.
    no_lists: Buffer,
    /// Cuts of layered point clouds.
    cuts: Option<Buffer>,
    pool: vk::DescriptorPool,
}

/// What the full-screen passes of a frame read.
pub struct Read<'a> {
    /// Sums, front, depth.
    pub targets: &'a Targets,
    /// Where they are folded.
    pub layers: Option<&'a Layers>,
    /// The host's depth, if it has any.
    pub host_depth: Option<HostDepth>,
    /// Nearest.
    pub sampler: vk::Sampler,
}

/// Bytes from one cloud's parameters to the next; the size of the block is 512, which every device's alignment divides.
pub const PARAMS_STRIDE: u64 = size_of::<DrawParams>() as u64;

impl Slot {
    /// A slot for `draws` ≥ 1 clouds times views.
    pub fn new(context: &mut Context, splats: &Program, composite: &Composite, draws: u64) -> Result<Slot> {
        debug_assert!(PARAMS_STRIDE.is_multiple_of(context.limits.min_uniform_buffer_offset_alignment));
        let uniform = vk::BufferUsageFlags::UNIFORM_BUFFER;
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::TRANSFER_DST;
        let mut buffers = Vec::new();
        let mut pool = vk::DescriptorPool::null();
        let mut timestamps = None;
        let made = (|| -> Result<[vk::DescriptorSet; 3]> {
            buffers.push(Buffer::new(context, "params", draws * PARAMS_STRIDE, uniform, Location::Upload)?);
            let size = size_of::<FrameParams>() as u64;
            buffers.push(Buffer::new(context, "frame_params", size, uniform, Location::Upload)?);
            let size = size_of::<Counts>() as u64;
            buffers.push(Buffer::new(context, "counts", size, storage, Location::Readback)?);
            let count = |ty, descriptor_count| vk::DescriptorPoolSize { ty, descriptor_count };
            let sizes = [
                count(vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC, 1),
                count(vk::DescriptorType::UNIFORM_BUFFER, 1),
                count(vk::DescriptorType::STORAGE_BUFFER, 8),
                count(vk::DescriptorType::COMBINED_IMAGE_SAMPLER, 5),
            ];
            buffers.push(Buffer::new(context, "no lists", 16, storage, Location::Device)?);
            pool = context.descriptor_pool("slot.sets", 3, &sizes)?;
            timestamps = Timestamps::new(context)?;
            let layouts = [splats.sets[0], splats.sets[2], composite.program.sets[0]];
            let sets = context.descriptor_sets(pool, &layouts)?;
            Ok([sets[0], sets[1], sets[2]])
        })();
        match made {
            Ok([params_set, select_set, frame_set]) => {
                let mut buffers = buffers.into_iter();
                let (Some(params), Some(frame_params), Some(counts), Some(no_lists)) =
                    (buffers.next(), buffers.next(), buffers.next(), buffers.next())
                else {
                    unreachable!("all four were made")
                };
                let stats = None;
                let counted = false;
                Ok(Slot {
                    frame: 0,
                    stats,
                    counted,
                    timestamps,
                    params_set,
                    select_set,
                    frame_set,
                    counts,
                    no_lists,
                    lists: None,
                    kept: None,
                    cuts: None,
                    tests: None,
                    tested: Vec::new(),
                    models: Vec::new(),
                    params,
                    frame_params,
                    pool,
                })
            }
            Err(e) => {
                buffers.into_iter().for_each(|b| b.destroy(context));
                if let Some(t) = timestamps {
                    t.destroy(context);
                }
                context.destroy_pool(pool);
                Err(e)
            }
        }
    }

    /// Clouds times views that it has room for.
    pub fn capacity(&self) -> u64 {
        self.params.size / PARAMS_STRIDE
    }

    /// Writes parameters and sets for a new frame; the last one is complete.
    pub fn write(
        &mut self,
        context: &Context,
        params: &[DrawParams],
        frame: &FrameParams,
        &Read { targets, layers, host_depth, sampler }: &Read,
    ) {
        let bytes: &[u8] = bytemuck::cast_slice(params);
        self.params.bytes()[..bytes.len()].copy_from_slice(bytes);
        self.frame_params.bytes().copy_from_slice(bytemuck::bytes_of(frame));

        let buffer = |buffer, range| [vk::DescriptorBufferInfo { buffer, offset: 0, range }];
        let params = buffer(self.params.handle, PARAMS_STRIDE);
        let counts = buffer(self.counts.handle, vk::WHOLE_SIZE);
        let frame = buffer(self.frame_params.handle, vk::WHOLE_SIZE);
        let sampled = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;
        let image = |image_view, image_layout| [vk::DescriptorImageInfo { sampler, image_view, image_layout }];
        // What a frame does without is stood in for by the colour sums, and not read.
        let color = targets.color.array;
        let images = [
            image(color, sampled),
            image(targets.surface.as_ref().map_or(color, |i| i.array), sampled),
            // The pass that folds layers writes the sums.
            host_depth.map_or(image(layers.map_or(color, |l| l.front.array), sampled), |d| image(d.view, d.layout)),
            image(targets.depth.array, sampled),
            image(targets.front.as_ref().map_or(color, |i| i.array), sampled),
        ];
        let to =
            |set, binding, ty| vk::WriteDescriptorSet::default().dst_set(set).dst_binding(binding).descriptor_type(ty);
        let mut writes = vec![
            to(self.params_set, 0, vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC).buffer_info(&params),
            to(self.select_set, 0, vk::DescriptorType::STORAGE_BUFFER).buffer_info(&counts),
            to(self.frame_set, 0, vk::DescriptorType::UNIFORM_BUFFER).buffer_info(&frame),
        ];
        for (binding, info) in (1..).zip(&images) {
            writes.push(to(self.frame_set, binding, vk::DescriptorType::COMBINED_IMAGE_SAMPLER).image_info(info));
        }
        let lists = self.lists.as_ref().map_or([self.no_lists.handle; 6], Lists::bindings);
        let lists = lists.map(|handle| buffer(handle, vk::WHOLE_SIZE));
        for (binding, info) in (1..).zip(&lists) {
            writes.push(to(self.select_set, binding, vk::DescriptorType::STORAGE_BUFFER).buffer_info(info));
        }
        let cuts = buffer(self.cuts.as_ref().map_or(self.no_lists.handle, |b| b.handle), vk::WHOLE_SIZE);
        writes.push(to(self.select_set, 7, vk::DescriptorType::STORAGE_BUFFER).buffer_info(&cuts));
        context.write_sets(&writes);
    }

    /// Writes the table of cuts, making room for twice as much where there is none; the last frame is complete.
    pub fn write_cuts(&mut self, context: &mut Context, table: &CutTable) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(&table.words);
        let size = bytes.len() as u64;
        if bytes.is_empty() {
            return Ok(());
        }
        if self.cuts.as_ref().is_none_or(|b| b.size < size) {
            let most = context.limits.max_storage_buffer_range as u64;
            if size > most {
                return Err(Error::Unsupported(format!("{size} bytes of cuts in a frame: this device binds {most}")));
            }
            let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
            let made = Buffer::new(context, "cuts", (2 * size).min(most), usage, Location::Upload)?;
            if let Some(old) = self.cuts.replace(made) {
                old.destroy(context);
            }
        }
        if let Some(cuts) = &mut self.cuts {
            cuts.bytes()[..bytes.len()].copy_from_slice(bytes);
        }
        Ok(())
    }

    /// Makes room for a frame's tests; the last one is complete.
    pub fn ensure_tests(&mut self, context: &mut Context, tested: Vec<Tested>) -> Result<()> {
        let count = tested.len();
        self.tested = tested;
        if count == 0 || self.tests.as_ref().is_some_and(|tests| tests.holds(count)) {
            return Ok(());
        }
        let made = Tests::new(context, count as u32)?;
        if let Some(old) = self.tests.replace(made) {
            old.destroy(context);
        }
        Ok(())
    }

    /// Makes room for what a frame compacts; the last one is complete.
    pub fn ensure_lists(&mut self, context: &mut Context, listing: &Listing, keep: bool) -> Result<()> {
        if listing.is_empty() || self.lists.as_ref().is_some_and(|l| l.holds(listing, keep)) {
            return Ok(());
        }
        let made = Lists::new(context, listing, keep)?;
        if let Some(old) = self.lists.replace(made) {
            old.destroy(context);
        }
        Ok(())
    }

    /// The counters; the frame is complete.
    pub fn read_counts(&mut self) -> Counts {
        bytemuck::pod_read_unaligned(&self.counts.bytes()[..size_of::<Counts>()])
    }

    /// Destroys everything; the frame is complete.
    pub fn destroy(self, context: &mut Context) {
        for buffer in [self.params, self.frame_params, self.counts, self.no_lists] {
            buffer.destroy(context);
        }
        if let Some(lists) = self.lists {
            lists.destroy(context);
        }
        if let Some(cuts) = self.cuts {
            cuts.destroy(context);
        }
        if let Some(tests) = self.tests {
            tests.destroy(context);
        }
        if let Some(timestamps) = self.timestamps {
            timestamps.destroy(context);
        }
        context.destroy_pool(self.pool);
    }
}
