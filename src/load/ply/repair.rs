//! Attributes that a text or a tool has spoilt: kept where a sensible value exists, and counted.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::Vec3;

use crate::load::PointCloud;
use crate::par;

/// Makes normals unit vectors or zero, and counts what had to be done.
pub(super) fn normals(cloud: &mut PointCloud) {
    let Some(normals) = &mut cloud.normals else { return };
    let (zero, scaled) = (AtomicU64::new(0), AtomicU64::new(0));
    par::fill(normals, 1 << 14, |_, normals| {
        let (mut zeros, mut scales) = (0, 0);
        for n in normals {
            // In f64: squares of f32 neither overflow nor vanish.
            let wide = n.as_dvec3();
            let square = wide.length_squared();
            // 4e-7 is what rounding a unit vector to f32 can do.
            if (square - 1.0).abs() <= 4e-7 {
                continue;
            }
            if !square.is_finite() || square == 0.0 {
                *n = Vec3::ZERO;
                zeros += 1;
            } else {
                // Up to 2e-3 is what writing it as text with three digits can do, which is not worth a line.
                scales += u64::from((square - 1.0).abs() > 2e-3);
                *n = (wide / square.sqrt()).as_vec3();
            }
        }
        // Sums do not depend on the order.
        zero.fetch_add(zeros, Ordering::Relaxed);
        scaled.fetch_add(scales, Ordering::Relaxed);
    });
    let (zero, scaled) = (zero.into_inner(), scaled.into_inner());
    if zero == normals.len() as u64 {
        cloud.normals = None;
        cloud.report.assume("all normals in the file are zero: taken as absent");
    } else {
        cloud.report.repair("normals that were zero or not finite", zero);
        cloud.report.repair("normals that were not of unit length", scaled);
    }
}

/// Makes radii finite and positive: a broken one becomes the median of the others.
pub(super) fn radii(cloud: &mut PointCloud) {
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
