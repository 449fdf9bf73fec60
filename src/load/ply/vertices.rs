//! Which columns mean what, and how they become a cloud.

use std::path::Path;

use glam::{DVec3, Vec3};

use super::header::{Element, Scalar};
use super::table::{BLOCK, Field, Table};
use super::{repair, splat};
use crate::error::{Error, Place, Result};
use crate::load::{PointCloud, Report, clean};
use crate::par;

const COLORS: [[&str; 3]; 2] = [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];
const ALPHAS: [&str; 2] = ["alpha", "diffuse_alpha"];
const INTENSITIES: [&str; 4] = ["intensity", "Intensity", "scalar_intensity", "scalar_Intensity"];
const PLAIN: [&str; 7] = ["x", "y", "z", "nx", "ny", "nz", "radius"];

/// Whether a column is used, in one way or another.
pub(super) fn is_known(name: &str) -> bool {
    PLAIN.contains(&name)
        || COLORS.as_flattened().contains(&name)
        || ALPHAS.contains(&name)
        || INTENSITIES.contains(&name)
        || splat::is_known(name)
}

/// Whether a column is a channel of a colour.
#[cfg(feature = "layered")]
pub(super) fn is_color(name: &str) -> bool {
    COLORS.as_flattened().contains(&name)
}

/// Names the columns that nothing is made of.
pub(super) fn note_unused(vertex: &Element, report: &mut Report) {
    let is_splat = splat::NAMES.iter().all(|n| vertex.properties.iter().any(|p| p.name == *n));
    let unused = |name: &str| match is_splat {
        true => !(["x", "y", "z"].contains(&name) || splat::is_known(name)),
        false => !is_known(name) || splat::is_known(name),
    };
    let mut names: Vec<&str> = vertex.properties.iter().map(|p| p.name.as_str()).filter(|n| unused(n)).collect();
    let harmonics = names.iter().filter(|n| n.starts_with("f_rest_")).count();
    if is_splat && harmonics > 0 {
        names.retain(|n| !n.starts_with("f_rest_"));
        report.assume(format!("{harmonics} coefficients of view-dependent colour are not used"));
    }
    if names.contains(&"psz") {
        report.assume("psz is a point size for the screen, not a radius: it is not used");
        names.retain(|n| *n != "psz");
    }
    if !names.is_empty() {
        let more = if names.len() > 12 { format!(" and {} more", names.len() - 12) } else { String::new() };
        names.truncate(12);
        report.assume(format!("properties not used: {}{more}", names.join(", ")));
    }
}

/// All rows as a cloud, broken ones included; [`clean`] follows once the faces are known.
pub(super) fn cloud(file: &Path, rows: &Table) -> Result<PointCloud> {
    let Some(xyz) = rows.fields(["x", "y", "z"]) else {
        return Err(Error::data(file, Place::File, "the vertices have no position"));
    };
    about(rows, xyz, origin(rows, xyz))
}

/// The same with offsets from an origin that is given.
pub(super) fn about(rows: &Table, xyz: [Field; 3], origin: DVec3) -> Result<PointCloud> {
    let mut cloud = PointCloud { origin, ..Default::default() };
    cloud.positions = vectors(rows, xyz, cloud.origin);
    note_lost(rows, xyz, &mut cloud);
    if splat::read(rows, &mut cloud) {
        return Ok(cloud);
    }
    cloud.normals = rows.fields(["nx", "ny", "nz"]).map(|f| vectors(rows, f, DVec3::ZERO));
    cloud.radii = rows.field("radius").map(|f| rows.column(f, 0.0, |v| v as f32));
    let intensity = INTENSITIES.iter().find_map(|name| rows.field(name));
    if let Some(field) = intensity {
        let list = rows.column(field, 0.0, |v| v as f32);
        let broken = list.iter().filter(|v| !v.is_finite()).count();
        cloud.report.repair("intensities that were not finite", broken as u64);
        cloud.intensity = Some(list.into_iter().map(|v| if v.is_finite() { v } else { 0.0 }).collect());
    }
    if let Some(rgb) = COLORS.iter().find_map(|names| rows.fields(*names)) {
        cloud.colors = Some(colors(rows, rgb, &mut cloud.report));
    }
    if let Some(field) = ALPHAS.iter().find_map(|name| rows.field(name)) {
        let full = full_scale(rows, &[field], "opacities", &mut cloud.report);
        let list = rows.column(field, 0.0f32, |v| if v.is_nan() { 1.0 } else { (v / full).clamp(0.0, 1.0) as f32 });
        if list.iter().all(|a| *a == 0.0) {
            cloud.report.assume("alpha is 0 everywhere: taken as opaque");
        } else if list.iter().any(|a| *a < 1.0) {
            cloud.opacity = Some(list);
        }
    }
    Ok(cloud)
}

