//! What every reader does between raw values and a [`PointCloud`] that keeps its promises.

use std::path::Path;

use glam::{DVec3, Vec3};

use super::PointCloud;
use crate::error::{Error, Place, Result};

/// Why points with NaN or infinite coordinates are missing.
pub(super) const NON_FINITE: &str = "non-finite coordinates";
/// Why points are missing whose offset does not fit an f32.
pub(super) const TOO_FAR: &str = "coordinates too far from the rest for 32-bit floats";

/// How many values the choice of an origin looks at: enough for a percentile, few enough to cost nothing.
pub(super) const SAMPLE: usize = 4096;

/// Evenly spread indices into `n` items, at most [`SAMPLE`] of them.
pub(super) fn sample(n: usize) -> impl Iterator<Item = usize> {
    let step = n.div_ceil(SAMPLE).max(1);
    (0..n).step_by(step)
}

/// (2nd percentile, 98th percentile) of a sample: a stray point must not decide where precision goes.
pub(super) fn core_range<T: Copy>(values: &mut [T], compare: impl Fn(&T, &T) -> std::cmp::Ordering) -> Option<(T, T)> {
    values.sort_unstable_by(compare);
    let last = values.len().checked_sub(1)?;
    let skip = last / 50;
    Some((values[skip], values[last - skip]))
}

/// The origin that offsets are rounded against: near the middle of most points, on a coarse power-of-two grid.
///
/// The grid keeps the origin short in binary, so that subtracting it from values that are f32 already is exact (their
/// spacing divides the grid's). `narrow` says that they are: then the origin stays at zero as long as the cloud is not
/// far from it, and what is in the file is what is in memory, bit for bit.
pub(super) fn origin(points: &[DVec3], narrow: bool) -> DVec3 {
    let axis = |get: fn(&DVec3) -> f64| {
        let mut values: Vec<f64> = points.iter().map(get).filter(|v| v.is_finite()).collect();
        core_range(&mut values, f64::total_cmp).unwrap_or((0.0, 0.0))
    };
    let (x, y, z) = (axis(|p| p.x), axis(|p| p.y), axis(|p| p.z));
    let (min, max) = (DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1));
    let extent = (max - min).max_element();
    let reach = min.abs().max(max.abs()).max_element();
    // 64 spans away from zero six of 24 bits are lost.
    if !extent.is_finite() || !reach.is_finite() || (narrow && reach <= 64.0 * extent) {
        return DVec3::ZERO;
    }
    // Half each before the sum: two finite numbers may add up to infinity.
    let middle = 0.5 * min + 0.5 * max;
    if extent == 0.0 {
        // One place: its own coordinates are the best origin there is.
        return middle;
    }
    let grid = power_of_two_below(extent / 8.0);
    let snapped = (middle / grid).round() * grid;
    if snapped.is_finite() { snapped } else { middle }
}

/// The largest power of two that is not above `v` > 0; exact on every platform.
fn power_of_two_below(v: f64) -> f64 {
    let power = f64::from_bits(v.to_bits() & 0x7ff0_0000_0000_0000);
    if power > 0.0 { power } else { f64::MIN_POSITIVE }
}

/// Leaves out the points where `keep` is false, and the triangles on them.
pub(super) fn retain(cloud: &mut PointCloud, keep: &[bool]) {
    fn pick<T>(list: &mut Vec<T>, keep: &[bool]) {
        let mut i = 0;
        list.retain(|_| {
            i += 1;
            keep[i - 1]
        });
    }
    pick(&mut cloud.positions, keep);
    if let Some(list) = &mut cloud.normals {
        pick(list, keep);
    }
    for list in [&mut cloud.radii, &mut cloud.opacity, &mut cloud.intensity].into_iter().flatten() {
        pick(list, keep);
    }
    if let Some(list) = &mut cloud.colors {
        pick(list, keep);
    }
    if let Some(list) = &mut cloud.classes {
        pick(list, keep);
    }
    if let Some(mesh) = &mut cloud.mesh {
        let mut next = 0u32;
        let renumbered: Vec<u32> = keep
            .iter()
            .map(|&k| {
                next += u32::from(k);
                next.wrapping_sub(1)
            })
            .collect();
        let before = mesh.triangles.len();
        mesh.triangles.retain_mut(|t| {
            let whole = t.iter().all(|&i| keep[i as usize]);
            *t = t.map(|i| renumbered[i as usize]);
            whole
        });
        cloud.report.drop("faces on dropped points", (before - mesh.triangles.len()) as u64);
        if mesh.triangles.is_empty() {
            cloud.mesh = None;
        }
    }
}

/// Makes normals unit vectors or zero, and counts what had to be done.
#[cfg_attr(not(feature = "ply"), allow(dead_code))]
pub(super) fn repair_normals(cloud: &mut PointCloud) {
    let Some(normals) = &mut cloud.normals else { return };
    let (mut zero, mut scaled) = (0u64, 0u64);
    for n in normals.iter_mut() {
        // In f64: squares of f32 neither overflow nor vanish.
        let wide = n.as_dvec3();
        let square = wide.length_squared();
        if !square.is_finite() || square == 0.0 {
            *n = Vec3::ZERO;
            zero += 1;
        } else if (square - 1.0).abs() > 4e-7 {
            // 4e-7 is what rounding a unit vector to f32 can do; up to 2e-3 is what writing it as text with three
            // digits can do, which is not worth a line.
            scaled += u64::from((square - 1.0).abs() > 2e-3);
            *n = (wide / square.sqrt()).as_vec3();
        }
    }
    if zero == normals.len() as u64 {
        cloud.normals = None;
        cloud.report.assume("all normals in the file are zero: taken as absent");
    } else {
        cloud.report.repair("normals that were zero or not finite", zero);
        cloud.report.repair("normals that were not of unit length", scaled);
    }
}

/// Makes radii finite and positive: a broken one becomes the median of the others.
#[cfg_attr(not(feature = "ply"), allow(dead_code))]
pub(super) fn repair_radii(cloud: &mut PointCloud) {
    let Some(radii) = &mut cloud.radii else { return };
    let good = |r: f32| r.is_finite() && r > 0.0;
    let broken = radii.iter().filter(|r| !good(**r)).count();
    if broken == radii.len() {
        cloud.radii = None;
        cloud.report.assume("no radius in the file is positive: taken as absent");
    } else if broken > 0 {
        let mut fine: Vec<f32> = radii.iter().copied().filter(|r| good(*r)).collect();
        let middle = fine.len() / 2;
        let median = *fine.select_nth_unstable_by(middle, f32::total_cmp).1;
        radii.iter_mut().filter(|r| !good(**r)).for_each(|r| *r = median);
        cloud.report.repair("radii that were not positive", broken as u64);
    }
}

/// The cloud, or the error that says why nothing is left of it.
pub(super) fn finish(cloud: PointCloud, file: &Path) -> Result<PointCloud> {
    if !cloud.is_empty() {
        return Ok(cloud);
    }
    let mut why = format!("no point left: {} in the file", cloud.report.points_in_file);
    for (reason, n) in &cloud.report.dropped {
        why += &format!(", {n} dropped for {reason}");
    }
    Err(Error::data(file, Place::File, why))
}
