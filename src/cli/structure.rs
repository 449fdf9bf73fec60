//! What a renderer takes besides the points: the groups, and the order of storage.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, bail};

use surfel::load::Mesh;
use surfel::select::View;
use surfel::structure::groups::Relax;
use surfel::structure::nodes::{self, ErrorRule};
use surfel::structure::{Arrangement, Cloud, Flat, Groups, Hybrid, Octree, Packing, Sequential, octree, sequential};
use surfel::technique::{Blend, Structure, Technique};

use super::args::{LevelArgs, StructureArgs};
use super::progress::Progress;
use super::report::grouped;
use super::{Usage, output};

/// What can be refused before anything is read.
pub fn check(args: &StructureArgs, technique: &Technique, inputs: usize) -> Result<()> {
    if technique.structure != Structure::Flat && args.storage != Arrangement::AsRead {
        return Err(Usage(format!(
            "--storage is for --structure flat: {} has an order of its own",
            technique.structure
        ))
        .into());
    }
    if let Some(path) = &args.levels.tree {
        if technique.structure == Structure::Flat {
            return Err(Usage("--tree is for structures with levels of detail, not for --structure flat".into()).into());
        }
        if inputs != 1 {
            return Err(Usage("--tree is for one input: every cloud has a tree of its own".into()).into());
        }
        output::check(path)?;
    }
    if technique.structure == Structure::Layered && inputs != 1 {
        return Err(Usage("--structure layered is for one model".into()).into());
    }
    let Some(path) = &args.groups else { return Ok(()) };
    if technique.blend != Blend::Groups {
        return Err(Usage("--groups is for --blend groups".into()).into());
    }
    if technique.structure != Structure::Flat {
        return Err(Usage("--groups is for --structure flat".into()).into());
    }
    if inputs != 1 {
        return Err(Usage("--groups is for one input: every cloud has groups of its own".into()).into());
    }
    output::check(path)
}

/// Makes what the technique needs, and stores the points in the order that is asked for. Returns what there is to say.
pub fn build(
    packed: Vec<(Flat, Option<Mesh>)>,
    args: &StructureArgs,
    technique: &Technique,
    view: &View,
    progress: &Progress,
) -> Result<(Vec<Cloud>, Vec<String>)> {
    let mut said = Vec::new();
    let mut built = Vec::new();
    let grouped = technique.blend == Blend::Groups;
    for (mut flat, mesh) in packed {
        if technique.structure != Structure::Flat {
            let relax = grouped.then(|| relax(args));
            let of = (&flat, mesh.as_ref());
            let (cloud, sentence) = level(of, technique.structure, &args.levels, relax.as_ref(), progress)?;
            said.push(sentence);
            built.push(cloud);
            continue;
        }
        if grouped {
            said.push(group(&mut flat, args, progress)?);
        }
        let cloud = pack(arrange(flat, args.storage, view, progress), args.levels.packing, progress);
        if cloud.packing() != Packing::Full {
            said.push(format!("packing: {}, {:.1} B a point", packing(&cloud), per_point(cloud.bytes(), cloud.len())));
        }
        built.push(cloud.into());
    }
    Ok((built, said))
}

/// A structure with levels over a cloud and its faces, with groups where `relax` is given, and what there is to say of it.
pub fn level(
    (flat, mesh): (&Flat, Option<&Mesh>),
    structure: Structure,
    args: &LevelArgs,
    relax: Option<&Relax>,
    progress: &Progress,
) -> Result<(Cloud, String)> {
    let step = progress.step(format!("structure {structure}"), 1);
    let octree = |preset| {
        let usual = octree::Options::new(preset);
        let options = octree::Options { block: args.block.unwrap_or(usual.block), ..usual };
        let made = || Octree::build(flat, &options);
        let tree = once(args, "octree", Octree::load, |tree| tree.is_of(flat, &options), made, Octree::save)?;
        let mut tree = tree.packed(args.packing);
        if let Some(relax) = relax {
            tree.flat.groups = Some(tree.color(relax)?);
        }
        anyhow::Ok((tree.bytes(), tree.moved, Cloud::from(Arc::new(tree))))
    };
    let block = args.block.unwrap_or(LIST);
    let blocks = if args.clusters { 0 } else { block };
    let options = |rule, blocks| {
        let clusters = args.clusters && blocks == 0;
        sequential::Options { rule, clusters, blocks, ..Default::default() }
    };
    let grouped = |tree: &mut Sequential| -> Result<()> {
        if let Some(relax) = relax {
            // A cut has no node with its parent, and neighbours seldom differ by more than a level.
            let (levels, links) = (&tree.levels, &tree.nodes.links);
            let child = |a: usize, b: usize| links[a][0] != nodes::NONE && links[b][1] == links[a][0];
            let together = |a: usize, b: usize| levels[a].abs_diff(levels[b]) <= 1 && !child(a, b) && !child(b, a);
            tree.flat.groups = Some(Groups::color_where(&tree.flat, relax, together)?);
        }
        Ok(())
    };
    let hybrid = || {
        let Some(mesh) = mesh.filter(|mesh| !mesh.triangles.is_empty()) else {
            bail!("--structure hybrid: an input has no faces");
        };
        let options = options(args.error, blocks);
        let made = || Hybrid::build(flat, mesh, &options);
        let fits = |hybrid: &Hybrid| hybrid.is_of(flat, mesh, &options);
        let mut hybrid = once(args, "hybrid", Hybrid::load, fits, made, Hybrid::save)?.packed(args.packing);
        grouped(&mut hybrid.tree)?;
        anyhow::Ok((hybrid.bytes(), 0.0, Cloud::from(Arc::new(hybrid))))
    };
    let tree = |rule, blocks| {
        let options = options(rule, blocks);
        let made = || Sequential::build(flat, &options);
        let tree = once(args, "tree", Sequential::load, |tree| tree.is_of(flat, &options), made, Sequential::save)?;
        let mut tree = tree.packed(args.packing);
        grouped(&mut tree)?;
        anyhow::Ok((tree.bytes(), 0.0, Cloud::from(Arc::new(tree))))
    };
    let (bytes, moved, cloud) = match structure {
        Structure::Sequential => tree(args.error, blocks)?,
        Structure::Hybrid => hybrid()?,
        Structure::OneSpt => tree(ErrorRule::Cell, 0)?,
        Structure::SptR => tree(ErrorRule::Cell, block)?,
        Structure::VboR => octree(octree::Preset::VboR)?,
        Structure::Espt => octree(octree::Preset::Espt)?,
        Structure::Mospt => octree(octree::Preset::Mospt)?,
        Structure::RGrid => octree(octree::Preset::RGrid)?,
        Structure::Poisson => octree(octree::Preset::Poisson)?,
        other => bail!("--structure {other} is for render alone"),
    };
    drop(step);
    let mut said = format!("structure: {structure}, {:.1} B a point", per_point(bytes, flat.len()));
    if args.packing != Packing::Full {
        said += &format!(", packing {}", packing(cloud.flat()));
    }
    if moved > 0.0 {
        said += &format!(", points moved by at most {moved}");
    }
    Ok((cloud, said))
}

