//! Where a cloud lies: the exact box, and one that stray points do not blow up.

use glam::DVec3;

use super::PointCloud;

/// Axis-aligned boxes and a sphere, in world units and world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Lowest corner of the exact box.
    pub min: DVec3,
    /// Highest corner of the exact box.
    pub max: DVec3,
    /// Lowest corner of the robust box: the 0.1 percentile on each axis.
    pub robust_min: DVec3,
    /// Highest corner of the robust box: the 99.9 percentile on each axis.
    pub robust_max: DVec3,
    /// Centre of the robust box.
    pub center: DVec3,
    /// Half the robust box's diagonal \[world units\]; zero for coincident points.
    pub radius: f64,
}

impl Bounds {
    /// The bounds of all points; `None` for an empty cloud.
    ///
    /// O(n) time, 4 bytes a point of scratch memory. With n points the robust box leaves out ⌊(n − 1) / 1000⌋ at each
    /// end of each axis, so below 1001 points it is the exact box.
    pub fn of(cloud: &PointCloud) -> Option<Bounds> {
        let skip = cloud.len().checked_sub(1)? / 1000;
        let mut scratch = Vec::with_capacity(cloud.len());
        let (mut ends, mut robust) = ([[0.0; 2]; 3], [[0.0; 2]; 3]);
        for axis in 0..3 {
            scratch.clear();
            scratch.extend(cloud.positions.iter().map(|p| p[axis]));
            let last = scratch.len() - 1;
            let origin = cloud.origin[axis];
            let (below, low, rest) = scratch.select_nth_unstable_by(skip, f32::total_cmp);
            let (low, mut high) = (*low, *low);
            let lowest = below.iter().copied().fold(low, f32::min);
            let mut highest = low;
            // What is above the low percentile holds the high one, unless there is only one point in between.
            if last - skip > skip {
                let (_, at, above) = rest.select_nth_unstable_by(last - 2 * skip - 1, f32::total_cmp);
                high = *at;
                highest = above.iter().copied().fold(high, f32::max);
            } else {
                highest = rest.iter().copied().fold(highest, f32::max);
            }
            ends[axis] = [origin + f64::from(lowest), origin + f64::from(highest)];
            robust[axis] = [origin + f64::from(low), origin + f64::from(high)];
        }
        let corner = |of: &[[f64; 2]; 3], end: usize| DVec3::new(of[0][end], of[1][end], of[2][end]);
        let (robust_min, robust_max) = (corner(&robust, 0), corner(&robust, 1));
        Some(Bounds {
            min: corner(&ends, 0),
            max: corner(&ends, 1),
            robust_min,
            robust_max,
            center: robust_min + 0.5 * (robust_max - robust_min),
            radius: 0.5 * (robust_max - robust_min).length(),
        })
    }
}
