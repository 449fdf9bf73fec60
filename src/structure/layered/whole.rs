//! All of a model at once: for truth, for tools, and for models that fit.

use super::{Index, Patch};
use crate::error::{Error, Result};
use crate::par;
use crate::stream::Access;
use crate::structure::{Flat, flat};

/// Patches that are read before they are decoded side by side.
const BATCH: usize = 64;

/// Reads every patch, decodes it, and hands it to `take` in the order of the nodes.
fn each(index: &Index, access: &dyn Access, mut take: impl FnMut(Patch)) -> Result<()> {
    let nodes: Vec<u32> = (0..index.nodes.len() as u32).collect();
    for batch in nodes.chunks(BATCH) {
        let mut bytes = Vec::with_capacity(batch.len());
        for &i in batch {
            let node = &index.nodes[i as usize];
            // No longer than the file, as the index was checked.
            let mut patch = vec![0; node.bytes as usize];
            access.read(node.at, &mut patch).map_err(Error::Stream)?;
            bytes.push((i, patch));
        }
        for patch in par::map(&bytes, |(node, bytes)| Patch::decode(index, *node, bytes)) {
            take(patch?);
        }
    }
    Ok(())
}

/// Reads and decodes every patch, and keeps none.
///
/// # Errors
/// The first that a patch has: [`Error::Stream`] or [`Error::Data`], with its place in the file.
pub fn verify(index: &Index, access: &dyn Access) -> Result<()> {
    each(index, access, |_| {})
}

/// Every sample of a model, each with its own radius, in the order of nodes and patches: what all patches draw together.
///
/// Takes what a [`Flat`] of so many points takes; at most 2³² − 1 of them.
///
/// # Errors
/// As [`verify`]; [`Error::Unsupported`] for more samples.
pub fn whole(index: &Index, access: &dyn Access) -> Result<Flat> {
    if index.samples() > u32::MAX as u64 {
        return Err(Error::Unsupported(format!("{}: {} samples in one array", index.name, index.samples())));
    }
    let mut flat = Flat { origin: index.origin, closed: index.closed, ..Flat::default() };
    flat.normals = index.normals.then(Vec::new);
    flat.colors = index.colors.then(Vec::new);
    each(index, access, |patch| {
        flat.geometry.extend(patch.positions.iter().zip(&patch.radii).map(|([x, y, z], r)| [*x, *y, *z, *r]));
        flat.normals.iter_mut().for_each(|all| all.extend(patch.normals.iter().flatten()));
        flat.colors.iter_mut().for_each(|all| all.extend(patch.colors.iter().flatten()));
    })?;
    flat.blocks = flat::blocks(flat.geometry.len(), |i| flat.geometry[i]);
    Ok(flat)
}