/// Most points of a list's part of the octree, where nothing else is asked for.
const LIST: u32 = 10_000;

/// What the file of `--tree` holds; made and written there where there is none.
fn once<T>(
    args: &LevelArgs,
    what: &str,
    load: impl Fn(&Path) -> surfel::Result<T>,
    fits: impl Fn(&T) -> bool,
    made: impl Fn() -> T,
    save: impl Fn(&T, &Path) -> surfel::Result<()>,
) -> Result<T> {
    let Some(path) = &args.tree else { return Ok(made()) };
    if !path.exists() {
        let made = made();
        save(&made, path)?;
        return Ok(made);
    }
    let kept = load(path)?;
    if !fits(&kept) {
        bail!("{}: holds the {what} of another cloud, or one made with other options", path.display());
    }
    Ok(kept)
}

/// In fewer bytes a point.
pub fn pack(flat: Flat, packing: Packing, progress: &Progress) -> Flat {
    let _step = (packing != Packing::Full).then(|| progress.step(format!("packing {packing}"), 1));
    flat.packed(packing)
}

/// How a cloud is packed, and what its radii and positions lost.
fn packing(flat: &Flat) -> String {
    let factor = flat.packed.as_ref().map_or(1.0, |packed| packed.radii().factor());
    let mut said = format!("{}, radii at most {factor:.4} times as large", flat.packing());
    // An eighth of the spacing: what is off by less is not seen.
    let off = |i: &u32| flat.point(*i)[3] > 0.0 && flat.position_error(*i) > 0.125 * flat.point(*i)[3];
    let few = (0..flat.len() as u32).filter(off).count() as u64;
    if few > 0 {
        let all = grouped(flat.len() as u64);
        said += &format!(", {} of {all} positions off by perhaps more than an eighth of a radius", grouped(few));
    }
    said
}

fn per_point(bytes: u64, points: usize) -> f64 {
    bytes as f64 / points.max(1) as f64
}

fn relax(args: &StructureArgs) -> Relax {
    Relax { factor: args.group_factor, limit: args.group_limit, ..Relax::default() }
}

/// The points in another order, for a view where the order is for one.
pub fn arrange(flat: Flat, how: Arrangement, view: &View, progress: &Progress) -> Flat {
    if how == Arrangement::AsRead {
        return flat;
    }
    let _step = progress.step(format!("store {how}"), 1);
    let view = view.right_handed();
    flat.arranged(how, |p| -view.view.transform_point3(p).z)
}

fn group(flat: &mut Flat, args: &StructureArgs, progress: &Progress) -> Result<String> {
    let relax = relax(args);
    let kept = args.groups.as_deref();
    let (groups, from) = match kept.filter(|path| path.exists()).map(|path| read(path, flat, &relax)).transpose()? {
        Some(groups) => (groups, "read"),
        None => {
            let _step = progress.step("groups", 1);
            let groups = Groups::color(flat, &relax)?;
            if let Some(path) = kept {
                groups.save(path, flat, &relax)?;
            }
            (groups, "made")
        }
    };
    let mut said = format!("groups: {} with c = {}, {from}", groups.count, relax.factor);
    if groups.conflicts > 0 {
        said += &format!("; {} splats overlap others of theirs more than that", grouped(groups.conflicts));
    }
    flat.groups = Some(groups);
    Ok(said)
}

/// A file that fits; one of another cloud or other options is not overwritten.
fn read(path: &Path, flat: &Flat, relax: &Relax) -> Result<Groups> {
    match Groups::load(path, flat, relax)? {
        Some(groups) => Ok(groups),
        None => bail!("{}: holds the groups of another cloud, or made with other options", path.display()),
    }
}
