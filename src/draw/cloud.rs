//! A cloud on the device: chunks that fit the smallest storage-buffer range, uploaded as the host records frames.

use std::sync::Arc;

use ash::vk;

use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::memory::Location;
use crate::gpu::program::Program;
use crate::gpu::resource::Buffer;
use crate::gpu::retire::{RetireQueue, Retired};
use crate::gpu::upload::Upload;
use crate::structure::flat::{BLOCK, Block};
use crate::structure::nodes::{ErrorRule, NONE, Node, Nodes};
use crate::structure::{Cloud, Flat};

use super::faces::{self, Faces};
use super::patches::Patches;
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
    /// Centres and radii. What this and the next two hold of packed clouds: `glsl/shared/packing.glsl`.
    pub geometry: Buffer,
    /// Octahedral normals.
    pub normals: Option<Buffer>,
    /// sRGB colours.
    pub colors: Option<Buffer>,
    /// Boxes of runs, for quantised clouds.
    pub frames: Option<Buffer>,
    /// Groups, a byte a point.
    pub groups: Option<Buffer>,
    /// Links to nodes, for structures that are tested point by point.
    pub links: Option<Buffer>,
    /// Those nodes.
    pub nodes: Option<Buffer>,
    /// All of them as storage, for shaders that pull.
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

    /// Points the set to the buffers; what is not there is stood in for by the geometry, and not read.
    fn write_set(&self, context: &Context) {
        let [geometry, normals, colors, groups] = self.streams();
        let or = |b: &Option<Buffer>| b.as_ref().map_or(geometry, |b| b.handle);
        let [links, nodes, frames] = [or(&self.links), or(&self.nodes), or(&self.frames)];
        write_set(context, self.set, [geometry, normals, colors, groups, links, nodes, frames]);
    }
}

/// What the streams of points are used for.
const STREAM: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::VERTEX_BUFFER.as_raw()
        | vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw(),
);

/// A cloud that was added to a renderer.
#[derive(Debug)]
pub struct DeviceCloud {
    /// What it was made from: bounds and attributes are read in every frame.
    pub cloud: Cloud,
    /// Bounds of everything.
    pub bounds: Block,
    /// What has been uploaded, in order.
    pub chunks: Vec<Chunk>,
    /// The same of faces, after all points.
    pub faces: Vec<Faces>,
    /// Of a layered point cloud, what the chunks hold.
    pub patches: Option<Patches>,
    pool: vk::DescriptorPool,
}

impl DeviceCloud {
    /// Nothing is uploaded yet; a layered point cloud has all its memory from here on.
    pub fn new(context: &mut Context, program: &Program, cloud: Cloud) -> Result<DeviceCloud> {
        let flat = cloud.flat();
        let patches = cloud.layered().map(|model| Patches::new(context, Arc::clone(model))).transpose()?;
        let slots: Vec<(u32, u32)> = patches.iter().flat_map(Patches::chunks).collect();
        let triangles = cloud.triangles().map_or(0, |t| t.len().div_ceil(faces::CHUNK));
        let sets = (flat.len().div_ceil(CHUNK).max(1) + triangles + slots.len()) as u32;
        let sizes = [vk::DescriptorPoolSize { ty: vk::DescriptorType::STORAGE_BUFFER, descriptor_count: 7 * sets }];
        let pool = match context.descriptor_pool("cloud.sets", sets, &sizes) {
            Ok(pool) => pool,
            Err(e) => {
                patches.into_iter().for_each(|patches| patches.end().destroy(context));
                return Err(e);
            }
        };
        let bounds = Block::around(&flat.blocks);
        let mut made = DeviceCloud { cloud, bounds, chunks: Vec::new(), faces: Vec::new(), patches, pool };
        for (first, count) in slots {
            match made.empty_chunk(context, program, first, count) {
                Ok(chunk) => made.chunks.push(chunk),
                Err(e) => {
                    let mut unused = RetireQueue::default();
                    made.retire(&mut unused, 0);
                    unused.collect(context, 0);
                    return Err(e);
                }
            }
        }
        Ok(made)
    }

    /// Room for so many points, in which there are none.
    fn empty_chunk(&self, context: &mut Context, program: &Program, first: u32, count: u32) -> Result<Chunk> {
        let flat = self.flat();
        let wanted = [
            ("geometry", 16, true),
            ("normals", 4, flat.has_normals()),
            ("colors", 4, flat.has_colors()),
            ("groups", 1, flat.groups.is_some()),
        ];
        let mut made = [const { None }; 4];
        let all = (|| {
            for (to, (name, bytes, _)) in made.iter_mut().zip(wanted).filter(|(_, (.., there))| *there) {
                // Bytes are read four at a time.
                let size = (bytes * count as u64).next_multiple_of(4);
                *to = Some(Buffer::new(context, name, size, STREAM, Location::Device)?);
            }
            context.descriptor_sets(self.pool, &[program.sets[1]])
        })();
        match (all, made) {
            (Ok(sets), [Some(geometry), normals, colors, groups]) => {
                let [frames, links, nodes] = [const { None }; 3];
                let chunk =
                    Chunk { first, count, geometry, normals, colors, frames, groups, links, nodes, set: sets[0] };
                chunk.write_set(context);
                Ok(chunk)
            }
            (Ok(_), _) => unreachable!("geometry was made"),
            (Err(e), made) => {
                made.into_iter().flatten().for_each(|b| b.destroy(context));
                Err(e)
            }
        }
    }

