//! Hybrids in a file, so that they are made once. The layout is in docs/FORMAT.md.

use std::io::{Read, Write};
use std::path::Path;

use super::{Hybrid, Triangles};
use crate::error::{Error, Place, Result};
use crate::structure::file::{Header, Input, Output, flags, load, save};
use crate::structure::sequential::{Body, finest};

const MAGIC: &[u8; 8] = b"surfelHY";
const VERSION: u32 = 1;
/// Words of the header.
const HEADER: usize = 4;

impl Hybrid {
    /// Writes it, as built: what is packed is refused, since it is not what [`is_of`](Self::is_of) would compare.
    pub fn write(&self, to: &mut impl Write) -> std::io::Result<()> {
        let (tree, triangles) = (&self.tree, &self.triangles);
        let vertices = &triangles.vertices;
        let mut out = Output::new(to, &tree.flat)?;
        let words = [VERSION, flags(vertices), tree.flat.len() as u32, triangles.len() as u32];
        out.header(MAGIC, &Header { words, origin: vertices.origin, cloud: self.mesh })?;
        tree.body(&mut out)?;
        out.points(vertices)?;
        out.add(&triangles.corners)?;
        out.add(&triangles.sizes)?;
        out.finish()
    }

    /// Reads what [`write`](Self::write) wrote. `name` is for errors. See [`is_of`](Self::is_of) for whose it is.
    ///
    /// # Errors
    /// [`Error::Data`] with the byte for anything that was not written so, [`Error::Io`] where it cannot be read. Never more
    /// memory than a few times what the file has.
    pub fn read(from: &mut impl Read, name: &Path) -> Result<Hybrid> {
        let mut input = Input::new(from, name);
        let Header { words, origin, cloud: mesh } = input.header::<HEADER>(MAGIC, VERSION, "a hybrid")?;
        let [_, flags, entries, faces] = words;
        let body = Body::read(&mut input, Some(entries as u64))?;
        let vertices = input.points(flags, origin, body.leaves() as u64)?;
        let corners_at = input.at();
        let corners: Vec<[u32; 3]> = input.items(faces as u64)?;
        let sizes: Vec<f32> = input.items(faces as u64)?;
        input.finish()?;

        let mut tree = body.tree(name)?;
        // Of all points, those under triangles too.
        tree.flat.finest = Some(finest(&vertices.geometry));
        let bad = |(face, why): (usize, &str)| Error::data(name, Place::Byte(corners_at + 12 * face as u64), why);
        let triangles = Triangles::stored(vertices, corners, sizes).map_err(bad)?;
        Ok(Hybrid { tree, triangles, mesh })
    }

    /// Writes a file: whole under its name, or not at all.
    pub fn save(&self, path: &Path) -> Result<()> {
        save(path, |to| self.write(to))
    }

    /// Reads a file, as [`read`](Self::read).
    pub fn load(path: &Path) -> Result<Hybrid> {
        load(path, Hybrid::read)
    }
}
