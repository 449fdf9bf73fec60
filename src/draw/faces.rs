//! A mesh's faces on the device: chunks with vertices of their own, that fit the smallest storage-buffer range.

use ash::vk;

use crate::error::Result;
use crate::gpu::Context;
use crate::gpu::program::Program;
use crate::gpu::resource::Buffer;
use crate::gpu::upload::Upload;
use crate::select::Span;
use crate::structure::hybrid::Triangles;
use crate::structure::octahedral;

use super::cloud::fill;

/// Faces a chunk: even without a shared vertex, three of 20 B each stay below the least `maxStorageBufferRange` of 128 MiB.
pub const CHUNK: usize = 1 << 21;

/// A vertex as `glsl/shared/triangle.glsl` has it.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Vertex {
    position: [f32; 3],
    normal: u32,
    color: u32,
}

const _: () = assert!(3 * CHUNK * size_of::<Vertex>() <= 1 << 27);

/// Consecutive faces in buffers of their own.
#[derive(Debug)]
pub struct Faces {
    /// Index of the first face in the cloud.
    pub first: u32,
    /// Number of faces.
    pub count: u32,
    /// Vertices, then corners and sizes.
    pub buffers: [Buffer; 2],
    /// Both, in the place of a chunk of points.
    pub set: vk::DescriptorSet,
}

/// Consecutive faces of a chunk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceRun {
    /// Index into the cloud's chunks of faces.
    pub chunk: usize,
    /// First face in the chunk.
    pub first: u32,
    /// Number of faces.
    pub count: u32,
}

/// Spans as runs, cut where chunks end; what is not on the device yet is left out.
pub fn face_runs(spans: &[Span], resident: usize) -> Vec<FaceRun> {
    let mut runs = Vec::new();
    for span in spans {
        let (mut at, end) = (span.first as usize, (span.first as usize + span.count as usize).min(resident));
        while at < end {
            let chunk = at / CHUNK;
            let stop = end.min((chunk + 1) * CHUNK);
            runs.push(FaceRun { chunk, first: (at % CHUNK) as u32, count: (stop - at) as u32 });
            at = stop;
        }
    }
    runs
}

impl Faces {
    /// Makes the chunk that begins at this face and the copies that fill it.
    pub fn upload(
        context: &mut Context,
        program: &Program,
        pool: vk::DescriptorPool,
        triangles: &Triangles,
        first: usize,
    ) -> Result<(Faces, Upload)> {
        let count = (triangles.len() - first).min(CHUNK);
        let (vertices, faces) = of_chunk(triangles, first..first + count);
        let streams =
            [("vertices", Some(bytemuck::cast_slice(&vertices))), ("faces", Some(bytemuck::cast_slice(&faces)))];
        let ([Some(vertices), Some(faces)], upload, set) = fill(context, program, pool, streams)? else {
            unreachable!("both were given")
        };
        let buffers = [vertices, faces];
        // What these shaders do not read is stood in for.
        let handles = [0, 1, 1, 1, 1, 1, 1].map(|i: usize| buffers[i].handle);
        super::cloud::write_set(context, set, handles);
        Ok((Faces { first: first as u32, count: count as u32, buffers, set }, upload))
    }
}

/// Vertices that faces of a chunk refer to, each once, in the order in which they do; corners and sizes.
fn of_chunk(triangles: &Triangles, range: std::ops::Range<usize>) -> (Vec<Vertex>, Vec<[u32; 4]>) {
    let flat = &triangles.vertices;
    let mut local = vec![u32::MAX; flat.len()];
    let mut vertices = Vec::new();
    let word = |stream: &Option<Vec<u32>>, i: usize, absent: u32| stream.as_ref().map_or(absent, |s| s[i]);
    let face = |i: usize| {
        let [a, b, c] = triangles.corners[i].map(|corner| {
            let place = &mut local[corner as usize];
            if *place == u32::MAX {
                *place = vertices.len() as u32;
                vertices.push(Vertex {
                    position: flat.position(corner).to_array(),
                    normal: word(&flat.normals, corner as usize, octahedral::NONE),
                    color: word(&flat.colors, corner as usize, 0),
                });
            }
            *place
        });
        [a, b, c, triangles.sizes[i].to_bits()]
    };
    let faces = range.map(face).collect();
    (vertices, faces)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_faces_end_where_chunks_do() {
        let span =
            |first: usize, count: usize| Span { instance: 0, first: first as u32, count: count as u32, least: 0.0 };
        let spans = [span(3, 4), span(CHUNK - 1, CHUNK + 2), span(3 * CHUNK, 10)];
        let found: Vec<_> = face_runs(&spans, 3 * CHUNK + 4).iter().map(|r| (r.chunk, r.first, r.count)).collect();
        let whole = CHUNK as u32;
        assert_eq!(found, [(0, 3, 4), (0, whole - 1, 1), (1, 0, whole), (2, 0, 1), (3, 0, 4)]);
    }
}
