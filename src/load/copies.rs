//! Heaps of points at one place: every one of them would be drawn over the same pixels.

use std::collections::HashMap;

use glam::Vec3;

use super::{PointCloud, clean};

/// Points that stay at one place: enough for a mean colour, few enough to be drawn.
pub const COPIES: u32 = 8;

/// Leaves at most [`COPIES`] points, the first ones, at every place that has a heap of them, and counts the rest in the
/// report.
///
/// A cloud is looked through only if four of 65,536 evenly spread samples share a place: heaps of a few dozen, as scanners
/// and meshes leave them, are kept. Clouds with faces are never touched.
pub fn thin_copies(cloud: &mut PointCloud) {
    if cloud.mesh.is_some() {
        return;
    }
    // −0 and 0 are one place.
    let key = |p: &Vec3| (*p + Vec3::ZERO).to_array().map(f32::to_bits);
    let step = cloud.len().div_ceil(1 << 16).max(1);
    let mut sampled: HashMap<[u32; 3], u32> = HashMap::new();
    let heaped = cloud.positions.iter().step_by(step).any(|p| {
        let seen = sampled.entry(key(p)).or_default();
        *seen += 1;
        // Where every point is a sample, only what would be left out counts.
        *seen >= if step > 1 { 4 } else { COPIES + 1 }
    });
    if !heaped {
        return;
    }
    let mut seen: HashMap<[u32; 3], u32> = HashMap::new();
    let keep: Vec<bool> = cloud
        .positions
        .iter()
        .map(|p| {
            let count = seen.entry(key(p)).or_default();
            *count += 1;
            *count <= COPIES
        })
        .collect();
    let left_out = keep.iter().filter(|k| !**k).count();
    clean::retain(cloud, &keep);
    cloud.report.drop("exact copies beyond eight at one place", left_out as u64);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(positions: Vec<Vec3>) -> PointCloud {
        PointCloud { colors: Some(vec![[1, 2, 3]; positions.len()]), positions, ..PointCloud::default() }
    }

    #[test]
    fn a_heap_is_thinned_and_counted() {
        let mut all_equal = cloud(vec![Vec3::ONE; 300_000]);
        thin_copies(&mut all_equal);
        assert_eq!((all_equal.len(), all_equal.colors.as_ref().unwrap().len()), (8, 8));
        assert_eq!(all_equal.report.dropped, [("exact copies beyond eight at one place".into(), 299_992)]);

        let mut small = cloud((0..20).map(|i| if i < 10 { Vec3::ZERO } else { Vec3::splat(i as f32) }).collect());
        small.positions[3].x = -0.0;
        thin_copies(&mut small);
        assert_eq!(small.len(), 18);
    }

    #[test]
    fn what_scanners_leave_is_kept() {
        let mut pairs = cloud((0..200_000).map(|i| Vec3::splat((i / 2) as f32)).collect());
        thin_copies(&mut pairs);
        assert_eq!(pairs.len(), 200_000);
        let mut none = cloud(Vec::new());
        thin_copies(&mut none);
        assert!(none.is_empty() && none.report.dropped.is_empty());
    }
}
