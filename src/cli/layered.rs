//! Layered point clouds as inputs: what is in them, and all of their samples as a cloud.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use glam::{DMat4, Vec3};
use serde_json::{Value, json};

use surfel::load::{PointCloud, Report};
use surfel::select::layered::{Limit, Refine, factor_for};
use surfel::select::{Sight, View};
use surfel::stream::{self, Access, FileAccess};
use surfel::structure::layered::{self, Index};
use surfel::structure::{Flat, octahedral};
use surfel::style::Style;

use super::args::InfoArgs;
use super::build::{Facts, table};
use super::memory;
use super::parse::Input;
use super::progress::Progress;
use super::{Outcome, Usage};

/// Whether an input is a layered point cloud: a file by its first bytes, and whatever is behind a server.
pub fn is_model(input: &Input) -> bool {
    let path = match input {
        Input::File(path) => path,
        Input::Remote(_) => return true,
        Input::Scene { .. } => return false,
    };
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
    Ok(unpacked(&index, layered::whole(&index, &access)?, "all levels of the layered point cloud are drawn"))
}

/// Samples that a view is found by before any is drawn.
const OVERVIEW: u64 = 1 << 18;

/// A model of which a picture fetches what it needs.
pub struct Model {
    index: Arc<Index>,
    access: Arc<dyn Access>,
}

impl Model {
    /// Of a file or an address.
    pub fn open(inputs: &[Input]) -> Result<Model> {
        let access: Arc<dyn Access> = match inputs {
            [Input::File(path)] if is_model(&inputs[0]) => Arc::new(FileAccess::open(path)?),
            [Input::Remote(address)] => stream::open(address)?,
            _ => return Err(Usage("--structure layered is for one model that `surfel build` made".into()).into()),
        };
        Ok(Model { index: Arc::new(Index::read(&*access)?), access })
    }

    /// Samples of the whole model.
    pub fn samples(&self) -> u64 {
        self.index.samples()
    }

    /// Its coarsest samples, by which a view is chosen.
    pub fn overview(&self) -> Result<PointCloud> {
        let flat = layered::coarse(&self.index, &*self.access, OVERVIEW)?;
        Ok(unpacked(&self.index, flat, "the view is chosen by the coarsest samples"))
    }

    /// What a picture shows of it, and what there is to say.
    pub fn in_view(
        &self,
        view: &View,
        size: [u32; 2],
        style: &Style,
        most: Option<u64>,
        progress: &Progress,
    ) -> Result<(PointCloud, Vec<String>)> {
        let step = progress.step("fetch", 1);
        let sight = Sight::new(view, size, &DMat4::IDENTITY, self.index.origin, style);
        let mut options = Refine::default();
        let mut said = Vec::new();
        if let Some(most) = most {
            options.factor = factor_for(&self.index, std::slice::from_ref(&sight), &options, Limit::Samples(most), 1.0);
            if options.factor > 1.0 {
                let px = style.threshold as f64 * options.factor;
                said.push(format!("threshold {px:.2} px, for {} samples", super::report::grouped(most)));
            }
        }
        let of = layered::in_view(&self.index, Arc::clone(&self.access), &sight, &options, Default::default())?;
        drop(step);
        let (all, drawn) = (self.index.nodes.len() as u64, of.counts.drawn as u64);
        said.push(format!(
            "{} of {} patches drawn, {} read in {} requests",
            super::report::grouped(drawn),
            super::report::grouped(all),
            memory::human(of.fetched.bytes),
            super::report::grouped(of.fetched.requests)
        ));
        if let Some(fault) = &of.fault {
            said.push(format!("{} patches are missing, and coarser ones drawn: {fault}", of.counts.missing));
        }
        Ok((unpacked(&self.index, of.flat, ""), said))
    }
}

/// A model's samples as `load` has clouds.
fn unpacked(index: &Index, flat: Flat, said: &str) -> PointCloud {
    let Flat { origin, geometry, normals, colors, closed, .. } = flat;
    let direction = |code: u32| octahedral::decode(code).unwrap_or_default().as_vec3();
    let report = Report {
        format: "layered point cloud".into(),
        points_in_file: index.samples(),
        assumed: (!said.is_empty()).then(|| said.to_owned()).into_iter().collect(),
        ..Report::default()
    };
    PointCloud {
        origin,
        positions: geometry.iter().map(|[x, y, z, _]| Vec3::new(*x, *y, *z)).collect(),
        radii: Some(geometry.iter().map(|g| g[3]).collect()),
        normals: normals.map(|n| n.into_iter().map(direction).collect()),
        colors: colors.map(|c| c.into_iter().map(|c| [c as u8, (c >> 8) as u8, (c >> 16) as u8]).collect()),
        up: index.up,
        closed,
        report,
        ..PointCloud::default()
    }
}

/// `surfel info`: the index, and with `--verify` every patch.
pub fn info(args: &InfoArgs) -> Result<Outcome> {
    let Model { index, access } = Model::open(std::slice::from_ref(&args.input))?;
    if args.verify {
        let _step = Progress::new(args.json).step("verify", 1);
        layered::verify(&index, &*access)?;
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
        "attributes": {"normals": index.normals, "colors": index.colors, "exact": index.exact, "groups": index.groups},
        "bits_a_sample": {"patches": facts.patches, "index": facts.index},
        "spacing": facts.spacing,
        "origin": index.origin.to_array(),
        "sphere": {"center": facts.centre.to_array(), "radius": facts.radius},
        "verified": verified,
    })
}
