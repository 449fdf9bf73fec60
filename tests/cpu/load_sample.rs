//! Points sampled from a mesh: where they lie, how evenly, and what they carry.

use glam::{DVec3, Vec3, vec3};
use surfel::color::{linear_to_srgb, srgb_to_linear};
use surfel::load::attributes::{Options, complete};
use surfel::load::synthetic::{sphere_mesh, torus_mesh};
use surfel::load::{Mesh, PointCloud, sample_mesh};

fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> PointCloud {
    PointCloud { positions, mesh: Some(Mesh { triangles }), ..Default::default() }
}

/// Weights of a triangle's corners at the foot of p, and p's distance from the plane.
fn weights(corners: [DVec3; 3], p: DVec3) -> (DVec3, f64) {
    let [a, b, c] = corners;
    let n = (b - a).cross(c - a);
    let share = |q: DVec3, r: DVec3| (r - q).cross(p - q).dot(n) / n.length_squared();
    (DVec3::new(share(b, c), share(c, a), share(a, b)), n.dot(p - a) / n.length())
}

fn corners(cloud: &PointCloud, face: usize) -> [DVec3; 3] {
    cloud.mesh.as_ref().unwrap().triangles[face].map(|i| cloud.positions[i as usize].as_dvec3())
}

/// Ten faces of one plane, side by side and apart, whose areas differ by 1 : 10 000.
fn strips() -> PointCloud {
    let (mut positions, mut triangles) = (vec![], vec![]);
    for i in 0..10u32 {
        let (x, height) = (2.0 * i as f32, 10f32.powf(-4.0 * (i * 7 % 10) as f32 / 9.0));
        positions.extend([vec3(x, 0.0, 0.0), vec3(x + 1.0, 0.0, 0.0), vec3(x + 0.3, height, 0.0)]);
        triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh(positions, triangles)
}

#[test]
fn every_face_has_its_share_to_less_than_a_point() {
    let strips = strips();
    let areas: Vec<f64> = (0..10).map(|i| corners(&strips, i)).map(|[a, b, c]| (b - a).cross(c - a).length()).collect();
    let total: f64 = areas.iter().sum();
    for (points, seed) in [(1, 1), (17, 2), (1000, 3), (54_321, 4)] {
        let samples = sample_mesh(&strips, points, seed);
        assert_eq!((samples.len(), samples.mesh.is_none(), samples.radii.is_none()), (points, true, true));
        let (mut found, mut sum, mut expected) = ([0; 10], 0, 0.0);
        for p in &samples.positions {
            let face = (p.x / 2.0) as usize;
            let (w, off) = weights(corners(&strips, face), p.as_dvec3());
            // f32 rounds x by up to 2⁻²⁰ (below 32), which is as much of the low faces' height as 10⁻⁴ : 2⁻²⁰ allows.
            assert!(w.min_element() > -1e-6 && off.abs() < 1e-7, "{p} is beside face {face}: {w}");
            found[face] += 1;
        }
        for (face, area) in areas.iter().enumerate() {
            // Rounding of the ends: 10⁻¹⁶ of all.
            let share = points as f64 * area / total;
            assert!((found[face] as f64 - share).abs() < 1.0 + 1e-9, "{points}: {} of {share}", found[face]);
            (sum, expected) = (sum + found[face], expected + share);
            assert!((sum as f64 - expected).abs() < 1.0 + 1e-9, "faces up to {face}: {sum} of {expected}");
        }
    }
}

/// χ² over 256 equal parts of one face. Independent samples have 255 ± √(2 · 255) = 255 ± 23: half of it is 5.6 of these
/// deviations below, so what passes is evener than chance, and uneven areas would be far above.
#[test]
fn points_lie_more_evenly_than_by_chance() {
    let face = mesh(vec![vec3(-1.0, 2.0, 5.0), vec3(3.0, 2.5, 4.0), vec3(0.5, 7.0, 5.5)], vec![[0, 1, 2]]);
    for seed in 0..20 {
        let points = 5000;
        let samples = sample_mesh(&face, points, seed);
        let mut parts = [0u32; 256];
        for p in &samples.positions {
            let (w, _) = weights(corners(&face, 0), p.as_dvec3());
            // 16 rows from one side; row i has 31 − 2 i small triangles, upright and hanging.
            let row = ((w.z * 16.0) as usize).min(15);
            let along = ((w.x * 16.0) as usize).min(15 - row);
            let hanging = (w.x * 16.0).fract() + (w.z * 16.0).fract() > 1.0 && along + row < 15;
            let before: usize = (0..row).map(|r| 31 - 2 * r).sum();
            parts[before + 2 * along + hanging as usize] += 1;
        }
        let each = points as f64 / 256.0;
        let chi: f64 = parts.iter().map(|&n| (n as f64 - each).powi(2) / each).sum();
        assert!(chi < 0.5 * 255.0, "seed {seed}: χ² = {chi}");
    }
}

#[test]
fn attributes_are_interpolated_colours_in_linear_light() {
    let mut face = mesh(vec![Vec3::ZERO, vec3(4.0, 0.0, 0.0), vec3(0.0, 4.0, 0.0)], vec![[0, 1, 2]]);
    face.normals = Some(vec![Vec3::X, Vec3::Y, Vec3::Z]);
    face.colors = Some(vec![[255, 0, 10], [0, 255, 10], [0, 0, 10]]);
    face.intensity = Some(vec![1.0, 10.0, 100.0]);
    face.opacity = Some(vec![0.0, 0.5, 1.0]);
    face.classes = Some(vec![2, 5, 9]);
    (face.up, face.viewpoint, face.origin) = (Some(Vec3::Z), Some(DVec3::ONE), DVec3::splat(1e6));
    let samples = sample_mesh(&face, 500, 1);
    assert_eq!((samples.up, samples.viewpoint, samples.origin), (face.up, face.viewpoint, face.origin));
    for (i, p) in samples.positions.iter().enumerate() {
        // Positions are rounded to f32 after the weights were chosen: 2⁻²⁴ of 4, over 4.
        let w = weights(corners(&face, 0), p.as_dvec3()).0;
        let n = samples.normals.as_ref().unwrap()[i].as_dvec3();
        assert!((n - w.normalize()).length() < 1e-6, "{n} {w}");
        let [r, g, b] = samples.colors.as_ref().unwrap()[i];
        let byte = |v: f64| linear_to_srgb(v) * 255.0;
        // Half a step of rounding, and 10⁻⁶ more light at a slope of at most 12.92 · 255.
        assert!(
            (r as f64 - byte(w.x)).abs() < 0.505 && (g as f64 - byte(w.y)).abs() < 0.505 && b == 10,
            "{r} {g} {b} {w}"
        );
        assert!((srgb_to_linear(r as f64 / 255.0) - w.x).abs() < 0.005);
        let intensity = w.dot(DVec3::new(1.0, 10.0, 100.0));
        assert!((samples.intensity.as_ref().unwrap()[i] as f64 - intensity).abs() < 1e-4);
        assert!((samples.opacity.as_ref().unwrap()[i] as f64 - w.dot(DVec3::new(0.0, 0.5, 1.0))).abs() < 1e-6);
        assert_eq!(samples.classes.as_ref().unwrap()[i], [2, 5, 9][w.max_position()]);
    }
    face.normals = None;
    let flat = sample_mesh(&face, 5, 1);
    assert!(flat.normals.unwrap().iter().all(|n| *n == Vec3::Z), "without vertex normals, the face's");
}

#[test]
fn threads_change_nothing_and_seeds_do() {
    let torus = torus_mesh(40, 20);
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let [one, five] = [1, 5].map(|threads| pool(threads).install(|| sample_mesh(&torus, 50_000, 7)));
    assert!(one.positions == five.positions && one.normals == five.normals);
    assert!(one.positions != sample_mesh(&torus, 50_000, 8).positions);
}

/// Closed stays closed where the samples' normals say so, and what is completed has covering radii.
#[test]
fn samples_of_a_closed_mesh() {
    let mut sphere = sphere_mesh(20, 30);
    sphere.normals = None;
    complete(&mut sphere, &Options::default());
    assert!(sphere.closed);
    let mut samples = sample_mesh(&sphere, 20_000, 1);
    assert!(samples.closed);
    complete(&mut samples, &Options::default());
    let mut radii = samples.radii.clone().unwrap();
    radii.sort_by(f32::total_cmp);
    // κ from 1 to 1.6 times the spacing, and up to twice that in gaps.
    let spacing = (4.0 * std::f64::consts::PI / 20_000.0).sqrt();
    let median = radii[10_000] as f64 / spacing;
    assert!((0.9..2.0).contains(&median), "{median} spacings");
    let mut inverted = sphere.clone();
    inverted.normals.iter_mut().flatten().for_each(|n| *n = -*n);
    assert!(!sample_mesh(&inverted, 100, 1).closed);
    assert!(!sample_mesh(&PointCloud { closed: false, ..sphere }, 100, 1).closed);
}

#[test]
fn faces_without_area_get_nothing_and_are_counted() {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, vec3(2.0, 0.0, 0.0)];
    let cloud = mesh(positions.clone(), vec![[0, 0, 1], [0, 1, 2], [0, 1, 3], [2, 2, 2]]);
    let samples = sample_mesh(&cloud, 1000, 3);
    assert_eq!(samples.len(), 1000);
    assert!(samples.positions.iter().all(|p| p.x + p.y <= 1.0 + 1e-6 && p.min_element() >= 0.0));
    assert_eq!(samples.report.dropped, [("faces without area".to_owned(), 3)]);
    for bare in [mesh(positions.clone(), vec![[0, 1, 3]]), PointCloud { positions, ..Default::default() }] {
        let nothing = sample_mesh(&bare, 10, 1);
        assert!(nothing.is_empty() && !nothing.closed && nothing.report.assumed.len() == 1);
    }
}
