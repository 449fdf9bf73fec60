//! All of a model at once: for truth, for tools, and for models that fit.

use super::{Index, Node, Patch};
use crate::error::{Error, Result};
use crate::par;
use crate::stream::Access;
use crate::structure::groups::Groups;
use crate::structure::{Flat, flat};

/// Patches that are read before they are decoded side by side.
const BATCH: usize = 64;

/// Reads every patch, decodes it, and hands it to `take` in the order of the nodes.
fn each(index: &Index, access: &dyn Access, count: usize, mut take: impl FnMut(Patch)) -> Result<()> {
    let nodes: Vec<u32> = (0..count as u32).collect();
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
    each(index, access, index.nodes.len(), |_| {})
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
    first(index, access, index.nodes.len())
}

/// The samples of the first nodes, coarse to fine, as [`whole`] has them: at most so many, but those of the root in any case. What
/// a model looks like from afar, where it lies, how large it is.
///
/// # Errors
/// As [`verify`].
pub fn coarse(index: &Index, access: &dyn Access, samples: u64) -> Result<Flat> {
    let mut sum = 0;
    let fits = |node: &&Node| {
        sum += node.samples as u64;
        sum <= samples
    };
    let count = index.nodes.iter().take_while(fits).count();
    first(index, access, count.max(index.nodes.len().min(1)))
}

fn first(index: &Index, access: &dyn Access, count: usize) -> Result<Flat> {
    let mut flat = Flat { origin: index.origin, closed: index.closed, ..Flat::default() };
    flat.normals = index.normals.then(Vec::new);
    flat.colors = index.colors.then(Vec::new);
    flat.groups = index.groups.map(|count| Groups { count, overlapping: true, ..Groups::default() });
    each(index, access, count, |patch| {
        flat.geometry.extend(patch.positions.iter().zip(&patch.radii).map(|([x, y, z], r)| [*x, *y, *z, *r]));
        flat.normals.iter_mut().for_each(|all| all.extend(patch.normals.iter().flatten()));
        flat.colors.iter_mut().for_each(|all| all.extend(patch.colors.iter().flatten()));
        flat.groups.iter_mut().for_each(|all| all.of.extend(patch.groups.iter().flatten()));
    })?;
    flat.blocks = flat::blocks(flat.geometry.len(), |i| flat.geometry[i]);
    Ok(flat)
}
