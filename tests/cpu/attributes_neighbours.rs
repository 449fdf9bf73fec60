//! k-nearest neighbours against a scan of all points.

use std::collections::HashSet;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::Vec3;
use proptest::prelude::*;
use surfel::load::attributes::neighbours::Tree;

use crate::attributes_shapes::{Random, square};

fn distance_squared(a: Vec3, b: Vec3) -> f32 {
    let d = b - a;
    (d.x * d.x + d.y * d.y + d.z * d.z).min(f32::MAX)
}

/// Squared distances, ascending, to the k nearest points at other places, each place once.
fn naive(points: &[Vec3], p: Vec3, k: usize) -> Vec<f32> {
    let mut seen = HashSet::new();
    let places = points.iter().filter(|q| **q != p && seen.insert((**q + Vec3::ZERO).to_array().map(f32::to_bits)));
    let mut all: Vec<f32> = places.map(|q| distance_squared(p, *q)).collect();
    all.sort_by(f32::total_cmp);
    all.truncate(k);
    all
}

fn check(points: &[Vec3], k: usize) {
    let tree = Tree::new(points);
    assert_eq!(tree.len() + tree.copies().len(), points.len());
    for &[copy, first] in tree.copies() {
        assert!(first < copy);
        assert_eq!(points[copy as usize], points[first as usize]);
    }
    let told = AtomicUsize::new(0);
    let mut out = vec![Vec::new(); tree.len()];
    let done = |n| {
        told.fetch_add(n, Ordering::Relaxed);
    };
    tree.search(
        k,
        &mut out,
        |rank, found, out| {
            *out = std::iter::once((rank, 0.0)).chain(found.iter().map(|n| (n.rank(), n.distance_squared()))).collect()
        },
        done,
    );
    assert_eq!(told.into_inner(), tree.len());
    for (rank, found) in out.iter().enumerate() {
        assert_eq!(found[0].0, rank, "each point is visited with its own element");
        let p = points[tree.index(rank)];
        assert_eq!(tree.position(rank), p);
        let distances: Vec<f32> = found[1..].iter().map(|n| n.1).collect();
        // Exactly: the tree sums squares in the same order, and its pruning loses nothing.
        assert_eq!(distances, naive(points, p, k));
        let ranks: HashSet<usize> = found.iter().map(|n| n.0).collect();
        assert_eq!(ranks.len(), found.len(), "nobody twice, and not the point itself");
        for &(r, d) in &found[1..] {
            assert_eq!(distance_squared(p, tree.position(r)), d);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Few places, so that most points coincide and most distances tie.
    #[test]
    fn lattice_with_copies(cells in prop::collection::vec((0i8..5, -3i8..2, 0i8..3), 0..400), k in 1usize..=32) {
        let points: Vec<Vec3> = cells.iter().map(|&(x, y, z)| Vec3::new(x.into(), y.into(), z.into())).collect();
        check(&points, k);
    }

    /// Scales from 1e-6 to 1e7 in one cloud: clusters, outliers, and empty space between.
    #[test]
    fn uneven(parts in prop::collection::vec((-1f32..1., -1f32..1., -1f32..1., -6i32..7), 0..300), k in 1usize..=32) {
        let points: Vec<Vec3> = parts.iter().map(|&(x, y, z, e)| Vec3::new(x, y, z) * 10f32.powi(e)).collect();
        check(&points, k);
    }
}

#[test]
fn lines_planes_and_signed_zeros() {
    check(&(0..200).map(|i| Vec3::X * (i * i) as f32).collect::<Vec<_>>(), 16);
    check(&square(500, &mut Random::new()), 16);
    check(&[Vec3::ZERO, -Vec3::ZERO, Vec3::Y], 3);
    check(&[], 1);
    // Squares that overflow still count as neighbours.
    check(&[Vec3::X * 3e38, Vec3::X * -3e38, Vec3::Y * 1e30], 2);
}

/// A quadratic search would compare 4e10 pairs here and not come back.
#[test]
fn coincident_and_nearly_coincident_points_stay_cheap() {
    let mut points = vec![Vec3::ONE; 200_000];
    points.extend(square(100, &mut Random::new()));
    // Distinct, but so near that all squared distances among them are 0.
    points.extend((0..200_000).map(|i| Vec3::new(2e-30 * i as f32, 0.0, 0.0)));
    let tree = Tree::new(&points);
    let mut out = vec![0; tree.len()];
    tree.search(16, &mut out, |_, found, out| *out = found.len(), |_| {});
    assert!(out.iter().all(|&n| n == 16));
    assert_eq!(tree.copies().len(), 199_999);
}
