//! Very many splats, very small weights, and what lies within the tolerance.

use std::sync::Arc;

use glam::Vec3;

use super::scenes::{ahead, blends, plain, random, random_colors, take};
use super::{Case, TARGET, Take};
use crate::load::PointCloud;
use crate::style::{Style, SumPrecision, Tolerance};
use crate::technique::{Blend, Technique};

pub fn cases() -> Vec<Case> {
    [heaps(), rims(), tolerances()].concat()
}

/// `n` splats facing the eye 3 units ahead, in one place or within `spread` of it, `radius` wide.
fn heap(n: usize, spread: f32, radius: f32) -> PointCloud {
    let mut state = 5;
    let mut jitter = || spread * (2.0 * random(&mut state) - 1.0);
    PointCloud {
        positions: (0..n).map(|_| Vec3::new(0.01 + jitter(), 0.02 + jitter(), -3.0)).collect(),
        radii: Some(vec![radius; n]),
        colors: Some(random_colors(n)),
        ..PointCloud::default()
    }
}

fn heaps() -> Vec<Case> {
    const GROUP: &str = "heaps";
    let mut cases = Vec::new();
    for technique in blends() {
        // The first of equals wins, so ties are right too.
        let n = 100_000;
        let coincident = Arc::new(heap(n, 0.0, 0.03));
        let case = Case::new(GROUP, "1e5 in one place", take(&coincident, ahead(0.01), technique)).covered(2).ties(0);
        cases.push(match technique.blend {
            Blend::Opaque => case,
            _ => {
                case.bound(2.0 * n as f64 / (1 << 24) as f64, "f32 sums of n terms: n 2^-24 each, two of them divided")
            }
        });
        if technique.blend == Blend::Opaque {
            let pixel = Arc::new(heap(10_000, 0.002, 0.002));
            cases.push(Case::new(GROUP, "1e4 on one pixel", take(&pixel, ahead(0.01), technique)).covered(3));
        }
    }
    cases.extend([10, 1000, 10_000].map(|n| heap_on_a_pixel(n, SumPrecision::Single)));
    // As far as the bound says anything.
    cases.extend([1, 10, 100].map(|n| heap_on_a_pixel(n, SumPrecision::Half)));
    cases
}

/// `n` splats within one pixel, their sums in this precision: for tables of error against n.
pub fn heap_on_a_pixel(n: usize, sums: SumPrecision) -> Case {
    let cloud = Arc::new(heap(n, 0.002, 0.002));
    let style = Style { sums, ..plain() };
    let take = Take { style, ..take(&cloud, ahead(0.01), Technique::TWO_PASS) };
    let (bits, why) = match sums {
        SumPrecision::Single => (24, "f32 sums of n terms: n 2^-24 each, two of them divided"),
        SumPrecision::Half => {
            (11, "fp16 sums of n terms, each rounded before: (n + 1) 2^-11 each, two of them divided")
        }
    };
    let bound = 2.0 * (n + 1) as f64 / (1u32 << bits) as f64;
    // Ten splats are summed more exactly than their weights are known.
    Case::new("heaps", format!("{n} on one pixel, {sums:?}"), take).covered(1).bound(bound.max(1e-5), why).ties(4)
}

/// Alone in the picture, so that every weight down to 1/16 shows.
fn rims() -> Vec<Case> {
    const GROUP: &str = "rims";
    let mut cases = Vec::new();
    for technique in blends() {
        for (name, radius) in [("low-pass alone", 1e-4f32), ("1 px", 0.0229), ("4 px", 0.09)] {
            let mut state = 3;
            let mut place = |i: usize| {
                let jitter = 0.05 * (random(&mut state) - 0.5);
                Vec3::new(0.2 * (i % 15) as f32 - 1.4 + jitter, 0.2 * (i / 15) as f32 - 0.9 - jitter, -3.0)
            };
            let cloud = PointCloud {
                positions: (0..150).map(&mut place).collect(),
                normals: Some((0..150).map(|i| Vec3::new((i as f32).sin(), (i as f32).cos(), 1.2)).collect()),
                radii: Some(vec![radius; 150]),
                colors: Some(random_colors(150)),
                ..PointCloud::default()
            };
            cases.push(Case::new(GROUP, name, take(&Arc::new(cloud), ahead(0.01), technique)).covered(300));
        }
    }
    cases
}

/// Two parallel sheets at 3 and 3.1.
fn tolerances() -> Vec<Case> {
    const GROUP: &str = "tolerances";
    let between = 0.1f32;
    let place = |i: usize| {
        let (x, y) = ((i % 30) as f32 / 14.5 - 1.0, (i / 30 % 30) as f32 / 14.5 - 1.0);
        Vec3::new(x + 0.013, y + 0.021, -3.0 - if i < 900 { 0.0 } else { between })
    };
    let cloud = Arc::new(PointCloud {
        positions: (0..1800).map(place).collect(),
        normals: Some(vec![Vec3::Z; 1800]),
        radii: Some(vec![0.08; 1800]),
        colors: Some(random_colors(1800)),
        ..PointCloud::default()
    });
    [1e-6, 1e-3, 0.5, 0.999, 1.001, 2.0, 1e3]
        .into_iter()
        .map(|times| {
            let style = Style { tolerance: Tolerance { absolute: times * between, relative: 0.0 }, ..plain() };
            let take = Take { style, ..take(&cloud, ahead(0.01), Technique::TWO_PASS) };
            let case = Case::new(GROUP, format!("{times:e} of the distance of two surfaces"), take);
            match times {
                // Splats of one sheet hide each other: f32 decides, at 3 units to 2·10⁻⁷, among equal depths.
                t if t < 1e-5 => {
                    case.bound(TARGET, "as ever, but coplanar splats are ties everywhere").ties(usize::MAX)
                }
                _ => case,
            }
        })
        .collect()
}
