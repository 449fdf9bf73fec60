//! PLY: header by our own grammar, rows by column loops, the uncommon rest by `ply-rs`.

mod ascii;
mod faces;
mod header;
mod listed;
#[cfg(feature = "layered")]
mod pieces;
mod repair;
mod splat;
mod table;
mod vertices;

use std::path::Path;

use super::{Mesh, Options, PointCloud};
use crate::error::{Error, Place, Result};
use ascii::Lines;
use faces::Faces;
use header::{Element, Encoding, Header};
#[cfg(feature = "layered")]
pub(super) use pieces::pieces;
use table::Table;

/// Reads a whole file.
pub(super) fn read(file: &Path, bytes: &[u8], options: &Options) -> Result<PointCloud> {
    let header = header::parse(file, bytes)?;
    let vertex = header.elements.iter().find(|e| e.name == "vertex");
    let Some(vertex) = vertex else {
        return Err(Error::data(file, Place::File, "the file has no element vertex: there are no points in it"));
    };
    check_position(file, &header, vertex)?;
    options.report(0, vertex.count);
    let mut faces = Faces::new(vertex.count);
    let rows = match header.encoding {
        Encoding::Ascii => text(file, bytes, &header, &mut faces, options)?,
        _ => binary(file, bytes, &header, &mut faces)?,
    };
    let mut cloud = vertices::cloud(file, &rows)?;
    drop(rows);
    cloud.report.points_in_file = vertex.count;
    cloud.report.format = match header.encoding {
        Encoding::Ascii => "PLY ascii",
        Encoding::Little => "PLY binary little-endian",
        Encoding::Big => "PLY binary big-endian",
    }
    .to_owned();
    vertices::note_unused(vertex, &mut cloud.report);
    faces.note(&mut cloud.report);
    if !faces.triangles.is_empty() {
        cloud.mesh = Some(Mesh { triangles: faces.triangles });
    }
    vertices::clean(&mut cloud);
    options.report(vertex.count, vertex.count);
    super::finish(cloud, file)
}

/// Without a position nothing else matters; the files that hide it elsewhere get a word about that.
fn check_position(file: &Path, header: &Header, vertex: &Element) -> Result<()> {
    let scalar = |name: &str| vertex.properties.iter().any(|p| p.name == name && p.list.is_none());
    let Some(missing) = ["x", "y", "z"].into_iter().find(|name| !scalar(name)) else { return Ok(()) };
    let packed = scalar("packed_position") && header.elements.iter().any(|e| e.name == "chunk");
    let why = if packed {
        "this is a compressed splat PLY (PlayCanvas, SuperSplat): positions are packed into chunks, which is not read \
         yet; export it as an uncompressed PLY"
            .to_owned()
    } else {
        format!("the vertices have no property {missing}")
    };
    Err(Error::data(file, Place::File, why))
}

fn binary<'a>(file: &Path, bytes: &'a [u8], header: &Header, faces: &mut Faces) -> Result<Table<'a>> {
    let mut at = header.body;
    let mut rows = None;
    for element in &header.elements {
        let start = at;
        if element.name != "vertex" {
            at = faces::binary(file, bytes, start, element, header.encoding, Some(faces))?;
        } else if element.stride().is_some() {
            at = faces::binary(file, bytes, start, element, header.encoding, None)?;
            rows = Table::in_place(&bytes[start..at], element, header.encoding);
        } else {
            let (table, end) = listed::binary(file, bytes, start, element, header.encoding)?;
            (rows, at) = (Some(table), end);
        }
    }
    rows.ok_or_else(|| Error::data(file, Place::File, "the file has no element vertex"))
}

fn text(file: &Path, bytes: &[u8], header: &Header, faces: &mut Faces, options: &Options) -> Result<Table<'static>> {
    let mut lines = Lines::new(bytes, header);
    let mut rows = None;
    for element in &header.elements {
        if element.name != "vertex" {
            faces::text(file, &mut lines, element, faces)?;
        } else if element.stride().is_some() {
            let progress = |row| options.report(row, element.count);
            rows = Some(ascii::rows(file, &mut lines, element, vertices::is_known, progress)?);
        } else {
            rows = Some(listed::text(file, &mut lines, element)?);
        }
    }
    rows.ok_or_else(|| Error::data(file, Place::File, "the file has no element vertex"))
}
