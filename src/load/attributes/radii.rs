//! Covering radii from local density, and guards against disks that stick out.
//!
//! The rule: h = d_k √(π / k) with k = 8, where d_k is the distance to the k-th neighbour in
//! the tangent plane: k points in a disk of radius d_k, each on its square of side h. r = κ h, where
//! κ = clamp(2.2 − 1.2 d₁ / h, 1, 1.6) tells even sampling (d₁ = h and more: κ = 1) from random (d₁ = h / 2 on average:
//! κ = 1.6, which leaves e^(−πκ²) = 0.03 % uncovered).
//!
//! The rule is a mean and leaves gaps in random samplings, where a void is wider than its rim is sparse. So r also reaches
//! 5/4 of the way to the farthest corner of the point's Voronoi cell among its neighbours in the tangent plane: every spot
//! lies in some cell, so cells that are covered leave none, and three disks that meet in a corner at 4/5 of their radii
//! have weights that add up to ½, full coverage.
//!
//! Where a neighbourhood is not a whole disk, the rule alone overestimates. Four guards, in this order:
//! 1. *Borders.* At a border the k neighbours fill a part of the disk, and next to none lie behind. Their centre of mass
//!    tells how large a part: h is reduced by its square root, before κ is found.
//! 2. *No surface.* Where neighbours spread across the tangent plane nearly as much as within it (leaves, wires in the
//!    air, strays), there is nothing to cover: the radius goes down to 2/5, since a disk there is a flap.
//! 3. *Strays far from everything*, alone or in small clouds: no radius beyond 4 times the 99th percentile.
//! 4. *Outliers near a surface*: no more than twice the median radius of the 8 neighbours (called m), unless a
//!    point whose own radius stands at m has this one among its neighbours: then it is not an outlier but the edge of
//!    a sparser region, and may have that point's radius.

use std::f32::consts::PI;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{Vec2, Vec3, vec2};
use rayon::prelude::*;

/// Neighbours in the density estimate.
pub(super) const K: usize = 8;
/// The radius where there is no distance to derive it from: one point, or all at one place \[world units\].
pub(super) const FALLBACK: f32 = 1.0;
/// A neighbour slot that is not used.
pub(super) const NO_ONE: u32 = u32::MAX;

/// The rule and the border guard for one point whose neighbours, nearest first, lie at these `offsets` (more than
/// [`K`] are better); a zero `normal` measures in space rather than in the tangent plane. Zero without neighbours.
pub(super) fn radius(offsets: &[Vec3], normal: Vec3) -> f32 {
    let mut squared = [0.0f32; super::neighbours::MAX_NEIGHBOURS];
    let squared = &mut squared[..offsets.len()];
    let flat = |o: &Vec3| *o - normal * normal.dot(*o);
    let mut centre = Vec3::ZERO;
    for (s, o) in squared.iter_mut().zip(offsets) {
        let o = flat(o);
        centre += o;
        *s = o.length_squared().min(f32::MAX);
    }
    squared.sort_unstable_by(f32::total_cmp);
    let Some(last) = squared.last() else { return 0.0 };
    let k = K.min(squared.len());
    // Points stacked along the normal would have no distance in the plane: at least a tenth of that in space.
    let d_k = squared[k - 1].sqrt().max(0.1 * offsets[k - 1].length().min(f32::MAX));
    // Fewer neighbours than the rule needs say nothing of an area.
    let h = if k < K { d_k } else { d_k * (PI / k as f32).sqrt() };
    if h == 0.0 {
        return 0.0;
    }
    let off = centre.length() / (offsets.len() as f32 * last.sqrt());
    // More than one point within 70 degrees of straight behind: unevenly filled, but no border.
    let behind = |o: &&Vec3| flat(o).dot(centre) < -0.34 * flat(o).length() * centre.length();
    let border = off > 0.2 && offsets.iter().filter(behind).count() <= 1;
    let h = if border { h * filled(off).sqrt() } else { h };
    let even = (2.2 - 1.2 * squared[0].sqrt() / h).clamp(1.0, 1.6);
    // A cell at a border has its far corners outside; beyond twice the rule a void is a hole of the surface, not of the
    // sampling.
    let covering = if border { 0.0 } else { 1.25 * farthest_corner(offsets, normal, 2.0 * h) };
    (even * h).max(covering.min(2.0 * even * h)) * coherence(offsets, normal)
}

/// Distance of the farthest corner of the Voronoi cell of the origin among the `offsets` in the plane of `normal`, of the
/// corners within `reach` along both axes: open sides, as at borders, have none there. Zero without corners.
fn farthest_corner(offsets: &[Vec3], normal: Vec3, reach: f32) -> f32 {
    if normal == Vec3::ZERO || !(reach > 0.0 && reach < 1e18) {
        return 0.0;
    }
    let (u, v) = normal.any_orthonormal_pair();
    // The cell so far, a convex polygon; each clip adds at most one corner.
    let mut cell = [Vec2::ZERO; 4 + super::neighbours::MAX_NEIGHBOURS];
    cell[..4].copy_from_slice(&[vec2(-1.0, -1.0), vec2(1.0, -1.0), vec2(1.0, 1.0), vec2(-1.0, 1.0)]);
    let mut count = 4;
    for o in offsets {
        let o = vec2(u.dot(*o), v.dot(*o)) / reach;
        let half = 0.5 * o.length_squared();
        // Stacked along the normal, or too far to cut anything.
        if !(half > 1e-12 && half < 2.0 * o.length()) {
            continue;
        }
        let mut clipped = [Vec2::ZERO; 4 + super::neighbours::MAX_NEIGHBOURS];
        let mut kept = 0;
        for i in 0..count {
            let (a, b) = (cell[i], cell[(i + 1) % count]);
            let (da, db) = (half - o.dot(a), half - o.dot(b));
            if da >= 0.0 && kept < clipped.len() {
                clipped[kept] = a;
                kept += 1;
            }
            if (da >= 0.0) != (db >= 0.0) && kept < clipped.len() {
                clipped[kept] = a + (b - a) * (da / (da - db));
                kept += 1;
            }
        }
        (cell, count) = (clipped, kept);
    }
    let inner = cell[..count].iter().filter(|c| c.abs().max_element() < 0.999);
    reach * inner.map(|c| c.length()).fold(0.0, f32::max)
}

