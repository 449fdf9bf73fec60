//! Clouds that break rules of thumb, and the same bytes for any number of threads.

use glam::{DVec3, Vec3};
use surfel::load::PointCloud;
use surfel::load::attributes::{Options, complete};

use crate::attributes_shapes::{Random, cloud, grid, square};

/// Completes the cloud, and holds what every completed cloud must hold.
fn completed(name: &str, positions: Vec<Vec3>) -> PointCloud {
    let mut last = cloud(Vec::new());
    for viewpoint in [None, positions.first().map(|p| p.as_dvec3()), Some(DVec3::splat(1e9))] {
        let mut cloud = cloud(positions.clone());
        complete(&mut cloud, &Options { viewpoint, ..Default::default() });
        let (normals, radii) = (cloud.normals.as_ref().unwrap(), cloud.radii.as_ref().unwrap());
        assert_eq!((normals.len(), radii.len()), (positions.len(), positions.len()), "{name}");
        for (n, r) in normals.iter().zip(radii) {
            assert!(*r > 0.0 && r.is_finite(), "{name}: radius {r}");
            assert!(*n == Vec3::ZERO || (n.length() - 1.0).abs() < 1e-5, "{name}: normal {n}");
        }
        assert!(!cloud.closed);
        last = cloud;
    }
    last
}

#[test]
fn no_panic_finite_positive() {
    let random = &mut Random::new();
    let line = |d: Vec3, n: usize| (0..n).map(|i| d * i as f32).collect::<Vec<_>>();
    let scaled = |s: f32, points: &[Vec3]| points.iter().map(|p| *p * s).collect::<Vec<_>>();
    let volume: Vec<Vec3> = (0..500).map(|_| Vec3::new(random.next(), random.next(), random.next())).collect();

    completed("empty", vec![]);
    assert_eq!(completed("one", vec![Vec3::ONE]).radii.unwrap(), [1.0]);
    // Two points, 3 apart: one neighbour gives its distance and no plane.
    let two = completed("two", vec![Vec3::ZERO, Vec3::X * 3.0]);
    assert_eq!((two.radii.unwrap(), two.normals.unwrap()), (vec![3.0; 2], vec![Vec3::ZERO; 2]));
    completed("three", vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    let one_place = completed("one place", vec![Vec3::splat(7.0); 100_000]);
    assert!(one_place.radii.unwrap().iter().all(|r| *r == 1.0));
    let lines = [("x", Vec3::X), ("diagonal", Vec3::new(0.1, 0.2, 0.7)), ("tiny", Vec3::splat(1e-6))];
    for (name, d) in lines {
        let cloud = completed(name, line(d, 1000));
        assert!(cloud.normals.unwrap().iter().all(|n| *n == Vec3::ZERO), "{name}: a line has no normal");
        assert_eq!(cloud.report.repaired, [("no plane through the neighbours: faces the viewer".to_owned(), 1000)]);
    }
    completed("lattice", grid(30, 1.0, 0.0, random));
    for s in [1e-6, 1e7, 1e-30, 1e30, 3e38, 1e-45] {
        completed("scaled square", scaled(s, &square(300, random)));
        completed("scaled volume", scaled(s, &volume));
    }
    let mut stray = volume.clone();
    stray.extend([Vec3::X * 1e7, Vec3::Y * -1e30, Vec3::Z * 3e38]);
    completed("strays", stray);
    let mut stack = square(50, random);
    stack.extend((0..5000).map(|i| Vec3::Z * i as f32));
    completed("stack", stack);
}

/// Copies get what the first has, however many there are.
#[test]
fn copies_agree() {
    let mut points = square(2000, &mut Random::new());
    let single = completed("single", points.clone());
    points.extend_from_within(500..1500);
    points.extend(std::iter::repeat_n(points[3], 50_000));
    let many = completed("copies", points);
    let radii = many.radii.unwrap();
    let normals = many.normals.unwrap();
    for i in 0..radii.len() {
        let first = if i < 2000 {
            i
        } else if i < 3000 {
            i - 1500
        } else {
            3
        };
        assert_eq!(radii[i], single.radii.as_ref().unwrap()[first]);
        assert_eq!(normals[i], single.normals.as_ref().unwrap()[first]);
    }
}

#[test]
fn same_bytes_for_any_thread_count() {
    let mut random = Random::new();
    let mut points = square(30_000, &mut random);
    for p in &mut points {
        p.x = p.x.powi(3);
        p.z = 0.1 * (p.x * 9.0).sin() + 0.003 * random.gauss();
    }
    points.extend_from_within(..1000);
    let run = |threads: usize| {
        let pool = rayon_pool(threads);
        let mut cloud = cloud(points.clone());
        pool.install(|| complete(&mut cloud, &Options::default()));
        let normals: Vec<[u32; 3]> = cloud.normals.unwrap().iter().map(|n| n.to_array().map(f32::to_bits)).collect();
        let radii: Vec<u32> = cloud.radii.unwrap().iter().map(|r| r.to_bits()).collect();
        (normals, radii, cloud.report)
    };
    let one = run(1);
    assert!(one == run(2));
    assert!(one == run(5));
}

fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}