fn origin(rows: &Table, xyz: [Field; 3]) -> DVec3 {
    let points: Vec<DVec3> =
        clean::sample(rows.rows()).map(|i| DVec3::from_array(xyz.map(|field| rows.at(field, i)))).collect();
    origin_of(&points, xyz)
}

/// The origin for a sample of positions.
pub(super) fn origin_of(points: &[DVec3], xyz: [Field; 3]) -> DVec3 {
    // Integers up to 16 bits are exact in f32 as well.
    let narrow = xyz.iter().all(|f| !matches!(f.ty, Scalar::F64 | Scalar::I32 | Scalar::U32));
    clean::origin(points, narrow)
}

/// Three columns as vectors, `origin` subtracted in f64 before the rounding.
fn vectors(rows: &Table, xyz: [Field; 3], origin: DVec3) -> Vec<Vec3> {
    let mut out = vec![Vec3::ZERO; rows.rows()];
    par::fill(&mut out, BLOCK, |first, out| {
        rows.each3(xyz, first, out, |p, v| *p = (DVec3::from_array(v) - origin).as_vec3());
    });
    out
}

/// Counts the points that have no usable position; they stay until [`clean`].
fn note_lost(rows: &Table, xyz: [Field; 3], cloud: &mut PointCloud) {
    let (mut broken, mut far) = (0, 0);
    for (i, _) in cloud.positions.iter().enumerate().filter(|(_, p)| !p.is_finite()) {
        let finite = xyz.iter().all(|field| rows.at(*field, i).is_finite());
        *if finite { &mut far } else { &mut broken } += 1;
    }
    cloud.report.drop("non-finite coordinates", broken);
    cloud.report.drop(clean::TOO_FAR, far);
}

/// The value that means full strength: by type, except where the values say that the writer meant another.
fn full_scale(rows: &Table, fields: &[Field], what: &str, report: &mut Report) -> f64 {
    let highest = || {
        let columns = fields.iter().map(|f| rows.column(*f, 0.0, |v| v));
        columns.flatten().filter(|v| v.is_finite()).fold(0.0, f64::max)
    };
    let ty = fields.first().map_or(Scalar::U8, |f| f.ty);
    match ty {
        Scalar::F32 | Scalar::F64 if highest() <= 1.0 => 1.0,
        Scalar::F32 | Scalar::F64 => {
            report.assume(format!("{what} are written as fractions but go above 1: taken as 0 to 255"));
            255.0
        }
        Scalar::U8 | Scalar::I8 => 255.0,
        _ if highest() > 255.0 => 65535.0,
        // 16 bits that are all below 256 hold 8, and an integer column nearly always does.
        Scalar::U16 | Scalar::I16 => {
            report.assume(format!("{what} have 16 bits but none is above 255: taken as 8 bits"));
            255.0
        }
        _ => 255.0,
    }
}

fn colors(rows: &Table, rgb: [Field; 3], report: &mut Report) -> Vec<[u8; 3]> {
    let plain = rgb.iter().all(|f| f.ty == Scalar::U8);
    let full = if plain { 255.0 } else { full_scale(rows, &rgb, "colours", report) };
    let byte = |v: f64| (v * 255.0 / full).round().clamp(0.0, 255.0) as u8;
    let mut out = vec![[0; 3]; rows.rows()];
    par::fill(&mut out, BLOCK, |first, out| {
        if plain {
            // The common case needs no rounding.
            rows.each3(rgb, first, out, |c, v| *c = v.map(|v| v as u8));
        } else {
            rows.each3(rgb, first, out, |c, v| *c = v.map(byte));
        }
    });
    if rgb.iter().any(|f| f.ty.is_float()) {
        let broken = rgb.iter().flat_map(|f| rows.column(*f, false, |v| !v.is_finite())).filter(|b| *b).count();
        report.repair("colour values that were not finite", broken as u64);
    }
    out
}

/// Drops what [`cloud`] counted, and repairs the rest.
pub(super) fn clean(cloud: &mut PointCloud) {
    if cloud.positions.iter().any(|p| !p.is_finite()) {
        let keep: Vec<bool> = cloud.positions.iter().map(|p| p.is_finite()).collect();
        clean::retain(cloud, &keep);
    }
    if cloud.up.is_none() {
        // Not for Gaussian splats: theirs are unit vectors by construction, and counted already.
        repair::normals(cloud);
    }
    repair::radii(cloud);
}
