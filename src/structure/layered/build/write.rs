//! From finished nodes and their patches to the file.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use glam::Vec3;

use super::color::Colored;
use super::finish::Grown;
use super::spool::{BUFFER, Folder, Spool};
use crate::error::{Error, Result};
use crate::structure::layered::file::{head, head_bytes};
use crate::structure::layered::{Index, Node};
use crate::structure::morton::Cube;
use crate::structure::nodes::NONE;

/// A node in a list; links are numbers in that list.
struct Listed {
    node: Node,
    code: u64,
}

/// All nodes in the order of the repository, by level, then along the Morton curve; the places are still those of the
/// patches that were written.
pub(super) fn numbered(root: Grown) -> Vec<Node> {
    let cube = Cube::round(root.node.centre - root.node.ball, root.node.centre + root.node.ball);
    let mut listed: Vec<Listed> = Vec::new();
    let mut open: Vec<(Grown, u32, usize)> = vec![(root, NONE, 0)];
    while let Some((grown, parent, side)) = open.pop() {
        let number = listed.len() as u32;
        let node = Node { parent, ..grown.node };
        listed.push(Listed { code: cube.code(node.centre), node });
        if let Some(parent) = listed.get_mut(parent as usize) {
            parent.node.children[side] = number;
        }
        let children = grown.children.into_iter().enumerate();
        open.extend(children.filter_map(|(side, child)| child.map(|c| (*c, number, side))));
    }
    let mut order: Vec<u32> = (0..listed.len() as u32).collect();
    order.sort_by_key(|i| (listed[*i as usize].node.level, listed[*i as usize].code));
    let mut place = vec![NONE; listed.len()];
    for (new, old) in order.iter().enumerate() {
        place[*old as usize] = new as u32;
    }
    let moved = |i: u32| place.get(i as usize).copied().unwrap_or(NONE);
    let node = |old: &u32| {
        let n = listed[*old as usize].node;
        Node { parent: moved(n.parent), children: n.children.map(moved), ..n }
    };
    order.iter().map(node).collect()
}

/// Writes a model: whole and on the disk under its name, or not at all.
pub(super) fn write(
    index: &mut Index,
    patches: &Spool<u8>,
    colored: Option<&Colored>,
    to: &Path,
    folder: &Folder,
    progress: impl Fn(u64, u64),
) -> Result<()> {
    let total = patches.count();
    let from: Vec<(u64, u32)> = index.nodes.iter().map(|n| (n.at, n.bytes)).collect();
    let mut at = head_bytes(index.nodes.len());
    for (i, node) in index.nodes.iter_mut().enumerate() {
        if let Some(colored) = colored {
            (node.bytes, node.checksum) = (node.bytes + colored.frames[i].bytes, colored.frames[i].checksum);
        }
        node.at = at;
        at += node.bytes as u64;
    }
    let part = folder.whole();
    let copied = (|| {
        let mut out = BufWriter::with_capacity(BUFFER, File::create(&part).map_err(|e| folder.fails(e))?);
        out.write_all(&head(index)).map_err(|e| folder.fails(e))?;
        let (mut patch, mut done) = (Vec::new(), 0);
        for (i, (from, bytes)) in from.into_iter().enumerate() {
            patch.resize(index.nodes[i].bytes as usize, 0);
            let (own, groups) = patch.split_at_mut(bytes as usize);
            patches.read(from, own)?;
            if let Some(colored) = colored {
                colored.spool.read(colored.frames[i].at, groups)?;
            }
            out.write_all(&patch).map_err(|e| folder.fails(e))?;
            done += u64::from(bytes);
            progress(done, total);
        }
        let synced = out.into_inner().map_err(|e| e.into_error()).and_then(|file| file.sync_all());
        synced.and_then(|()| std::fs::rename(&part, to)).map_err(|e| folder.fails(e))
    })();
    if copied.is_err() {
        // What is left is of no use; that it cannot be removed changes nothing.
        let _ = std::fs::remove_file(&part);
        return copied;
    }
    // The new name is on the disk once its folder is. A file system that cannot do that keeps its own promises.
    let within = to.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    File::open(within).and_then(|f| f.sync_all()).or_else(|e| match e.kind() {
        std::io::ErrorKind::InvalidInput | std::io::ErrorKind::Unsupported => Ok(()),
        _ => Err(Error::io(to, e)),
    })
}

/// The largest distance of a box's corner from the origin: what is beyond floats is refused before it is grown.
pub(super) fn drawable(low: Vec3, high: Vec3) -> bool {
    low.abs().max(high.abs()).max_element() < 1e30
}
