//! Sequential point trees in a file, so that they are made once. The layout is in docs/FORMAT.md.

use std::io::{Read, Write};
use std::path::Path;

use glam::Vec3;

use super::{CLUSTERS, Cone, List, Options, Sequential};
use crate::error::{Error, Place, Result};
use crate::structure::Flat;
use crate::structure::file::{Header, Input, Output, flags, load, save};
use crate::structure::nodes::{ErrorRule, NONE, Node, Nodes};

const MAGIC: &[u8; 8] = b"surfelSQ";
const VERSION: u32 = 1;
/// Words of the header.
const HEADER: usize = 8;
/// Words of a list.
const LIST: usize = 13;

/// In the flags, above those of the points.
const CLUSTERED: u32 = 8;
const PUBLISHED: u32 = 16;
/// Above them.
const BLOCKS: u32 = 8;

impl List {
    fn words(&self) -> [u32; LIST] {
        let cone = self.cone.unwrap_or(Cone { axis: Vec3::ZERO, cosine: 0.0 });
        let ([a, b, c], [d, e, f], [x, y, z]) = (self.min.to_array(), self.max.to_array(), cone.axis.to_array());
        let floats = [a, b, c, d, e, f, self.reach, cone.cosine, x, y, z].map(f32::to_bits);
        std::array::from_fn(|i| if i < 2 { [self.first, self.count][i] } else { floats[i - 2] })
    }

    fn from_words(words: &[u32; LIST]) -> List {
        let f = |i: usize| f32::from_bits(words[i]);
        let v = |i: usize| Vec3::new(f(i), f(i + 1), f(i + 2));
        let cone = (words[9] != 0).then(|| Cone { axis: v(10), cosine: f(9) });
        List { first: words[0], count: words[1], min: v(2), max: v(5), reach: f(8), error: 0.0, cone }
    }
}

impl Sequential {
    fn header(&self) -> Header<HEADER> {
        let Options { rule, tau_max, color_error, .. } = self.options;
        let options = [(self.options.clusters, CLUSTERED), (self.options.published_errors, PUBLISHED)];
        let flags = options.iter().filter(|f| f.0).fold(flags(&self.flat), |flags, f| flags | f.1);
        let flags = flags | self.options.blocks << BLOCKS;
        let (lists, nodes) = (self.lists.len() as u32, self.nodes.nodes.len() as u32);
        let (tau_max, color_error) = (tau_max.to_bits(), color_error.to_bits());
        let words = [VERSION, flags, rule as u32, tau_max, color_error, lists, nodes, self.leaves];
        Header { words, origin: self.flat.origin, cloud: self.cloud }
    }

    /// Writes it, as built: what is packed is refused, since it is not what [`is_of`](Self::is_of) would compare.
    pub fn write(&self, to: &mut impl Write) -> std::io::Result<()> {
        let mut out = Output::new(to, &self.flat)?;
        self.body(&mut out)?;
        out.finish()
    }

    /// All but the checksum.
    pub(in crate::structure) fn body(&self, out: &mut Output<impl Write>) -> std::io::Result<()> {
        out.header(MAGIC, &self.header())?;
        for list in &self.lists {
            out.add(&list.words())?;
        }
        out.add(&self.nodes.nodes)?;
        out.add(&self.nodes.links)?;
        out.points(&self.flat)?;
        out.add(&self.levels)
    }

    /// Reads what [`write`](Self::write) wrote. `name` is for errors. See [`is_of`](Self::is_of) for whose it is.
    ///
    /// # Errors
    /// [`Error::Data`] with the byte for anything that was not written so, [`Error::Io`] where it cannot be read. Never more
    /// memory than a few times what the file has.
    pub fn read(from: &mut impl Read, name: &Path) -> Result<Sequential> {
        let mut input = Input::new(from, name);
        let body = Body::read(&mut input, None)?;
        input.finish()?;
        body.tree(name)
    }

    /// Writes a file: whole under its name, or not at all.
    pub fn save(&self, path: &Path) -> Result<()> {
        save(path, |to| self.write(to))
    }