    /// Its points.
    pub fn flat(&self) -> &Flat {
        self.cloud.flat()
    }

    /// What decides between pipelines.
    pub fn traits(&self) -> CloudTraits {
        let flat = self.flat();
        CloudTraits {
            normals: flat.has_normals(),
            colors: flat.has_colors(),
            closed: flat.closed,
            groups: flat.groups.as_ref().map(|g| (g.count, g.overlapping)),
            rule: self.cloud.nodes().map(|n| n.rule),
            triangles: self.cloud.triangles().is_some(),
            packing: flat.packing(),
            layered: self.patches.is_some(),
        }
    }

    /// Faces on the device.
    pub fn resident_faces(&self) -> usize {
        self.faces.last().map_or(0, |f| (f.first + f.count) as usize)
    }

    /// Points on the device.
    pub fn resident(&self) -> usize {
        self.chunks.last().map_or(0, |c| (c.first + c.count) as usize)
    }

    /// Bytes that still have to be uploaded.
    pub fn pending(&self) -> u64 {
        let flat = self.flat();
        let (all, done) = (flat.len() as u64, self.resident() as u64);
        let nodes = self.cloud.nodes().map_or(0, |n| size_of_val(&n.links[..]) as u64);
        let points = (flat.bytes() + nodes).checked_div(all).unwrap_or(0) * (all - done);
        points
            + self.cloud.triangles().map_or(0, |triangles| {
                let (all, done) = (triangles.len() as u64, self.resident_faces() as u64);
                triangles.bytes().checked_div(all).unwrap_or(0) * (all - done)
            })
    }

    /// Makes the next chunk and the copies that fill it; `None` when everything is there. The staging memory must live
    /// until the frame is complete.
    pub fn upload_next(&mut self, context: &mut Context, program: &Program) -> Result<Option<Upload>> {
        let cloud = self.cloud.clone();
        if self.patches.is_some() {
            // Each frame says which.
            return Ok(None);
        }
        let (flat, first) = (cloud.flat(), self.resident());
        let count = (flat.len() - first).min(CHUNK);
        if count == 0 {
            let first = self.resident_faces();
            let Some(triangles) = cloud.triangles().filter(|t| t.len() > first) else { return Ok(None) };
            let (faces, upload) = Faces::upload(context, program, self.pool, triangles, first)?;
            self.faces.push(faces);
            return Ok(Some(upload));
        }
        let range = first..first + count;
        let nodes = cloud.nodes().map(|nodes| of_chunk(nodes, range.clone()));
        let most = context.limits.max_storage_buffer_range as u64;
        if let Some(bytes) = nodes.as_ref().map(|n| size_of_val(&n.places[..]) as u64).filter(|b| *b > most) {
            let text = format!("{bytes} bytes of nodes for {count} points: this device binds {most}");
            return Err(Error::Unsupported(text));
        }
        let points = flat.streams(range.clone());
        let streams: [(_, Option<&[u8]>); 7] = [
            ("geometry", Some(points.geometry)),
            ("normals", points.normals),
            ("colors", points.colors),
            ("groups", flat.groups.as_ref().map(|g| &g.of[range.clone()])),
            ("links", nodes.as_ref().map(|n| bytemuck::cast_slice(&n.links))),
            ("nodes", nodes.as_ref().filter(|n| !n.places.is_empty()).map(|n| bytemuck::cast_slice(&n.places))),
            ("frames", points.frames),
        ];
        let (made, upload, set) = fill(context, program, self.pool, streams)?;
        let [Some(geometry), normals, colors, groups, links, nodes, frames] = made else {
            unreachable!("geometry was made")
        };
        let (first, count) = (first as u32, count as u32);
        let chunk = Chunk { first, count, geometry, normals, colors, frames, groups, links, nodes, set };
        chunk.write_set(context);
        self.chunks.push(chunk);
        Ok(Some(upload))
    }

    /// Gives everything up after `frame`.
    pub fn retire(self, queue: &mut RetireQueue, frame: u64) {
        let chunks = self.chunks.into_iter();
        let buffers = chunks
            .flat_map(|c| [Some(c.geometry), c.normals, c.colors, c.frames, c.groups, c.links, c.nodes])
            .flatten();
        let faces = self.faces.into_iter().flat_map(|f| f.buffers);
        let staging = self.patches.map(Patches::end);
        buffers.chain(faces).chain(staging).for_each(|buffer| queue.push(frame, Retired::Buffer(buffer)));
        queue.push(frame, Retired::DescriptorPool(self.pool));
    }
}

