//! Several clouds of one world become one.

use glam::{DVec3, Vec3};

use super::{Mesh, PointCloud, Report, clean};

/// What a point without a colour gets beside points that have one.
pub(super) const NO_COLOR: [u8; 3] = [190, 190, 190];

/// Joins clouds that share one world frame, in the order given.
///
/// The origin is chosen anew unless all have the same; each offset is moved by the difference of the origins in f64 and
/// rounded once. An attribute that only some have is filled with its neutral value (normals zero, colours grey, opacity
/// 1, intensity and class 0); radii have no neutral value, so they are kept only if all have them. All of that is in the
/// report. Points that end too far from the new origin for an f32 are dropped and counted.
pub fn merge(mut clouds: Vec<PointCloud>) -> PointCloud {
    if clouds.len() <= 1 {
        return clouds.pop().unwrap_or_default();
    }
    let total: usize = clouds.iter().map(PointCloud::len).sum();
    let origin = common_origin(&clouds);
    let mut out = PointCloud { origin, report: joined_report(&clouds), ..Default::default() };
    out.positions.reserve_exact(total);
    for cloud in &clouds {
        let shift = cloud.origin - origin;
        if shift == DVec3::ZERO {
            out.positions.extend_from_slice(&cloud.positions);
        } else {
            out.positions.extend(cloud.positions.iter().map(|p| (p.as_dvec3() + shift).as_vec3()));
        }
    }
    let report = &mut out.report;
    out.normals = fill(&mut clouds, |c| c.normals.take(), Vec3::ZERO, report, "normals: the others face the viewer");
    out.colors = fill(&mut clouds, |c| c.colors.take(), NO_COLOR, report, "colours: the others are grey");
    out.opacity = fill(&mut clouds, |c| c.opacity.take(), 1.0, report, "opacities: the others are opaque");
    out.intensity = fill(&mut clouds, |c| c.intensity.take(), 0.0, report, "intensities: the others get 0");
    out.classes = fill(&mut clouds, |c| c.classes.take(), 0, report, "classes: the others get 0 (never classified)");
    if clouds.iter().all(|c| c.radii.is_some() || c.is_empty()) {
        out.radii = fill(&mut clouds, |c| c.radii.take(), 1.0, report, "");
    } else if clouds.iter().any(|c| c.radii.is_some()) {
        report.assume("only some inputs have radii: all are left out, to be estimated together");
    }
    out.mesh = joined_mesh(&clouds, total, report);
    out.up = agreed(&clouds, |c| c.up, report, "up directions");
    out.viewpoint = agreed(&clouds, |c| c.viewpoint, report, "viewpoints");
    out.angular_step = agreed(&clouds, |c| c.angular_step, report, "angular steps");
    out.closed = clouds.iter().all(|c| c.closed);
    let keep: Vec<bool> = out.positions.iter().map(|p| p.is_finite()).collect();
    let far = keep.iter().filter(|k| !**k).count();
    if far > 0 {
        out.report.drop(clean::TOO_FAR, far as u64);
        clean::retain(&mut out, &keep);
        out.closed = false;
    }
    out
}

fn common_origin(clouds: &[PointCloud]) -> DVec3 {
    let filled: Vec<&PointCloud> = clouds.iter().filter(|c| !c.is_empty()).collect();
    let Some(first) = filled.first() else { return DVec3::ZERO };
    if filled.iter().all(|c| c.origin == first.origin) {
        return first.origin;
    }
    let points: Vec<DVec3> = filled.iter().flat_map(|c| clean::sample(c.len()).map(|i| c.world(i))).collect();
    clean::origin(&points, false)
}

fn joined_report(clouds: &[PointCloud]) -> Report {
    let mut out = Report::default();
    let mut formats: Vec<&str> = Vec::new();
    for report in clouds.iter().map(|c| &c.report) {
        if !report.format.is_empty() && !formats.contains(&report.format.as_str()) {
            formats.push(&report.format);
        }
        out.points_in_file = out.points_in_file.saturating_add(report.points_in_file);
        report.dropped.iter().for_each(|(reason, n)| out.drop(reason, *n));
        report.repaired.iter().for_each(|(reason, n)| out.repair(reason, *n));
        report.assumed.iter().for_each(|line| out.assume(line));
    }
    out.format = formats.join(" + ");
    out
}

fn fill<T: Copy>(
    clouds: &mut [PointCloud],
    take: impl Fn(&mut PointCloud) -> Option<Vec<T>>,
    neutral: T,
    report: &mut Report,
    what: &str,
) -> Option<Vec<T>> {
    let lists: Vec<(usize, Option<Vec<T>>)> = clouds.iter_mut().map(|c| (c.len(), take(c))).collect();
    if lists.iter().all(|(_, list)| list.is_none()) {
        return None;
    }
    let mut out = Vec::with_capacity(lists.iter().map(|(n, _)| n).sum());
    for (n, list) in lists {
        match list {
            Some(mut list) => out.append(&mut list),
            None if n > 0 => {
                out.extend(std::iter::repeat_n(neutral, n));
                report.assume(format!("only some inputs have {what}"));
            }
            None => {}
        }
    }
    Some(out)
}

fn joined_mesh(clouds: &[PointCloud], total: usize, report: &mut Report) -> Option<Mesh> {
    if clouds.iter().all(|c| c.mesh.is_none()) {
        return None;
    }
    if u32::try_from(total).is_err() {
        let faces: usize = clouds.iter().flat_map(|c| &c.mesh).map(|m| m.triangles.len()).sum();
        report.drop("faces of a cloud with more than 2^32 points", faces as u64);
        return None;
    }
    let mut mesh = Mesh::default();
    let mut first = 0;
    for cloud in clouds {
        if let Some(part) = &cloud.mesh {
            mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
        }
        first += cloud.len() as u32;
    }
    Some(mesh)
}

fn agreed<T: Copy + PartialEq>(
    clouds: &[PointCloud],
    get: impl Fn(&PointCloud) -> Option<T>,
    report: &mut Report,
    what: &str,
) -> Option<T> {
    let mut said = clouds.iter().filter_map(&get);
    let first = said.next()?;
    if said.all(|other| other == first) {
        return Some(first);
    }
    report.assume(format!("the inputs have different {what}: none is kept"));
    None
}
