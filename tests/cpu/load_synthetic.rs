//! Scenes: exactly as many points as asked for, the same bytes every time, and shapes that are what they claim.

use glam::Vec3;
use surfel::load::synthetic::{SCENES, scene, sphere_mesh, torus_mesh};
use surfel::load::{Bounds, PointCloud};

use crate::load_files::check_promises;

/// FNV-1a over all bits of the arrays.
fn fingerprint(cloud: &PointCloud) -> u64 {
    let mut h = 0xcbf2_9ce4_8422_2325u64;
    let mut eat = |v: u32| h = (h ^ u64::from(v)).wrapping_mul(0x0100_0000_01b3);
    let vectors = cloud.positions.iter().chain(cloud.normals.iter().flatten());
    vectors.for_each(|p| p.to_array().iter().for_each(|v| eat(v.to_bits())));
    cloud.radii.iter().flatten().for_each(|r| eat(r.to_bits()));
    cloud.colors.iter().flatten().flatten().for_each(|c| eat((*c).into()));
    h
}

#[test]
fn scenes_have_any_size_and_repeat_to_the_bit() {
    for (name, _) in SCENES {
        for points in [1, 2, 3, 7, 10, 1000, 4321] {
            let cloud = scene(name, points, 5).unwrap();
            assert_eq!(cloud.len(), points, "{name}");
            check_promises(&cloud);
            assert_eq!(fingerprint(&cloud), fingerprint(&scene(name, points, 5).unwrap()), "{name}");
        }
    }
    assert_ne!(fingerprint(&scene("terrain", 1000, 1).unwrap()), fingerprint(&scene("terrain", 1000, 2).unwrap()));
    assert!(scene("sphere", 0, 0).is_err());
    assert!(scene("nothing", 9, 0).unwrap_err().to_string().contains("sphere, torus, terrain"));
}

#[test]
fn scenes_are_the_same_on_every_platform() {
    // Found on x86-64 Linux; only IEEE operations are used, so any other value elsewhere is a fault.
    let found: Vec<(&str, u64)> = SCENES.iter().map(|(n, _)| (*n, fingerprint(&scene(n, 1000, 7).unwrap()))).collect();
    assert_eq!(found, FINGERPRINTS);
}

const FINGERPRINTS: [(&str, u64); 8] = [
    ("demo", 8923388728226294137),
    ("sphere", 13367691196545257891),
    ("torus", 7500198190047428009),
    ("terrain", 8691562918923794919),
    ("room", 1970063216567116630),
    ("deep", 1156326362066186025),
    ("noise", 3089904523602208708),
    ("coincident", 17956942648783911925),
];

/// Mean distance to the nearest other point, and the largest, by brute force.
fn spacing(cloud: &PointCloud) -> (f32, f32) {
    let nearest = |i: usize| {
        let others = cloud.positions.iter().enumerate().filter(|(k, _)| *k != i);
        others.map(|(_, p)| p.distance(cloud.positions[i])).fold(f32::INFINITY, f32::min)
    };
    let all: Vec<f32> = (0..cloud.len()).map(nearest).collect();
    (all.iter().sum::<f32>() / all.len() as f32, all.iter().copied().fold(0.0, f32::max))
}

#[test]
fn sphere_and_torus_lie_on_their_surfaces_evenly() {
    let sphere = scene("sphere", 2000, 0).unwrap();
    assert!(sphere.closed);
    for (p, n) in sphere.positions.iter().zip(sphere.normals.as_ref().unwrap()) {
        assert!((p.as_dvec3().length() - 1.0).abs() < 2e-7 && p == n);
    }
    let torus = scene("torus", 2000, 0).unwrap();
    assert!(torus.closed);
    for (p, n) in torus.positions.iter().zip(torus.normals.as_ref().unwrap()) {
        let core = Vec3::new(p.x, p.y, 0.0).normalize();
        assert!((p - core).distance(0.4 * n) < 1e-6);
    }
    for cloud in [sphere, torus] {
        let radius = cloud.radii.as_ref().unwrap()[0];
        let (mean, worst) = spacing(&cloud);
        // Even: neighbours about a radius apart, none alone.
        assert!(mean > 0.7 * radius && worst < 1.3 * radius, "{mean} {worst} {radius}");
    }
}

#[test]
fn normals_of_height_fields_point_up_and_rooms_face_their_viewer() {
    for n in scene("terrain", 5000, 3).unwrap().normals.unwrap() {
        assert!(n.z > 0.2);
    }
    let room = scene("room", 5000, 3).unwrap();
    let eye = room.viewpoint.unwrap().as_vec3();
    let (mut walls, normals) = (0, room.normals.unwrap());
    for (p, n) in room.positions.iter().zip(&normals) {
        if p.z == 0.0 || p.z == 3.0 || p.x == 8.0 || p.y == 6.0 {
            walls += usize::from(n.dot(eye - p) > 0.0);
        }
    }
    // Floor, ceiling and two walls are 114 of 180 square units of room, and furniture is less again.
    assert!(walls > 2000, "{walls}");
    let ten = scene("coincident", 1000, 3).unwrap();
    let mut places: Vec<[u32; 3]> = ten.positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect();
    places.sort_unstable();
    places.dedup();
    assert_eq!(places.len(), 10);
}

#[test]
fn the_demo_fits_a_box_that_a_camera_can_frame() {
    let cloud = scene("demo", 20_000, 1).unwrap();
    let b = Bounds::of(&cloud).unwrap();
    assert_eq!(cloud.up, Some(Vec3::Z));
    assert!(b.min.x >= -6.0 && b.max.x <= 6.0 && b.min.z >= -0.5 && b.max.z < 6.0, "{b:?}");
    assert!(b.radius > 6.0 && b.radius < 10.0);
    assert!(cloud.normals.is_some() && cloud.radii.is_some() && cloud.colors.is_some());
}

#[test]
fn meshes_are_closed_and_face_outwards() {
    for (cloud, volume) in [(sphere_mesh(40, 80), 4.1888), (torus_mesh(90, 60), 3.1583), (sphere_mesh(0, 0), 0.0)] {
        check_promises(&cloud);
        let triangles = &cloud.mesh.as_ref().unwrap().triangles;
        let mut edges: Vec<[u32; 2]> =
            triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
        edges.sort_unstable();
        // Each directed edge once, and its opposite once: closed, and all triangles turn the same way.
        assert!(edges.windows(2).all(|w| w[0] != w[1]));
        assert!(edges.iter().all(|e| edges.binary_search(&[e[1], e[0]]).is_ok()));
        let at = |i: u32| cloud.world(i as usize);
        let sum: f64 = triangles.iter().map(|t| at(t[0]).dot(at(t[1]).cross(at(t[2]))) / 6.0).sum();
        // Chords lie inside: a little less than 4π/3 and 2π² · 0.16, and positive where it is outwards.
        assert!(sum > 0.98 * volume && (volume == 0.0 || sum < volume), "{sum} {volume}");
        assert!(sum > 0.0);
    }
}
