//! Layered point clouds as inputs: what is in them, and all of their samples as a cloud.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::Result;
use glam::Vec3;
use serde_json::{Value, json};

use surfel::load::{PointCloud, Report};
use surfel::stream::FileAccess;
use surfel::structure::layered::{self, Index};
use surfel::structure::{Flat, octahedral};

use super::args::InfoArgs;
use super::build::{Facts, table};
use super::memory;
use super::parse::Input;
use super::progress::Progress;
use super::{Outcome, Usage};

/// Whether an input is a layered point cloud, by its first bytes.
pub fn is_model(input: &Input) -> bool {
    let Input::File(path) = input else { return false };
    let mut start = [0; 8];
    // What cannot be opened is told by whoever reads it.
    path.is_file() && File::open(path).and_then(|mut f| f.read_exact(&mut start)).is_ok() && layered::is_model(&start)
}

/// All samples, each with its own radius.
pub fn cloud(path: &Path, progress: &Progress) -> Result<PointCloud> {
    let access = FileAccess::open(path)?;
    let index = Index::read(&access)?;
    memory::ensure(&path.display().to_string(), index.samples().saturating_mul(31 + 24))?;
    let _step = progress.step(format!("read {}", path.display()), 1);
    let Flat { origin, geometry, normals, colors, closed, .. } = layered::whole(&index, &access)?;
    let direction = |code: u32| octahedral::decode(code).unwrap_or_default().as_vec3();
    let report = Report {
        format: "layered point cloud".into(),
        points_in_file: index.samples(),
        assumed: vec!["all levels of the layered point cloud are drawn".into()],
        ..Report::default()
    };
    Ok(PointCloud {
        origin,
        positions: geometry.iter().map(|[x, y, z, _]| Vec3::new(*x, *y, *z)).collect(),
        radii: Some(geometry.iter().map(|g| g[3]).collect()),
        normals: normals.map(|n| n.into_iter().map(direction).collect()),
        colors: colors.map(|c| c.into_iter().map(|c| [c as u8, (c >> 8) as u8, (c >> 16) as u8]).collect()),
        up: index.up,
        closed,
        report,
        ..PointCloud::default()
    })
}

/// `surfel info`: the index, and with `--verify` every patch.
pub fn info(path: &Path, args: &InfoArgs) -> Result<Outcome> {
    let access = FileAccess::open(path)?;
    let index = Index::read(&access)?;
    if args.verify {
        let _step = Progress::new(args.json).step("verify", 1);
        layered::verify(&index, &access)?;
    }
    let verified = if args.verify { "  verified     every patch\n" } else { "" };
    let text = match args.json {
        true => format!("{:#}\n", as_json(&index, args.verify)),
        false => format!("{}\n{}{verified}", index.name, table(&index)),
    };
    super::print(&text)?;
    Ok(Outcome::Done)
}

/// `--verify` of what has nothing to verify.
pub fn no_model() -> anyhow::Error {
    Usage("--verify is for layered point clouds: other files are checked whenever they are read".into()).into()
}

fn as_json(index: &Index, verified: bool) -> Value {
    let facts = Facts::of(index);
    json!({
        "file": index.name,
        "format": "layered point cloud",
        "samples": index.samples(),
        "nodes": index.nodes.len(),
        "levels": facts.levels,
        "attributes": {"normals": index.normals, "colors": index.colors, "exact": index.exact},
        "bits_a_sample": {"patches": facts.patches, "index": facts.index},
        "spacing": facts.spacing,
        "origin": index.origin.to_array(),
        "sphere": {"center": facts.centre.to_array(), "radius": facts.radius},
        "verified": verified,
    })
}