/// Device buffers with this content, the copies that fill them, and a set for them: all, or nothing is left.
pub(super) fn fill<const N: usize>(
    context: &mut Context,
    program: &Program,
    pool: vk::DescriptorPool,
    streams: [(&str, Option<&[u8]>); N],
) -> Result<([Option<Buffer>; N], Upload, vk::DescriptorSet)> {
    let bytes = |data: Option<&[u8]>| data.map_or(0, |d| (d.len() as u64).next_multiple_of(16));
    let mut made = [const { None }; N];
    let all = (|| -> Result<(Upload, vk::DescriptorSet)> {
        for (to, (name, data)) in made.iter_mut().zip(streams) {
            if let Some(data) = data {
                // Bytes are read four at a time.
                let size = (data.len() as u64).next_multiple_of(4);
                *to = Some(Buffer::new(context, name, size, STREAM, Location::Device)?);
            }
        }
        let mut upload = Upload::new(context, streams.iter().map(|(_, data)| bytes(*data)).sum())?;
        for (to, (_, data)) in made.iter().zip(streams) {
            if let Some((to, data)) = to.as_ref().zip(data) {
                upload.write(to, data);
            }
        }
        match context.descriptor_sets(pool, &[program.sets[1]]) {
            Ok(sets) => Ok((upload, sets[0])),
            Err(e) => {
                upload.destroy(context);
                Err(e)
            }
        }
    })();
    match all {
        Ok((upload, set)) => Ok((made, upload, set)),
        Err(e) => {
            made.into_iter().flatten().for_each(|b| b.destroy(context));
            Err(e)
        }
    }
}

/// Points a chunk's set to its buffers, by binding.
pub(super) fn write_set(context: &Context, set: vk::DescriptorSet, buffers: [vk::Buffer; 7]) {
    let infos = buffers.map(|buffer| [vk::DescriptorBufferInfo { buffer, offset: 0, range: vk::WHOLE_SIZE }]);
    let writes: Vec<_> = (0..)
        .zip(&infos)
        // Without shaders that choose a layer, the set has no place for the groups.
        .filter(|(binding, _)| *binding != 3 || context.enabled.output_layer)
        .map(|(binding, info)| {
            vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(binding)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .buffer_info(info)
        })
        .collect();
    context.write_sets(&writes);
}

/// What the test of a chunk's points reads.
struct ChunkNodes {
    /// As in [`Nodes::links`], numbers of the chunk's own nodes.
    links: Vec<[u32; 2]>,
    /// As `glsl/shared/interval.glsl` has them.
    places: Vec<[f32; 4]>,
}

/// The nodes that points of a chunk refer to, each once, in the order in which they do: whatever the size of the cloud, a
/// chunk binds no more than its points need.
fn of_chunk(nodes: &Nodes, range: std::ops::Range<usize>) -> ChunkNodes {
    let mut local = vec![NONE; nodes.nodes.len()];
    let mut of = ChunkNodes { links: Vec::with_capacity(range.len()), places: Vec::new() };
    let mut known = 0;
    for link in &nodes.links[range] {
        of.links.push(link.map(|node| {
            if node == NONE {
                return NONE;
            }
            let place = &mut local[node as usize];
            if *place == NONE {
                *place = known;
                known += 1;
                let Node { position: [x, y, z], error, normal: [a, b, c], tangential } = nodes.nodes[node as usize];
                of.places.push([x, y, z, error]);
                if nodes.rule == ErrorRule::Split {
                    of.places.push([a, b, c, tangential]);
                }
            }
            *place
        }));
    }
    of
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chunk_has_the_nodes_that_it_refers_to() {
        let node = |n: u32| Node { position: [n as f32; 3], error: 0.5, normal: [0.0; 3], tangential: 0.25 };
        let links = vec![[0, NONE], [1, 0], [NONE, 1], [3, 0], [NONE, 3], [NONE, NONE]];
        let nodes = Nodes { links, nodes: (0..4).map(node).collect(), rule: ErrorRule::Geometric, tau_max: 0.1 };
        let chunk = of_chunk(&nodes, 2..6);
        assert_eq!(chunk.links, [[NONE, 0], [1, 2], [NONE, 1], [NONE, NONE]]);
        assert_eq!(chunk.places, [[1.0, 1.0, 1.0, 0.5], [3.0, 3.0, 3.0, 0.5], [0.0, 0.0, 0.0, 0.5]]);
        let split = of_chunk(&Nodes { rule: ErrorRule::Split, ..nodes }, 2..3);
        assert_eq!((split.links, split.places.len()), (vec![[NONE, 0]], 2));
    }
}
