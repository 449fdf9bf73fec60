//! What every reader does between raw values and a [`PointCloud`] that keeps its promises.

use glam::DVec3;

use super::PointCloud;

/// Why points are missing whose offset does not fit an f32.
pub(super) const TOO_FAR: &str = "coordinates too far from the rest for 32-bit floats";

/// How many values the choice of an origin looks at: enough for a percentile, few enough to cost nothing.
pub(super) const SAMPLE: usize = 4096;

/// Evenly spread indices into `n` items, at most [`SAMPLE`] of them.
pub(super) fn sample(n: usize) -> impl Iterator<Item = usize> {
    let step = n.div_ceil(SAMPLE).max(1);
    (0..n).step_by(step)
}

/// (2nd percentile, 98th percentile) of a sample, at least one value left out at each end if there are four: a stray
/// point must not decide where precision goes.
pub(super) fn core_range<T: Copy>(values: &mut [T], compare: impl Fn(&T, &T) -> std::cmp::Ordering) -> Option<(T, T)> {
    values.sort_unstable_by(compare);
    let last = values.len().checked_sub(1)?;
    let skip = (last / 50).max(usize::from(last >= 3));
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
