//! What a renderer takes besides the points: the groups, and the order of storage.

use std::path::Path;

use anyhow::{Result, bail};

use surfel::select::View;
use surfel::structure::groups::Relax;
use surfel::structure::{Arrangement, Flat, Groups};
use surfel::technique::Blend;

use super::args::StructureArgs;
use super::progress::Progress;
use super::report::grouped;
use super::{Usage, output};

/// What can be refused before anything is read.
pub fn check(args: &StructureArgs, blend: Blend, inputs: usize) -> Result<()> {
    let Some(path) = &args.groups else { return Ok(()) };
    if blend != Blend::Groups {
        return Err(Usage("--groups is for --blend groups".into()).into());
    }
    if inputs != 1 {
        return Err(Usage("--groups is for one input: every cloud has groups of its own".into()).into());
    }
    output::check(path)
}

/// Makes what the blend needs, then stores the points in the order that is asked for. Returns what there is to say.
pub fn build(
    flats: Vec<Flat>,
    args: &StructureArgs,
    blend: Blend,
    view: &View,
    progress: &Progress,
) -> Result<(Vec<Flat>, Vec<String>)> {
    let mut said = Vec::new();
    let mut built = Vec::new();
    for mut flat in flats {
        if blend == Blend::Groups {
            said.push(group(&mut flat, args, progress)?);
        }
        built.push(arrange(flat, args.storage, view, progress));
    }
    Ok((built, said))
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
    let relax = Relax { factor: args.group_factor, limit: args.group_limit, ..Relax::default() };
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
