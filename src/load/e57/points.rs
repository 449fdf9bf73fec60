//! From columns of a scan to points of the file's frame.

use glam::{DVec3, Vec3};

use super::describe::{Limits, Range, Scan};
use super::grid::Grid;
use super::packets::Columns;
use crate::load::merge::NO_COLOR;
use crate::load::{PointCloud, Report, clean};

/// What a point's coordinates are.
enum Local {
    /// In the scan's own frame.
    At(DVec3),
    /// Only the direction is known: nothing came back.
    Direction,
    Invalid,
}

/// What all pieces of a file have alike.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Plan {
    pub(super) origin: DVec3,
    /// Whether any scan has them.
    pub(super) normals: bool,
    pub(super) colors: bool,
    pub(super) intensity: bool,
    /// Full strength of a channel where the limits of colours are not told.
    pub(super) full: Option<f64>,
}

fn local(scan: &Scan, columns: &Columns, i: usize) -> Local {
    let three = |fields: [usize; 3]| fields.map(|f| columns[f][i]);
    let state = |field: Option<usize>| field.map_or(0.0, |f| columns[f][i]);
    let (cartesian, spherical) = (state(scan.cartesian_state), state(scan.spherical_state));
    match (scan.cartesian, scan.spherical) {
        (Some(xyz), _) if cartesian == 0.0 => Local::At(DVec3::from_array(three(xyz))),
        (_, Some(fields)) if spherical == 0.0 => Local::At(from_spherical(three(fields))),
        (Some(_), _) if cartesian == 1.0 => Local::Direction,
        (_, Some(_)) if spherical == 1.0 => Local::Direction,
        _ => Local::Invalid,
    }
}

/// Range, azimuth about z from x to y, elevation above the plane of x and y.
fn from_spherical([range, azimuth, elevation]: [f64; 3]) -> DVec3 {
    let (around, up) = (azimuth.sin_cos(), elevation.sin_cos());
    range * DVec3::new(up.1 * around.1, up.1 * around.0, up.0)
}

/// Where the scan's own coordinates are in the file's frame.
fn world(scan: &Scan, p: DVec3) -> DVec3 {
    scan.rotation * p + scan.translation
}

/// Points of a scan in the file's frame, those that have a place.
pub(super) fn places(scan: &Scan, columns: &Columns) -> Vec<DVec3> {
    let n = columns.iter().map(Vec::len).max().unwrap_or(0);
    let at = |i| match local(scan, columns, i) {
        Local::At(p) => Some(world(scan, p)).filter(|p| p.is_finite()),
        _ => None,
    };
    (0..n).filter_map(at).collect()
}

/// The greatest value of a channel.
pub(super) fn highest(scan: &Scan, columns: &Columns) -> f64 {
    let values = scan.color.iter().flatten().flat_map(|f| &columns[*f]);
    values.copied().filter(|v| v.is_finite()).fold(0.0, f64::max)
}

/// A piece of the cloud; what is left out is counted. `grid` sees all points that are kept.
pub(super) fn piece(
    scan: &Scan,
    columns: &Columns,
    plan: &Plan,
    report: &mut Report,
    grid: Option<&mut Grid>,
) -> PointCloud {
    let n = columns.iter().map(Vec::len).max().unwrap_or(0);
    let mut out = PointCloud { origin: plan.origin, up: Some(Vec3::Z), ..Default::default() };
    let mut kept = Vec::with_capacity(n);
    out.positions.reserve_exact(n);
    let [mut invalid, mut directions, mut broken, mut far] = [0; 4];
    let mut grid = grid.zip(scan.grid);
    for i in 0..n {
        let p = match local(scan, columns, i) {
            Local::At(p) => p,
            Local::Direction => {
                directions += 1;
                continue;
            }
            Local::Invalid => {
                invalid += 1;
                continue;
            }
        };
        let offset = (world(scan, p) - plan.origin).as_vec3();
        if !offset.is_finite() {
            *if p.is_finite() { &mut far } else { &mut broken } += 1;
            continue;
        }
        if let Some((grid, [row, column])) = &mut grid {
            grid.push(columns[*row][i] as i64, columns[*column][i] as i64, p);
        }
        out.positions.push(offset);
        kept.push(i);
    }
    report.drop("points marked as invalid", invalid);
    report.drop("points of which only the direction is known", directions);
    report.drop("non-finite coordinates", broken);
    report.drop(clean::TOO_FAR, far);
    out.normals = plan.normals.then(|| normals(scan, columns, &kept, report));
    out.colors = plan.colors.then(|| colors(scan, columns, &kept, plan, report));
    out.intensity = plan.intensity.then(|| intensities(scan, columns, &kept, report));
    out
}

fn normals(scan: &Scan, columns: &Columns, kept: &[usize], report: &mut Report) -> Vec<Vec3> {
    let Some(fields) = scan.normal else { return vec![Vec3::ZERO; kept.len()] };
    let mut zero = 0;
    let turned = kept.iter().map(|i| {
        let n = DVec3::from_array(fields.map(|f| columns[f][*i]));
        let n = (scan.rotation * n).normalize_or_zero().as_vec3();
        zero += u64::from(n == Vec3::ZERO);
        n
    });
    let out = turned.collect();
    report.repair("normals without a direction", zero);
    out
}

fn colors(scan: &Scan, columns: &Columns, kept: &[usize], plan: &Plan, report: &mut Report) -> Vec<[u8; 3]> {
    let Some(fields) = scan.color else { return vec![NO_COLOR; kept.len()] };
    let full = Range { min: 0.0, max: plan.full.unwrap_or(255.0) };
    let limits = match scan.color_limits {
        Limits::Told(told) => told,
        Limits::Type(ty) if plan.full.is_none() || ty.iter().all(|r| r.max <= 255.0) => ty,
        _ => [full; 3],
    };
    let [mut unmarked, mut broken] = [0; 2];
    let byte = |v: f64, limits: &Range| (255.0 * limits.share(v)).round().clamp(0.0, 255.0) as u8;
    let painted = kept.iter().map(|i| {
        if scan.color_state.is_some_and(|f| columns[f][*i] != 0.0) {
            unmarked += 1;
            return NO_COLOR;
        }
        let values = fields.map(|f| columns[f][*i]);
        broken += u64::from(values.iter().any(|v| !v.is_finite()));
        [0, 1, 2].map(|c| byte(values[c], &limits[c]))
    });
    let out = painted.collect();
    report.repair("colours marked as invalid: grey", unmarked);
    report.repair("colour values that were not finite", broken);
    out
}

fn intensities(scan: &Scan, columns: &Columns, kept: &[usize], report: &mut Report) -> Vec<f32> {
    let Some(field) = scan.intensity else { return vec![0.0; kept.len()] };
    let [mut marked, mut broken] = [0; 2];
    let scaled = kept.iter().map(|i| {
        if scan.intensity_state.is_some_and(|f| columns[f][*i] != 0.0) {
            marked += 1;
            return 0.0;
        }
        let v = columns[field][*i];
        let v = scan.intensity_limits.map_or(v, |limits| limits.share(v)) as f32;
        broken += u64::from(!v.is_finite());
        if v.is_finite() { v } else { 0.0 }
    });
    let out = scaled.collect();
    report.repair("intensities marked as invalid: 0", marked);
    report.repair("intensities that were not finite", broken);
    out
}
