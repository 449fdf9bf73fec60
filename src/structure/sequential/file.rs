//! Sequential point trees in a file, so that they are made once. The layout is in docs/FORMAT.md.

use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::Path;

use glam::{DVec3, Vec3};

use super::{CLUSTERS, Cone, List, Options, Sequential};
use crate::error::{Error, Place, Result};
use crate::structure::Flat;
use crate::structure::file::{Input, Output, save};
use crate::structure::flat::blocks;
use crate::structure::nodes::{ErrorRule, NONE, Node, Nodes};

const MAGIC: &[u8; 8] = b"surfelSQ";
const VERSION: u32 = 1;
/// Bytes before the lists.
const HEADER: usize = 72;
/// Words of a list.
const LIST: usize = 13;

/// In the flags.
const NORMALS: u32 = 1;
const COLORS: u32 = 2;
const CLOSED: u32 = 4;
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
    /// The header: little-endian, in this order.
    fn header(&self) -> Vec<u8> {
        let (flat, options) = (&self.flat, &self.options);
        let flags = [
            (flat.normals.is_some(), NORMALS),
            (flat.colors.is_some(), COLORS),
            (flat.closed, CLOSED),
            (options.clusters, CLUSTERED),
            (options.published_errors, PUBLISHED),
        ];
        let flags = flags.iter().filter(|f| f.0).map(|f| f.1).sum::<u32>() | options.blocks << BLOCKS;
        let mut header = Vec::with_capacity(HEADER);
        header.extend(MAGIC);
        let words = [VERSION, flags, options.rule as u32, options.tau_max.to_bits(), options.color_error.to_bits()];
        let counts = [self.lists.len() as u32, self.nodes.nodes.len() as u32, self.leaves];
        for word in words.into_iter().chain(counts) {
            header.extend(word.to_le_bytes());
        }
        for number in flat.origin.to_array().map(f64::to_bits).into_iter().chain([self.cloud]) {
            header.extend(number.to_le_bytes());
        }
        header
    }

    /// Writes it.
    pub fn write(&self, to: &mut impl Write) -> std::io::Result<()> {
        let mut out = Output::new(to);
        out.add(&self.header())?;
        for list in &self.lists {
            out.add(&list.words())?;
        }
        out.add(&self.nodes.nodes)?;
        out.add(&self.nodes.links)?;
        out.add(&self.flat.geometry)?;
        for stream in [&self.flat.normals, &self.flat.colors].into_iter().flatten() {
            out.add(stream)?;
        }
        out.add(&self.levels)?;
        out.finish()
    }

    /// Reads what [`write`](Self::write) wrote. `name` is for errors. See [`is_of`](Self::is_of) for whose it is.
    ///
    /// # Errors
    /// [`Error::Data`] with the byte for anything that was not written so, [`Error::Io`] where it cannot be read. Never more
    /// memory than a few times what the file has.
    pub fn read(from: &mut impl Read, name: &Path) -> Result<Sequential> {
        let mut input = Input::new(from, name);
        let bad = |at: u64, why: &str| Error::data(name, Place::Byte(at), why);
        let mut header = [0; HEADER];
        input.fill(&mut header)?;
        let word = |i: usize| u32::from_le_bytes(std::array::from_fn(|k| header[8 + 4 * i + k]));
        let number = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| header[40 + 8 * i + k]));
        if &header[..8] != MAGIC {
            return Err(bad(0, "not a file of a sequential point tree"));
        }
        if word(0) != VERSION {
            return Err(bad(8, &format!("version {}: this program reads {VERSION}", word(0))));
        }
        let (flags, leaves) = (word(1), word(7));
        let entries = leaves as u64 + word(6) as u64;
        let lists: Vec<[u32; LIST]> = input.items(word(5) as u64)?;
        let nodes: Vec<Node> = input.items(word(6) as u64)?;
        let links_at = input.at();
        let links: Vec<[u32; 2]> = input.items(entries)?;
        let geometry: Vec<[f32; 4]> = input.items(entries)?;
        let mut stream = |flag: u32| if flags & flag != 0 { input.items(entries).map(Some) } else { Ok(None) };
        let (normals, colors) = (stream(NORMALS)?, stream(COLORS)?);
        let levels: Vec<u8> = input.items(entries)?;
        input.finish()?;

        // What carries its checksum may still be someone else's.
        let rule = ErrorRule::ALL.iter().map(|(_, rule)| *rule).find(|rule| *rule as u32 == word(2));
        let rule = rule.ok_or_else(|| bad(16, "no such rule"))?;
        let (tau_max, color_error) = (f32::from_bits(word(3)), f32::from_bits(word(4)));
        if !(tau_max > 0.0 && tau_max <= 0.5) {
            return Err(bad(20, "tau_max: more than 0, at most 1/2"));
        }
        if let Some(i) = links.iter().position(|link| link.iter().any(|&n| n != NONE && n as usize >= nodes.len())) {
            return Err(bad(links_at + 8 * i as u64, "a node beyond the last"));
        }
        let lists: Vec<List> = lists.iter().map(List::from_words).collect();
        let mut end = 0;
        for (i, list) in lists.iter().enumerate() {
            if list.first as u64 != end || list.count == 0 {
                return Err(bad((HEADER + 4 * LIST * i) as u64, "lists are not one after the other"));
            }
            end += list.count as u64;
        }
        if end != entries || flags >> BLOCKS == 0 && lists.len() > CLUSTERS + 2 {
            return Err(bad(28, "lists are not those of the entries"));
        }
        let leaves_of = geometry.iter().zip(&links).filter(|(_, link)| link[0] == NONE).map(|(g, _)| g);
        let finest = super::finest(leaves_of);
        let mut tree = Sequential {
            flat: Flat {
                origin: DVec3::from_array([0, 1, 2].map(|i| f64::from_bits(number(i)))),
                blocks: blocks(geometry.len(), |i| geometry[i]),
                geometry,
                normals,
                colors,
                closed: flags & CLOSED != 0,
                groups: None,
                finest: Some(finest),
                packed: None,
            },
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
            cloud: number(3),
            steps: Vec::new(),
        };
        tree.index();
        Ok(tree)
    }

    /// Writes a file: whole under its name, or not at all.
    pub fn save(&self, path: &Path) -> Result<()> {
        save(path, |to| self.write(to))
    }

    /// Reads a file, as [`read`](Self::read).
    pub fn load(path: &Path) -> Result<Sequential> {
        let file = File::open(path).map_err(|e| Error::io(path, e))?;
        Sequential::read(&mut BufReader::new(file), path)
    }
}
