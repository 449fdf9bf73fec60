//! A cloud on the device: chunks that fit the smallest storage-buffer range, uploaded as the host records frames.

use std::sync::Arc;

use ash::vk;

use crate::error::Result;
use crate::gpu::Context;
use crate::gpu::memory::Location;
use crate::gpu::program::Program;
use crate::gpu::resource::Buffer;
use crate::gpu::retire::{RetireQueue, Retired};
use crate::gpu::upload::Upload;
use crate::structure::Flat;
use crate::structure::flat::BLOCK;

use super::plan::CloudTraits;

/// Points a chunk: 64 MiB of geometry, half the least `maxStorageBufferRange` of 128 MiB; a multiple of [`BLOCK`].
pub const CHUNK: usize = 1 << 22;
const _: () = assert!(CHUNK.is_multiple_of(BLOCK));

/// Consecutive points in buffers of their own.
#[derive(Debug)]
pub struct Chunk {
    /// Index of the first point in the cloud.
    pub first: u32,
    /// Number of points.
    pub count: u32,
    /// Centres and radii.
    pub geometry: Buffer,
    /// Octahedral normals.
    pub normals: Option<Buffer>,
    /// sRGB colours.
    pub colors: Option<Buffer>,
    /// Groups, a byte a point.
    pub groups: Option<Buffer>,
    /// The four as storage, for shaders that pull.
    pub set: vk::DescriptorSet,
}

impl Chunk {
    /// The buffers in the order of vertex streams and bindings; missing ones are stood in for by the geometry, which is
    /// at least as large and is not read.
    pub fn streams(&self) -> [vk::Buffer; 4] {
        let geometry = self.geometry.handle;
        let or = |b: &Option<Buffer>| b.as_ref().map_or(geometry, |b| b.handle);
        [geometry, or(&self.normals), or(&self.colors), or(&self.groups)]
    }
}

/// A cloud that was added to a renderer.
#[derive(Debug)]
pub struct DeviceCloud {
    /// What it was made from: bounds and attributes are read in every frame.
    pub flat: Arc<Flat>,
    /// What has been uploaded, in order.
    pub chunks: Vec<Chunk>,
    pool: vk::DescriptorPool,
}

impl DeviceCloud {
    /// Nothing is uploaded yet.
    pub fn new(context: &Context, flat: Arc<Flat>) -> Result<DeviceCloud> {
        let sets = flat.len().div_ceil(CHUNK).max(1) as u32;
        let sizes = [vk::DescriptorPoolSize { ty: vk::DescriptorType::STORAGE_BUFFER, descriptor_count: 4 * sets }];
        let pool = context.descriptor_pool("cloud.sets", sets, &sizes)?;
        Ok(DeviceCloud { flat, chunks: Vec::new(), pool })
    }

    /// What decides between pipelines.
    pub fn traits(&self) -> CloudTraits {
        CloudTraits {
            normals: self.flat.normals.is_some(),
            colors: self.flat.colors.is_some(),
            closed: self.flat.closed,
            groups: self.flat.groups.as_ref().map(|g| (g.count, g.overlapping)),
        }
    }

    /// Points on the device.
    pub fn resident(&self) -> usize {
        self.chunks.last().map_or(0, |c| (c.first + c.count) as usize)
    }

    /// Bytes that still have to be uploaded.
    pub fn pending(&self) -> u64 {
        let (all, done) = (self.flat.len() as u64, self.resident() as u64);
        self.flat.bytes().checked_div(all).unwrap_or(0) * (all - done)
    }

    /// Makes the next chunk and the copies that fill it; `None` when everything is there. The staging memory must live
    /// until the frame is complete.
    pub fn upload_next(&mut self, context: &mut Context, program: &Program) -> Result<Option<Upload>> {
        let first = self.resident();
        let count = (self.flat.len() - first).min(CHUNK);
        if count == 0 {
            return Ok(None);
        }
        let range = first..first + count;
        let flat = Arc::clone(&self.flat);
        let geometry: &[u8] = bytemuck::cast_slice(&flat.geometry[range.clone()]);
        let normals: Option<&[u8]> = flat.normals.as_ref().map(|n| bytemuck::cast_slice(&n[range.clone()]));
        let colors: Option<&[u8]> = flat.colors.as_ref().map(|c| bytemuck::cast_slice(&c[range.clone()]));
        let groups: Option<&[u8]> = flat.groups.as_ref().map(|g| &g.of[range]);
        let streams = [("geometry", Some(geometry)), ("normals", normals), ("colors", colors), ("groups", groups)];
        let bytes = |data: Option<&[u8]>| data.map_or(0, |d| (d.len() as u64).next_multiple_of(16));

        let mut made = Vec::new();
        let usage = vk::BufferUsageFlags::VERTEX_BUFFER
            | vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_DST;
        let all = (|| -> Result<(Upload, vk::DescriptorSet)> {
            for (name, data) in streams {
                if let Some(data) = data {
                    // Bytes are read four at a time.
                    let size = (data.len() as u64).next_multiple_of(4);
                    made.push(Buffer::new(context, name, size, usage, Location::Device)?);
                }
            }
            let mut upload = Upload::new(context, streams.iter().map(|(_, data)| bytes(*data)).sum())?;
            for (to, data) in made.iter().zip(streams.iter().filter_map(|(_, data)| *data)) {
                upload.write(to, data);
            }
            match self.allocate_set(context, program) {
                Ok(set) => Ok((upload, set)),
                Err(e) => {
                    upload.staging.destroy(context);
                    Err(e)
                }
            }
        })();
        let (upload, set) = match all {
            Ok(done) => done,
            Err(e) => {
                made.into_iter().for_each(|b| b.destroy(context));
                return Err(e);
            }
        };
        let mut made = made.into_iter();
        let Some(geometry) = made.next() else { unreachable!("geometry was made") };
        let normals = flat.normals.is_some().then(|| made.next()).flatten();
        let colors = flat.colors.is_some().then(|| made.next()).flatten();
        let chunk =
            Chunk { first: first as u32, count: count as u32, geometry, normals, colors, groups: made.next(), set };
        let infos =
            chunk.streams().map(|buffer| [vk::DescriptorBufferInfo { buffer, offset: 0, range: vk::WHOLE_SIZE }]);
        // Without shaders that choose a layer, the set has no place for the groups.
        let bindings = if context.enabled.output_layer { 4 } else { 3 };
        let writes: Vec<_> = (0..bindings)
            .zip(&infos)
            .map(|(binding, info)| {
                vk::WriteDescriptorSet::default()
                    .dst_set(set)
                    .dst_binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(info)
            })
            .collect();
        context.write_sets(&writes);
        self.chunks.push(chunk);
        Ok(Some(upload))
    }

    fn allocate_set(&self, context: &Context, program: &Program) -> Result<vk::DescriptorSet> {
        Ok(context.descriptor_sets(self.pool, &[program.sets[1]])?[0])
    }

    /// Gives everything up after `frame`.
    pub fn retire(self, queue: &mut RetireQueue, frame: u64) {
        for chunk in self.chunks {
            for buffer in [Some(chunk.geometry), chunk.normals, chunk.colors, chunk.groups].into_iter().flatten() {
                queue.push(frame, Retired::Buffer(buffer));
            }
        }
        queue.push(frame, Retired::DescriptorPool(self.pool));
    }
}