    /// Reads a file, as [`read`](Self::read).
    pub fn load(path: &Path) -> Result<Sequential> {
        load(path, Sequential::read)
    }
}

/// What [`Sequential::body`] wrote, not yet looked at.
pub(in crate::structure) struct Body {
    header: Header<HEADER>,
    lists: Vec<[u32; LIST]>,
    nodes: Vec<Node>,
    links: Vec<[u32; 2]>,
    flat: Flat,
    levels: Vec<u8>,
    /// Where the header, the lists and the links begin.
    at: [u64; 3],
}

impl Body {
    /// Reads it. A tree without what is never drawn says how many entries it has.
    pub fn read(input: &mut Input<impl Read>, entries: Option<u64>) -> Result<Body> {
        let start = input.at();
        let header = input.header::<HEADER>(MAGIC, VERSION, "a sequential point tree")?;
        let [_, flags, _, _, _, lists, nodes, leaves] = header.words;
        let entries = entries.unwrap_or(leaves as u64 + nodes as u64);
        let lists_at = input.at();
        let lists = input.items(lists as u64)?;
        let nodes = input.items(nodes as u64)?;
        let links_at = input.at();
        let links = input.items(entries)?;
        let flat = input.points(flags, header.origin, entries)?;
        let levels = input.items(entries)?;
        Ok(Body { header, lists, nodes, links, flat, levels, at: [start, lists_at, links_at] })
    }

    /// Points of the cloud that the tree is of.
    pub fn leaves(&self) -> u32 {
        let [.., leaves] = self.header.words;
        leaves
    }

    /// The tree. What carries its checksum may still be someone else's.
    pub fn tree(self, name: &Path) -> Result<Sequential> {
        let Body { header: Header { words, cloud, .. }, lists, nodes, links, flat, levels, at } = self;
        let [_, flags, rule, tau_max, color_error, _, _, leaves] = words;
        let ([start, lists_at, links_at], entries) = (at, links.len() as u64);
        let bad = |at: u64, why: &str| Error::data(name, Place::Byte(at), why);
        let known = ErrorRule::ALL.iter().map(|(_, known)| *known).find(|known| *known as u32 == rule);
        let rule = known.ok_or_else(|| bad(start + 16, "no such rule"))?;
        let (tau_max, color_error) = (f32::from_bits(tau_max), f32::from_bits(color_error));
        if !(tau_max > 0.0 && tau_max <= 0.5) {
            return Err(bad(start + 20, "tau_max: more than 0, at most 1/2"));
        }
        if let Some(i) = links.iter().position(|link| link.iter().any(|&n| n != NONE && n as usize >= nodes.len())) {
            return Err(bad(links_at + 8 * i as u64, "a node beyond the last"));
        }
        let lists: Vec<List> = lists.iter().map(List::from_words).collect();
        let mut end = 0;
        for (i, list) in lists.iter().enumerate() {
            if list.first as u64 != end || list.count == 0 {
                return Err(bad(lists_at + (4 * LIST * i) as u64, "lists are not one after the other"));
            }
            end += list.count as u64;
        }
        if end != entries || flags >> BLOCKS == 0 && lists.len() > CLUSTERS + 2 {
            return Err(bad(start + 28, "lists are not those of the entries"));
        }
        let leaves_of = flat.geometry.iter().zip(&links).filter(|(_, link)| link[0] == NONE).map(|(g, _)| g);
        let finest = super::finest(leaves_of);
        let mut tree = Sequential {
            flat: Flat { finest: Some(finest), ..flat },
            nodes: Nodes { links, nodes, rule, tau_max },
            lists,
            levels,
            leaves,
            options: Options {
                rule,
                tau_max,
                clusters: flags & CLUSTERED != 0,
                blocks: flags >> BLOCKS,
                color_error,
                published_errors: flags & PUBLISHED != 0,
            },
            cloud,
            steps: Vec::new(),
        };
        tree.index();
        Ok(tree)
    }
}
