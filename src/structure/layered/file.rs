//! The head of a model's file: header and index, which are read whole, apart from the patches behind them.
//!
//! See docs/FORMAT.md. All numbers are little-endian.

use glam::{DVec3, Vec3};

use super::{Index, MAX_LEVEL, MAX_SAMPLES, Node};
use crate::error::{Error, Place, Result};
use crate::stream::Access;
use crate::structure::file::Fnv;
use crate::structure::nodes::NONE;

const MAGIC: &[u8; 8] = b"surfelLP";
const VERSION: u32 = 1;
/// Bytes of the header.
const HEADER: usize = 112;
/// Bytes of a node.
const NODE: usize = 88;
/// Of a root's patch that is fetched with the index at most.
const EXPECTED: u32 = 1 << 20;

const NORMALS: u32 = 1;
const COLORS: u32 = 2;
const CLOSED: u32 = 4;
const EXACT: u32 = 8;
const UP: u32 = 16;
const LATTICE: u32 = 32;
const GROUPS: u32 = 64;

/// Whether a file that begins with these bytes is a model.
pub fn is_model(start: &[u8]) -> bool {
    start.starts_with(MAGIC)
}

/// Bytes before the first patch of a model with so many nodes.
pub(super) fn head_bytes(nodes: usize) -> u64 {
    (HEADER + nodes * NODE + 8) as u64
}

struct Writer(Vec<u8>);

impl Writer {
    fn words(&mut self, words: &[u32]) {
        words.iter().for_each(|w| self.0.extend(w.to_le_bytes()));
    }

    fn longs(&mut self, longs: &[u64]) {
        longs.iter().for_each(|w| self.0.extend(w.to_le_bytes()));
    }

    fn floats(&mut self, floats: &[f32]) {
        floats.iter().for_each(|w| self.0.extend(w.to_le_bytes()));
    }

    fn vector(&mut self, v: DVec3) {
        self.longs(&v.to_array().map(f64::to_bits));
    }
}

/// Header and index as bytes. Patches follow each other from [`head_bytes`] on, in the order of the nodes.
pub(super) fn head(index: &Index) -> Vec<u8> {
    let flags = [
        (index.normals, NORMALS),
        (index.colors, COLORS),
        (index.closed, CLOSED),
        (index.exact, EXACT),
        (index.up.is_some(), UP),
        (index.lattice.is_some(), LATTICE),
        (index.groups.is_some(), GROUPS),
    ];
    let mut out = Writer(MAGIC.to_vec());
    out.words(&[VERSION, flags.iter().filter(|f| f.0).map(|f| f.1).sum(), index.nodes.len() as u32, NODE as u32]);
    let samples = index.nodes.iter().map(|n| n.samples as u64).sum();
    let size = index.nodes.last().map_or(head_bytes(0), |n| n.at + n.bytes as u64);
    out.longs(&[HEADER as u64, samples, size]);
    out.vector(index.origin);
    out.vector(index.lattice.unwrap_or_default());
    out.floats(&index.up.unwrap_or_default().to_array());
    out.words(&[index.groups.unwrap_or(0)]);
    for n in &index.nodes {
        out.floats(&[n.centre.x, n.centre.y, n.centre.z, n.ball, n.reach, n.axis.x, n.axis.y, n.axis.z, n.cone]);
        out.floats(&[n.spacing, n.published, n.plane]);
        out.words(&[n.split as u32 | (n.level as u32) << 8, n.children[0], n.children[1], n.parent, n.samples]);
        out.longs(&[n.at, n.checksum]);
        out.words(&[n.bytes]);
    }
    let mut hash = Fnv::NEW;
    hash.add(&out.0);
    out.longs(&[hash.0]);
    out.0
}

/// Takes numbers off the front of bytes that are long enough.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        match self.0.split_first_chunk::<N>() {
            Some((taken, rest)) => {
                self.0 = rest;
                *taken
            }
            None => [0; N],
        }
    }

    fn word(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn long(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }

    fn float(&mut self) -> f32 {
        f32::from_bits(self.word())
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| f64::from_bits(self.long())))
    }

    fn triple(&mut self) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|_| self.float()))
    }
}

