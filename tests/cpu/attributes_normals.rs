//! Estimated normals: how near to the truth, and on which side.

use glam::{DVec3, Vec3};
use surfel::load::PointCloud;
use surfel::load::attributes::{Options, RadiusRule, complete};

use crate::attributes_shapes::{Random, cloud, grid, sphere, square, torus};

fn completed(mut cloud: PointCloud) -> PointCloud {
    complete(&mut cloud, &Options::default());
    cloud
}

fn normals(cloud: PointCloud) -> Vec<Vec3> {
    completed(cloud).normals.unwrap()
}

/// A plane is found to within its coordinates' rounding. |z| ≤ 0.5, so each z is off by at most 2⁻²⁶ = 1.5e-8; a
/// fitted slope is off by at most that over the neighbours' root mean square along the narrowest direction. Their disk
/// has R = √(17 / (π 2000)) = 0.05; a thin one has a fifth of that, 0.01: 1.5e-6. The f32 normal adds 1e-7.
#[test]
fn plane_to_rounding() {
    let mut points = square(2000, &mut Random::new());
    points.iter_mut().for_each(|p| p.z = 0.3 * p.x + 0.2 * p.y);
    let truth = Vec3::new(-0.3, -0.2, 1.0).normalize();
    for n in normals(cloud(points)) {
        // No scanner, no up, flat: the positive side.
        assert!(n.cross(truth).length() < 2e-6 && n.dot(truth) > 0.0, "{n}");
        assert!((n.length() - 1.0).abs() < 1e-6);
    }
}

/// On a sphere the 16 neighbours lie within R = √(17 · 4π / (π n)), and the surface leaves a plane by a range of
/// R² / 2 over them. If all of it were slope (±R²/4 over a root mean square of R/2): R / 2. An even sampling
/// is nearly symmetric, so that much is never reached. The sphere is closed: normals are outward.
#[test]
fn sphere_within_curvature() {
    for up in [None, Some(Vec3::Z)] {
        let n = 5000;
        let reach = (17.0 * 4.0 / n as f32).sqrt();
        let points = sphere(n);
        let found = normals(PointCloud { up, ..cloud(points.clone()) });
        for (p, n) in points.iter().zip(found) {
            assert!(n.dot(*p) > 0.0 && n.cross(*p).length() < reach / 2.0, "{p} {n}");
        }
    }
}

/// Noise σ across a disk of radius R with N = 17 samples gives each slope the standard deviation σ / (√N · R/2),
/// and a tilt (two slopes) √2 times that. R follows from the density: N = π R² ρ. Fits at the border
/// and the spread of R make it a little more, never half as much or twice.
#[test]
fn noisy_plane_tilts_as_statistics_say() {
    let (count, mut random) = (20_000, Random::new());
    let reach = (17.0 / (std::f32::consts::PI * count as f32)).sqrt();
    let sigma = 0.1 * reach;
    let mut points = square(count, &mut random);
    points.iter_mut().for_each(|p| p.z = sigma * random.gauss());
    let found = normals(cloud(points));
    let tilt = (found.iter().map(|n| n.truncate().length_squared()).sum::<f32>() / count as f32).sqrt();
    let expected = std::f32::consts::SQRT_2 * sigma / (17f32.sqrt() * reach / 2.0);
    assert!(tilt > 0.5 * expected && tilt < 1.5 * expected, "{tilt} against {expected}");
    assert!(found.iter().all(|n| n.z > 0.0), "one side");
}

#[test]
fn torus_is_outward_everywhere() {
    let (points, truth) = torus(20_000, &mut Random::new());
    for origin in [Vec3::ZERO, Vec3::new(300.0, -200.0, 1000.0)] {
        let moved = points.iter().map(|p| *p + origin).collect();
        let found = normals(cloud(moved));
        assert!(found.iter().zip(&truth).all(|(n, t)| n.dot(*t) > 0.0), "{origin}");
    }
}

/// Parts are turned each on its own: 3 spheres, the smallest far from the others.
#[test]
fn every_component_is_outward() {
    let unit = sphere(1500);
    let places = [(Vec3::ZERO, 1.0), (Vec3::X * 5.0, 1.5), (Vec3::new(40.0, 40.0, -20.0), 0.3)];
    let points = places.iter().flat_map(|&(c, r)| unit.iter().map(move |p| c + r * *p)).collect();
    let found = normals(cloud(points));
    for (i, n) in found.iter().enumerate() {
        assert!(n.dot(unit[i % unit.len()]) > 0.0, "point {i}");
    }
}

/// Hills with slopes up to 60 degrees: one-sided, upward, whichever way is up.
#[test]
fn terrain_is_upward() {
    let mut random = Random::new();
    let mut points = grid(120, 0.1, 0.8, &mut random);
    points.iter_mut().for_each(|p| p.z = 1.5 * (p.x * 1.1).sin() * (p.y * 0.9).cos() + 0.005 * random.gauss());
    let up = |up: Vec3| completed(PointCloud { up: Some(up), ..cloud(points.clone()) });
    assert!(up(Vec3::Z).normals.unwrap().iter().all(|n| n.z > 0.0));
    assert!(up(Vec3::NEG_Z).normals.unwrap().iter().all(|n| n.z < 0.0));
}

/// The scanner decides where it is known; the caller's place goes before the file's. World and offsets differ.
#[test]
fn viewpoint_decides() {
    let origin = DVec3::new(5e5, 5.4e6, 100.0);
    let inside = PointCloud { origin, viewpoint: Some(origin), ..cloud(sphere(3000)) };
    let found = completed(inside.clone());
    assert!(found.positions.iter().zip(found.normals.unwrap()).all(|(p, n)| n.dot(*p) < 0.0));
    assert_eq!(
        found.report.assumed,
        [
            "normals estimated from 16 nearest neighbours, oriented to the scanner",
            "radii from the distance of the 8th neighbour and the gaps between neighbours"
        ]
    );

    let mut wall = PointCloud { positions: square(500, &mut Random::new()), ..inside };
    let below = Options { viewpoint: Some(origin - DVec3::Z), ..Default::default() };
    complete(&mut wall, &below);
    assert!(wall.normals.unwrap().iter().all(|n| n.z < -0.99));
}

#[test]
fn what_the_file_says_stays() {
    let points = square(300, &mut Random::new());
    let (given, radii) = (vec![Vec3::X; 300], vec![0.5; 300]);
    let full = PointCloud { normals: Some(given.clone()), radii: Some(radii.clone()), ..cloud(points.clone()) };
    let found = completed(full.clone());
    assert_eq!((found.normals, found.radii), (Some(given.clone()), Some(radii)));
    assert!(found.report.assumed.is_empty());

    let found = completed(PointCloud { radii: None, ..full.clone() });
    assert_eq!(found.normals, Some(given));
    assert!(found.radii.is_some() && found.report.assumed.len() == 1);

    let mut scaled = full.clone();
    complete(&mut scaled, &Options { radius: RadiusRule::Scale(2.0), ..Default::default() });
    assert_eq!(scaled.radii.unwrap(), vec![1.0; 300]);
    let mut set = full;
    complete(&mut set, &Options { radius: RadiusRule::Value(0.25), ..Default::default() });
    assert_eq!(set.radii.unwrap(), vec![0.25; 300]);
}
