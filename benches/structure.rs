//! Throughput of what happens to a cloud before it is drawn, on all of rayon's threads (`RAYON_NUM_THREADS`).
//!
//! `attributes`: normals, orientation and radii of a noisy surface whose density falls 100 : 1, as scans' does; the
//! copy of the positions is not timed. `neighbours`: its search alone. `mesh`: the same from faces. `groups`: overlap graph
//! and colouring for several c. `sequential`: the point tree and its list, from points in any order.

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use surfel::load::attributes::neighbours::Tree;
use surfel::load::attributes::{Options, complete};
use surfel::load::{Mesh, PointCloud, synthetic};
use surfel::structure::groups::{Groups, Relax};
use surfel::structure::sequential::Options as TreeOptions;
use surfel::structure::{Arrangement, Flat, Sequential};

/// z = 5 sin(x/10) cos(7y/100) over 100 × 100, with noise of ± 0.025; x = 100 a³ for a uniform in [0, 1).
fn surface(n: usize) -> PointCloud {
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    let point = |_| {
        let (x, y) = (100.0 * next().powi(3), 100.0 * next());
        Vec3::new(x, y, 5.0 * (0.1 * x).sin() * (0.07 * y).cos() + 0.05 * (next() - 0.5))
    };
    PointCloud { positions: (0..n).map(point).collect(), up: Some(Vec3::Z), ..Default::default() }
}

/// A regular mesh of `side`² vertices over the same surface, without the noise.
fn mesh(side: u32) -> PointCloud {
    let at = |i: u32| 100.0 * i as f32 / side as f32;
    let positions = (0..side * side)
        .map(|i| (at(i % side), at(i / side)))
        .map(|(x, y)| Vec3::new(x, y, 5.0 * (0.1 * x).sin() * (0.07 * y).cos()))
        .collect();
    let corners = (0..side - 1).flat_map(|y| (0..side - 1).map(move |x| y * side + x));
    let triangles = corners.flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]]).collect();
    PointCloud { positions, mesh: Some(Mesh { triangles }), ..Default::default() }
}

/// The surface's own normals, all upward, and radii that follow the density.
fn check(cloud: &PointCloud) {
    let (normals, radii) = (cloud.normals.as_ref().unwrap(), cloud.radii.as_ref().unwrap());
    let upward = normals.iter().filter(|n| n.z > 0.0).count();
    assert!(upward as f64 > 0.95 * cloud.len() as f64, "{upward} of {} upward", cloud.len());
    let mut sorted = radii.clone();
    sorted.sort_by(f32::total_cmp);
    let spacing = 100.0 / (cloud.len() as f32).sqrt();
    let median = sorted[sorted.len() / 2] / spacing;
    assert!(sorted[0] > 0.0 && (0.5..2.0).contains(&median), "median radius {median} spacings");
}

fn attributes(c: &mut Criterion) {
    let mut group = c.benchmark_group("attributes");
    group.sample_size(10);
    for (name, cloud) in [("100k", surface(100_000)), ("1M", surface(1_000_000)), ("mesh 1M", mesh(1000))] {
        let completed = |mut cloud: PointCloud| {
            complete(&mut cloud, &Options::default());
            cloud
        };
        check(&completed(cloud.clone()));
        group.throughput(Throughput::Elements(cloud.len() as u64));
        group.bench_function(name, |b| b.iter_batched(|| cloud.clone(), completed, BatchSize::LargeInput));
    }
    group.finish();
}

fn neighbours(c: &mut Criterion) {
    let cloud = surface(100_000);
    let search = || {
        let tree = Tree::new(&cloud.positions);
        let mut farthest = vec![0.0f32; tree.len()];
        tree.search(16, &mut farthest, |_, found, out| *out = found[15].distance_squared(), |_| {});
        (tree, farthest)
    };
    // The naive line beside the clever one, on a few points.
    let (tree, farthest) = search();
    for rank in (0..tree.len()).step_by(tree.len() / 10) {
        let p = tree.position(rank);
        let mut all: Vec<f32> = cloud.positions.iter().map(|q| (*q - p).length_squared()).collect();
        all.sort_by(f32::total_cmp);
        assert!((all[16] - farthest[rank]).abs() <= 1e-6 * all[16]);
    }
    let mut group = c.benchmark_group("neighbours");
    group.sample_size(10).throughput(Throughput::Elements(tree.len() as u64));
    group.bench_function("100k", |b| b.iter(|| black_box(search())));
    group.finish();
}

/// Groups of a torus, whose radii are alike, and of the surface, whose radii differ by 100: overlap graph and colouring.
fn groups(c: &mut Criterion) {
    let mut scan = surface(1_000_000);
    complete(&mut scan, &Options::default());
    let torus = synthetic::scene("torus", 1_000_000, 1).expect("a torus");
    let mut group = c.benchmark_group("groups");
    group.sample_size(10);
    for (name, cloud) in [("torus 1M", &torus), ("surface 1M", &scan)] {
        let flat = Flat::new(cloud).arranged(Arrangement::Morton, |_| 0.0);
        for factor in [1.0, 0.8, 0.6, 0.4] {
            let relax = Relax { factor, ..Relax::default() };
            let made = Groups::color(&flat, &relax).expect("groups");
            println!(
                "{name}, c = {factor}: K / largest / mean degree {} / {} / {:.1}, {} conflicts",
                made.count, made.max_degree, made.mean_degree, made.conflicts
            );
            assert!(made.count > 1 && made.truncated == 0);
            group.throughput(Throughput::Elements(flat.len() as u64));
            let color = || Groups::color(&flat, &relax).expect("groups");
            group.bench_function(format!("{name}, c = {factor}"), |b| b.iter(|| black_box(color())));
        }
    }
    group.finish();
}

fn sequential(c: &mut Criterion) {
    let flat = Flat::new(&synthetic::scene("torus", 1_000_000, 1).expect("a torus"));
    let flat = flat.arranged(Arrangement::Random, |_| 0.0);
    let mut group = c.benchmark_group("sequential");
    group.sample_size(10).throughput(Throughput::Elements(flat.len() as u64));
    for (name, clusters) in [("torus 1M", false), ("torus 1M, clusters", true)] {
        let options = TreeOptions { clusters, ..TreeOptions::default() };
        let build = || Sequential::build(&flat, &options);
        let made = build();
        println!("{name}: {} inner nodes, {} B on the device", made.nodes.nodes.len(), made.bytes());
        assert!(made.flat.len() == flat.len() + made.nodes.nodes.len());
        group.bench_function(name, |b| b.iter(|| black_box(build())));
    }
    group.finish();
}

criterion_group!(benches, attributes, neighbours, groups, sequential);
criterion_main!(benches);