impl Index {
    /// Reads the index of a model: two reads, of the header and of what it says is the index.
    ///
    /// Everything is checked before it is believed: the checksum, that the file has the size that it had when it was
    /// written, that patches follow each other up to its end, that nodes make up one tree from the root on and lie in the
    /// order of levels, that nothing grows down the tree that must not. Takes memory for an index that is there in full.
    ///
    /// # Errors
    /// [`Error::Stream`] where bytes do not come, [`Error::Data`] with file and byte for the rest.
    pub fn read(access: &dyn Access) -> Result<Index> {
        let fail = |at: u64, why: String| Error::data(access.name(), Place::Byte(at), why);
        if access.size() < HEADER as u64 {
            return Err(fail(access.size(), "the file ends inside the header of a layered point cloud".into()));
        }
        // With the root, which there always is.
        let mut bytes = vec![0; access.size().min((HEADER + NODE) as u64) as usize];
        access.read(0, &mut bytes).map_err(Error::Stream)?;
        if !is_model(&bytes) {
            return Err(fail(0, "this is no layered point cloud: it does not start with `surfelLP`".into()));
        }
        let mut header = Reader(&bytes[8..]);
        let (version, flags, count, stride) = (header.word(), header.word(), header.word(), header.word());
        if version != VERSION {
            return Err(fail(8, format!("version {version} is not known, only {VERSION}")));
        }
        let (at, samples, size) = (header.long(), header.long(), header.long());
        let end = HEADER as u64 + count as u64 * NODE as u64 + 8;
        if stride as usize != NODE || at != HEADER as u64 || flags >= 2 * GROUPS || count == 0 {
            return Err(fail(12, "the header makes no sense".into()));
        }
        if size != access.size() || end > size {
            let why = format!("the file has {} bytes, and {size} when it was written", access.size());
            return Err(fail(access.size().min(size), why));
        }
        let (origin, lattice, up) = (header.vector(), header.vector(), header.triple());
        let groups = Some(header.word()).filter(|_| flags & GROUPS != 0);
        if groups.is_some_and(|count| !(1..=256).contains(&count)) {
            return Err(fail(108, "the number of groups is not 1 to 256".into()));
        }
        // The root's patch follows the index: no picture is without it. Nothing is checked yet, so that has a bound.
        let root = node(&mut Reader(&bytes[HEADER..])).bytes.min(EXPECTED);
        access.expect((end + u64::from(root)).min(size));
        let begun = bytes.len();
        bytes.resize(end as usize, 0);
        access.read(begun as u64, &mut bytes[begun..]).map_err(Error::Stream)?;
        let (body, sum) = bytes.split_at(end as usize - 8);
        let mut hash = Fnv::NEW;
        hash.add(body);
        if Reader(sum).long() != hash.0 {
            return Err(fail(end - 8, "the index's checksum differs: the file was altered".into()));
        }
        let mut reader = Reader(&body[HEADER..]);
        let nodes: Vec<Node> = (0..count).map(|_| node(&mut reader)).collect();
        let index = Index {
            origin,
            nodes,
            normals: flags & NORMALS != 0,
            colors: flags & COLORS != 0,
            closed: flags & CLOSED != 0,
            up: (flags & UP != 0).then_some(up),
            exact: flags & EXACT != 0,
            lattice: (flags & LATTICE != 0).then_some(lattice),
            groups,
            name: access.name().to_owned(),
        };
        if !(origin.is_finite() && lattice.is_finite() && up.is_finite()) {
            return Err(fail(48, "the origin, the lattice or the way up is no number".into()));
        }
        check(&index, end, size).map_err(|(node, why)| fail(at + node as u64 * NODE as u64, why))?;
        if index.nodes.iter().map(|n| n.samples as u64).sum::<u64>() != samples {
            return Err(fail(32, "the nodes have another number of samples than the header says".into()));
        }
        Ok(index)
    }

    /// Samples of all patches.
    pub fn samples(&self) -> u64 {
        self.nodes.iter().map(|n| n.samples as u64).sum()
    }
}

fn node(from: &mut Reader) -> Node {
    let (centre, ball, reach, axis, cone) = (from.triple(), from.float(), from.float(), from.triple(), from.float());
    let (spacing, published, plane) = (from.float(), from.float(), from.float());
    let (kind, children) = (from.word(), [from.word(), from.word()]);
    let (parent, samples, at, checksum, bytes) = (from.word(), from.word(), from.long(), from.long(), from.word());
    let (split, level) = (kind as u8, (kind >> 8) as u8);
    // What is above the two bytes is nothing that this version writes.
    let split = if kind >> 16 == 0 { split } else { u8::MAX };
    Node {
        centre,
        ball,
        reach,
        axis,
        cone,
        spacing,
        published,
        split,
        plane,
        children,
        parent,
        level,
        samples,
        at,
        bytes,
        checksum,
    }
}

/// One tree, in order, of patches that follow each other; which node is wrong, and why.
fn check(index: &Index, first: u64, size: u64) -> Result<(), (usize, String)> {
    let nodes = &index.nodes;
    let mut at = first;
    for (i, n) in nodes.iter().enumerate() {
        let fail = |why: &str| Err((i, format!("node {i}: {why}")));
        if n.samples == 0 || n.samples > MAX_SAMPLES {
            return fail(&format!("{} samples, of at most {MAX_SAMPLES}", n.samples));
        }
        if n.at != at || size - at < n.bytes as u64 {
            return fail("its patch does not follow the one before, or is beyond the end");
        }
        at += n.bytes as u64;
        let lengths = [n.ball, n.reach, n.spacing, n.published];
        let whole = lengths.iter().all(|v| *v >= 0.0 && v.is_finite());
        if !(whole && n.spacing > 0.0 && n.reach > 0.0) {
            return fail("a length is no number, or negative");
        }
        if !n.centre.is_finite() || !n.axis.is_finite() || !(-1.0..=1.0).contains(&n.cone) || !n.plane.is_finite() {
            return fail("a centre, an axis or a plane is no number");
        }
        if n.split > 3 || (n.split == 3) != (n.children == [NONE; 2]) || n.level > MAX_LEVEL {
            return fail("it is neither a leaf nor cut along an axis, or too deep");
        }
        let parent = nodes.get(n.parent as usize);
        match parent {
            None if i == 0 && n.parent == NONE && n.level == 0 => {}
            // A parent is before its children, so there is no cycle; it names each, so there is no other parent.
            Some(p) if (n.parent as usize) < i && p.children.contains(&(i as u32)) => {
                if n.level != p.level + 1 || n.spacing > p.spacing || n.reach > p.reach {
                    return fail("its level, spacing or reach does not fit its parent's");
                }
            }
            _ => return fail("it is not its parent's child"),
        }
        if i > 0 && n.level < nodes[i - 1].level {
            return fail("it is not in the order of levels");
        }
        for c in n.children() {
            let child = nodes.get(c as usize);
            if n.children[0] == n.children[1] || child.is_none_or(|c| c.parent != i as u32) {
                return fail("a child is not its own");
            }
        }
    }
    if at != size {
        return Err((nodes.len() - 1, "there is more after the last patch".into()));
    }
    Ok(())
}