/// 1 where the neighbours lie about a plane, down to 2/5 where they do not. Noise of half a spacing spreads them across
/// by a tenth (as variances) of what they spread within; 16 points strewn in a ball by a quarter.
fn coherence(offsets: &[Vec3], normal: Vec3) -> f32 {
    if normal == Vec3::ZERO || offsets.len() < K {
        return 1.0;
    }
    let n = offsets.len() as f32;
    let (mut mean, mut across, mut all) = (Vec3::ZERO, 0.0, 0.0);
    for o in offsets {
        mean += *o / n;
        across += normal.dot(*o).powi(2);
        all += o.length_squared();
    }
    let across = across - n * normal.dot(mean).powi(2);
    let within = all - n * mean.length_squared() - across;
    let spread = across / within;
    // Also 1 where overflow leaves no number.
    if spread > 0.12 { 1.0 - 0.6 * ((spread - 0.12) / 0.13).min(1.0) } else { 1.0 }
}

/// The part of a disk that is filled, when its points' centre of mass lies at `off` of its radius: at 4/(3π) = 0.42 for
/// half a disk and 0.60 for a quarter, but 16 points of a jittered or random border stray by 0.16 on average, so half is
/// taken from 0.36 on. No evenly filled corner, however sharp, is beyond 2/3: there the points are a clump on one side,
/// which says nothing of a border.
fn filled(off: f32) -> f32 {
    const STEPS: [(f32, f32); 6] = [(0.0, 1.0), (0.2, 1.0), (0.36, 0.5), (0.6, 0.25), (0.67, 0.25), (0.8, 1.0)];
    for pair in STEPS.windows(2) {
        let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
        if off < x1 {
            return y0 + (y1 - y0) * (off - x0) / (x1 - x0);
        }
    }
    1.0
}

/// What the guards need of a point: its radius and its nearest neighbours' ranks.
pub(super) trait Spaced: Sync {
    /// From [`radius`].
    fn radius(&self) -> f32;
    /// Up to [`K`] ranks, then [`NO_ONE`].
    fn near(&self) -> &[u32; K];
}

/// Guards 3 and 4 over all points: the final radii, finite and > 0.
pub(super) fn guarded<T: Spaced>(points: &[T]) -> Vec<f32> {
    let mut sorted: Vec<f32> = points.par_iter().map(Spaced::radius).filter(|r| *r > 0.0).collect();
    if sorted.is_empty() {
        return vec![FALLBACK; points.len()];
    }
    let at = (sorted.len() - 1) * 99 / 100;
    let most = (4.0 * *sorted.select_nth_unstable_by(at, f32::total_cmp).1).min(f32::MAX);
    drop(sorted);
    let capped = |i: usize| points[i].radius().min(most);

    let local: Vec<f32> = (0..points.len())
        .into_par_iter()
        .map(|i| {
            let mut near = [0.0f32; K];
            let mut count = 0;
            for &j in points[i].near().iter().take_while(|&&j| j != NO_ONE) {
                near[count] = capped(j as usize);
                count += 1;
            }
            let near = &mut near[..count];
            near.sort_unstable_by(f32::total_cmp);
            // The lower median: of two neighbours, the smaller.
            let median = if count == 0 { capped(i) } else { near[(count - 1) / 2] };
            capped(i).min(2.0 * median)
        })
        .collect();

    // The largest radius that vouches for each point. A maximum does not depend on the order; the bits of
    // non-negative floats order as the floats do.
    let vouched: Vec<AtomicU32> = points.par_iter().map(|_| AtomicU32::new(0)).collect();
    points.par_iter().zip(&local).for_each(|(p, r)| {
        for &j in p.near().iter().take_while(|&&j| j != NO_ONE) {
            let slot = &vouched[j as usize];
            // Almost always the plain read suffices.
            if slot.load(Ordering::Relaxed) < r.to_bits() {
                slot.fetch_max(r.to_bits(), Ordering::Relaxed);
            }
        }
    });
    (0..points.len())
        .into_par_iter()
        .map(|i| {
            let r = local[i].max(capped(i).min(f32::from_bits(vouched[i].load(Ordering::Relaxed))));
            usable(r)
        })
        .collect()
}

/// Any radius made finite and > 0.
pub(super) fn usable(r: f32) -> f32 {
    if r.is_nan() { FALLBACK } else { r.clamp(f32::MIN_POSITIVE, f32::MAX) }
}
