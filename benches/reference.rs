//! Throughput of the f64 renderers on all of rayon's threads (`RAYON_NUM_THREADS`).
//!
//! `splats`: whole pictures of 1 M splats at 640 × 640, none dropped, whose footprints are 4 px across: facing the viewer
//! (every one a full disk) and lying on a sphere. `rays`: the ray cast of a sphere's mesh of 1 M faces, 16 rays a pixel,
//! half of which hit; the tree is built before.
//!
//! `cargo bench --bench reference --no-default-features --features reference,preprocess`; `-- --test` runs each once, small.

use criterion::{BenchmarkId, Criterion, Throughput};
use glam::{DMat4, DVec3, dvec3};
use surfel::load::synthetic;
use surfel::reference::{Instance, MeshInstance, MeshScene, Picture, SAMPLES, Scene, Surface, ray_cast, render};
use surfel::select::{DepthConvention, DrawList, View};
use surfel::structure::{Flat, Groups};
use surfel::style::{BackFaces, Style};
use surfel::technique::Technique;

/// Eye to the unit sphere's centre; the sphere then fills 85 % of the picture's height.
const DISTANCE: f64 = 3.0;

fn view() -> View {
    // The silhouette's half angle is asin(1 / 3), tan = 1 / √8.
    let fov = 2.0 * (1.0 / 8f64.sqrt() / 0.85).atan();
    let eye = DISTANCE * dvec3(0.6, -0.7, 0.4).normalize();
    View::look_at(eye, DVec3::ZERO, DVec3::Z, View::perspective(fov, 1.0, 0.01), DepthConvention::Reversed)
}

/// The picture is the sphere: solid within 90 % of its outline, nothing outside it, the near half's depths.
fn check(picture: &Picture) {
    let (side, half) = (picture.width as f64, 0.5 * picture.width as f64);
    for (i, pixel) in picture.rgba.iter().enumerate() {
        let (x, y) = (i as f64 % side + 0.5 - half, (i as f64 / side).floor() + 0.5 - half);
        let outward = x.hypot(y) / (0.85 * half);
        assert!(pixel[3] == 1.0 || outward > 0.9, "a hole at {outward}: {pixel:?}");
        assert!(pixel[3] == 0.0 || outward < 1.0 + 6.0 / half, "spill at {outward}: {pixel:?}");
        let depth = picture.depth[i];
        assert!(outward > 0.9 || (DISTANCE - 1.1..DISTANCE).contains(&depth), "depth {depth} at {outward}");
    }
}

fn splats(c: &mut Criterion, points: usize, side: u32) {
    let mut group = c.benchmark_group("splats");
    group.sample_size(10).throughput(Throughput::Elements(points as u64));
    let mut sphere = Flat::new(&synthetic::scene("sphere", points, 1).expect("a scene of this name"));
    // As many as a surface takes; that they overlap costs a square root.
    let mut groups = Groups::default();
    (groups.of, groups.count, groups.overlapping) = ((0..points).map(|i| (i % 12) as u8).collect(), 12, true);
    sphere.groups = Some(groups);
    let facing = Flat { normals: None, ..sphere.clone() };
    let view = view();
    // Radius of 2 px at the centre's distance.
    let radius = 2.0 * DISTANCE / view.focal(side as f64);
    let style = Style {
        radius_scale: (radius / sphere.geometry[0][3] as f64) as f32,
        back_faces: BackFaces::Draw,
        ..Style::default()
    };
    for (name, flat, preset) in [
        ("two-pass, facing", &facing, "flat.two-pass.point"),
        ("two-pass, on a sphere", &sphere, "flat.two-pass.point"),
        ("opaque, on a sphere", &sphere, "flat.opaque.point"),
        ("fuzzy, on a sphere", &sphere, "flat.fuzzy.point"),
        ("groups, on a sphere", &sphere, "flat.groups.point"),
    ] {
        let list = DrawList::all([points as u32]);
        let instances = [Instance::points(flat, DMat4::IDENTITY)];
        let scene = Scene {
            instances: &instances,
            list: &list,
            view: &view,
            width: side,
            height: side,
            technique: Technique::named(preset).expect("a preset"),
            style: &style,
            host_depth: None,
        };
        let picture = render(&scene, 0.0);
        assert_eq!(picture.counts.drawn, points as u64);
        check(&picture);
        group.bench_function(BenchmarkId::new(name, side), |b| b.iter(|| render(&scene, 0.0)));
    }
    group.finish();
}

fn rays(c: &mut Criterion, rings: u32, side: u32) {
    let mut group = c.benchmark_group("rays");
    let rays = u64::from(side * SAMPLES).pow(2);
    group.sample_size(10).throughput(Throughput::Elements(rays));
    let surface = Surface::new(&synthetic::sphere_mesh(rings, 2 * rings)).expect("a mesh has faces");
    let (view, style) = (view(), Style::default());
    let instances = [MeshInstance { surface: &surface, transform: DMat4::IDENTITY }];
    let scene = MeshScene { instances: &instances, view: &view, width: side, height: side, style: &style };
    check(&ray_cast(&scene, SAMPLES));
    group.bench_function(BenchmarkId::new("sphere mesh", side), |b| b.iter(|| ray_cast(&scene, SAMPLES)));
    group.finish();
}

fn main() {
    let small = std::env::args().any(|a| a == "--test");
    let mut criterion = Criterion::default().configure_from_args();
    let (points, side) = if small { (60_000, 160) } else { (1_000_000, 640) };
    splats(&mut criterion, points, side);
    rays(&mut criterion, if small { 20 } else { 500 }, side);
    criterion.final_summary();
}
