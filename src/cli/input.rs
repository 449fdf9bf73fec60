//! From arguments to clouds: read, joined where they are alike, bounded.

use anyhow::{Result, bail};
use glam::DVec3;

use surfel::load::{self, Bounds, PointCloud, Report, synthetic};

use super::layered;
use super::memory;
use super::parse::{Input, MAX_POINTS};
use super::progress::Progress;
use super::scene_file;

/// Reads one input, without heaps of copies: a million points at one place would be drawn a million times.
pub fn read(input: &Input, progress: &Progress) -> Result<PointCloud> {
    let mut cloud = read_all(input, progress)?;
    load::thin_copies(&mut cloud);
    Ok(cloud)
}

fn read_all(input: &Input, progress: &Progress) -> Result<PointCloud> {
    if let Input::File(path) = input
        && scene_file::is_scene(input)
    {
        bail!("{}: a scene file is for render, reference and info", path.display());
    }
    match input {
        Input::File(path) if layered::is_model(input) => layered::cloud(path, progress),
        Input::File(path) => {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let step = progress.step(format!("read {name}"), 1);
            let report = |done, total| step.set(done, total);
            Ok(load::open(path, &load::Options { progress: Some(&report) })?)
        }
        Input::Remote(address) => {
            bail!("{address}: a model behind a server is drawn by render --structure layered, and told of by info")
        }
        Input::Scene { name, points, seed } => {
            if *points > MAX_POINTS {
                bail!("scene:{name}: {points} points in one cloud: at most {MAX_POINTS} are handled");
            }
            // Position, normal, radius, colour, as they are made and as they are packed for the device.
            memory::ensure(&format!("scene:{name}:{points}"), *points as u64 * (31 + 24))?;
            let _step = progress.step(format!("make scene {name}"), 1);
            Ok(synthetic::scene(name, *points, *seed)?)
        }
    }
}

/// Joins clouds that have the same attributes, in the order of their first; the others stay apart.
///
/// Tiles of one survey must become one cloud, or normals and radii would be wrong along their seams. A mesh and a scan
/// must not: what is only missing in one would be given up in the other.
pub fn join(clouds: Vec<PointCloud>) -> Result<Vec<PointCloud>> {
    let kind = |c: &PointCloud| (c.mesh.is_some(), c.normals.is_some(), c.radii.is_some(), c.colors.is_some());
    let mut groups: Vec<(_, Vec<PointCloud>)> = Vec::new();
    for cloud in clouds {
        let kind = kind(&cloud);
        match groups.iter_mut().find(|(k, _)| *k == kind) {
            Some((_, group)) => group.push(cloud),
            None => groups.push((kind, vec![cloud])),
        }
    }
    handled(groups.into_iter().map(|(_, group)| load::merge(group)).collect())
}

/// The clouds, if none is larger than what attributes can be estimated for.
pub fn handled(clouds: Vec<PointCloud>) -> Result<Vec<PointCloud>> {
    for cloud in &clouds {
        if cloud.len() > MAX_POINTS {
            bail!("{} points in one cloud: at most {MAX_POINTS} are handled", cloud.len());
        }
    }
    Ok(clouds)
}

/// Bounds of all clouds together; `None` where there is no point.
pub fn bounds(clouds: &[PointCloud]) -> Option<Bounds> {
    match clouds {
        [cloud] => Bounds::of(cloud),
        _ => {
            // Percentiles of several clouds are those of one that holds all their points.
            let bare =
                |c: &PointCloud| PointCloud { origin: c.origin, positions: c.positions.clone(), ..Default::default() };
            Bounds::of(&load::merge(clouds.iter().map(bare).collect()))
        }
    }
}

/// A splat that the default view must show: centre [world] and radius.
pub type Ball = (DVec3, f64);

/// Evenly strided points inside the robust box, some ten thousand: enough to frame a picture by.
pub fn balls(clouds: &[PointCloud], bounds: &Bounds) -> Vec<Ball> {
    const WANTED: usize = 30_000;
    let total: usize = clouds.iter().map(PointCloud::len).sum();
    let step = total.div_ceil(WANTED).max(1);
    let mut balls = Vec::new();
    for cloud in clouds {
        for i in (0..cloud.len()).step_by(step) {
            let p = cloud.world(i);
            if p.cmpge(bounds.robust_min).all() && p.cmple(bounds.robust_max).all() {
                balls.push((p, cloud.radii.as_ref().map_or(0.0, |r| r[i] as f64)));
            }
        }
    }
    balls
}

/// One sentence for each thing that a report tells.
pub fn lines(report: &Report) -> impl Iterator<Item = String> {
    let dropped = report.dropped.iter().map(|(why, n)| format!("{n} left out: {why}"));
    let repaired = report.repaired.iter().map(|(why, n)| format!("{n} repaired: {why}"));
    dropped.chain(repaired).chain(report.assumed.iter().cloned())
}

/// One sentence for each thing that happened between the files and the clouds.
pub fn sentences(clouds: &[PointCloud]) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for report in clouds.iter().map(|c| &c.report) {
        for line in lines(report) {
            if !all.contains(&line) {
                all.push(line);
            }
        }
    }
    if clouds.iter().any(|c| c.opacity.is_some()) {
        all.push("opacity is not used: every point is drawn solid".into());
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn cloud(at: f32, normals: bool) -> PointCloud {
        PointCloud {
            positions: vec![Vec3::splat(at); 3],
            normals: normals.then(|| vec![Vec3::Z; 3]),
            ..Default::default()
        }
    }

    #[test]
    fn only_clouds_of_one_kind_are_joined() {
        let joined = join(vec![cloud(0.0, true), cloud(1.0, false), cloud(2.0, true)]).unwrap();
        assert_eq!(joined.iter().map(PointCloud::len).collect::<Vec<_>>(), [6, 3]);
        assert!(joined[0].normals.is_some() && joined[1].normals.is_none());
        let all = bounds(&joined).unwrap();
        assert_eq!((all.min, all.max), (DVec3::ZERO, DVec3::splat(2.0)));
        assert_eq!(balls(&joined, &all).len(), 9);
        assert!(bounds(&[]).is_none());
    }

    #[test]
    fn nothing_that_happened_is_lost() {
        let mut c = cloud(0.0, false);
        c.report.drop("non-finite coordinates", 2);
        c.report.repair("zero normals", 1);
        c.report.assume("up");
        assert_eq!(sentences(&[c]), ["2 left out: non-finite coordinates", "1 repaired: zero normals", "up"]);
    }
}
