//! What deciding costs the processor, on one thread: cuts of a layered point cloud with 131,071 nodes, the factor for a
//! budget, the fetch order, and the cache.
//!
//! The model is a unit sphere: node areas are halved level by level, patches have 2,048 samples, spacings follow.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DMat4, DVec3, dvec3};
use surfel::select::layered::{Cache, Cut, Limit, Refine, Role, affordable, factor_for, refine, wishes};
use surfel::select::{Sight, View};
use surfel::structure::layered::{Index, Node};
use surfel::structure::nodes::NONE;
use surfel::style::Style;

const LEVELS: u8 = 17;
const SAMPLES: u32 = 2048;

/// Of the part of the sphere with azimuths and heights in a rectangle.
fn node(low: [f64; 2], high: [f64; 2], level: u8, parent: u32) -> Node {
    let at = |u: f64, z: f64| {
        let (sin, cos) = u.sin_cos();
        (1.0 - z * z).max(0.0).sqrt() * dvec3(cos, sin, 0.0) + z * DVec3::Z
    };
    let share = |low: f64, high: f64, i: u32| low + (high - low) * i as f64 / 8.0;
    let points: Vec<DVec3> =
        (0..81).map(|i| at(share(low[0], high[0], i % 9), share(low[1], high[1], i / 9))).collect();
    let centre = points.iter().sum::<DVec3>() / 81.0;
    let axis = centre.normalize_or(DVec3::Z);
    // Between the grid's points the surface reaches no farther than a cell.
    let cell = (high[0] - low[0]).max(high[1] - low[1]) / 8.0;
    let ball = points.iter().map(|p| p.distance(centre)).fold(0.0, f64::max) + cell;
    let least = points.iter().map(|p| p.dot(axis)).fold(1.0, f64::min).clamp(-1.0, 1.0).acos() + cell;
    // Samples of all levels above lie in it as well: 1 + ½ + ¼ … of a patch.
    let area = 4.0 * std::f64::consts::PI / 2f64.powi(level as i32);
    let spacing = (area / (2.0 * SAMPLES as f64)).sqrt() as f32;
    Node {
        centre: centre.as_vec3(),
        ball: ball as f32,
        reach: 0.0,
        axis: axis.as_vec3(),
        cone: if level < 3 { -1.0 } else { least.cos() as f32 },
        spacing,
        published: spacing,
        split: if level + 1 < LEVELS { 0 } else { 3 },
        plane: 0.0,
        children: [NONE; 2],
        parent,
        level,
        samples: SAMPLES,
        at: 0,
        bytes: 10_000,
        checksum: 0,
    }
}

fn sphere() -> Index {
    let mut parts = vec![([-std::f64::consts::PI, -1.0], [std::f64::consts::PI, 1.0], 0, NONE)];
    let mut index = Index { closed: true, normals: true, ..Index::default() };
    let mut next = 0;
    while let Some(&(low, high, level, parent)) = parts.get(next) {
        let number = next as u32;
        index.nodes.push(node(low, high, level, parent));
        if level + 1 < LEVELS {
            let axis = (level % 2) as usize;
            let (mut middle_high, mut middle_low) = (high, low);
            middle_high[axis] = 0.5 * (low[axis] + high[axis]);
            middle_low[axis] = middle_high[axis];
            index.nodes[next].children = [parts.len() as u32, parts.len() as u32 + 1];
            parts.extend([(low, middle_high, level + 1, number), (middle_low, high, level + 1, number)]);
        }
        next += 1;
    }
    index
}

fn sight(distance: f64, threshold: f32) -> Sight {
    let lens = View::perspective(0.9, 1.0, 1e-3);
    let view = View::look_at(dvec3(distance, 0.1, 0.2), DVec3::ZERO, DVec3::Z, lens, Default::default());
    let style = Style { threshold, ..Style::default() };
    Sight::new(&view, [640, 640], &DMat4::IDENTITY, DVec3::ZERO, &style)
}

fn layered(c: &mut Criterion) {
    let index = sphere();
    assert_eq!(index.nodes.len(), (1 << LEVELS) - 1);
    let mut group = c.benchmark_group("layered");
    let options = Refine { back_faces_culled: true, fade: 1.25, prefetch: 0.8, ..Refine::default() };
    for (name, distance, threshold) in
        [("whole at 1 px", 2.5, 1.0), ("whole at 0.7 px", 2.5, 0.7), ("near at 0.35 px", 1.05, 0.35)]
    {
        let sight = sight(distance, threshold);
        let mut cut = Cut::default();
        refine(&index, &sight, &options, |_| 1.0, &mut cut);
        println!("{name}: {:?}", cut.counts);
        assert!(cut.counts.drawn > 100 && cut.steps.windows(2).all(|w| w[0].node < w[1].node));
        group.bench_function(format!("refine, {name}"), |b| {
            b.iter(|| refine(black_box(&index), &sight, &options, |_| 1.0, &mut cut));
        });

        // The budget is half of that; bisection beside it, to a hundredth.
        let samples = cut.counts.drawn as u64 * SAMPLES as u64 / 2;
        let sights = [sight];
        let factor = || factor_for(black_box(&index), &sights, &options, Limit::Samples(samples), 0.0);
        let count = |factor: f64, cut: &mut Cut| {
            refine(&index, &sights[0], &Refine { factor, fade: 1.0, ..options }, |_| 1.0, cut);
            cut.counts.samples
        };
        let bisect = |cut: &mut Cut| {
            let (mut low, mut high) = (0.25f64, 64.0f64);
            while high > 1.01 * low {
                let middle = (low * high).sqrt();
                if count(middle, cut) <= samples { high = middle } else { low = middle }
            }
            high
        };
        assert!(count(factor(), &mut cut) <= samples && (bisect(&mut cut) / factor() - 1.0).abs() < 0.011);
        group.bench_function(format!("factor for half of it, {name}"), |b| b.iter(factor));
        group.bench_function(format!("the same by bisection, {name}"), |b| b.iter(|| bisect(&mut cut)));

        // A frame in which a tenth is missing and comes at once, in place of what was there.
        let mut cache = Cache::new(&index, 4096, 0);
        cache.begin(1, 0);
        assert!((0..4096).all(|node| cache.insert(node, true).is_ok()));
        let mut number = 1;
        group.bench_function(format!("whole frame, {name}"), |b| {
            b.iter(|| {
                number += 1;
                cache.begin(number, number - 1);
                refine(&index, &sights[0], &options, |n| cache.presence(n), &mut cut);
                cache.mark(&cut);
                let wished = wishes([&cut]);
                let asked = affordable(&wished, 1_000_000, cache.room());
                wished[..asked].iter().filter(|w| cache.insert(w.node, w.priority > 0.0).is_ok()).count()
            });
        });
        assert!(cut.steps.iter().any(|step| step.role == Role::Drawn));
    }
    group.finish();
}

criterion_group!(benches, layered);
criterion_main!(benches);
