//! The ray cast of meshes against shapes whose pictures are known.

use glam::{DMat4, DVec2, DVec3, Vec3, dvec2, dvec3, vec3};
use surfel::load::synthetic::sphere_mesh;
use surfel::load::{Mesh, PointCloud};
use surfel::reference::{Counts, MeshInstance, MeshScene, Picture, SAMPLES, Surface, ray_cast};
use surfel::select::View;
use surfel::style::{BackFaces, EyeDome, Shading, Style};

use crate::reference_common::{at, depth_at};

const SIDE: u32 = 64;

fn perspective(eye: DVec3, target: DVec3) -> View {
    View::look_at(eye, target, DVec3::Y, View::perspective(1.0, 1.0, 0.5), Default::default())
}

fn orthographic(eye: DVec3, target: DVec3) -> View {
    View::look_at(eye, target, DVec3::Y, View::orthographic(4.0, 1.0, 0.5, 100.0), Default::default())
}

fn unlit() -> Style {
    Style { shading: Shading::None, ..Style::default() }
}

fn cast(surfaces: &[(&Surface, DMat4)], view: &View, style: &Style, samples: u32) -> Picture {
    let instances: Vec<_> = surfaces.iter().map(|&(surface, transform)| MeshInstance { surface, transform }).collect();
    ray_cast(&MeshScene { instances: &instances, view, width: SIDE, height: SIDE, style }, samples)
}

fn one(cloud: &PointCloud, view: &View, style: &Style, samples: u32) -> Picture {
    cast(&[(&Surface::new(cloud).unwrap(), DMat4::IDENTITY)], view, style, samples)
}

/// A parallelogram from `corner` along `u` and `v`, counter-clockwise seen from u × v. Its linear red is the share of u,
/// its green that of v.
fn plate(corner: Vec3, u: Vec3, v: Vec3) -> PointCloud {
    PointCloud {
        positions: vec![corner, corner + u, corner + u + v, corner + v],
        colors: Some(vec![[0, 0, 0], [255, 0, 0], [255, 255, 0], [0, 255, 0]]),
        mesh: Some(Mesh { triangles: vec![[0, 1, 2], [0, 2, 3]] }),
        ..Default::default()
    }
}

/// Origin and direction of the ray through a pixel's centre, from the matrices alone.
fn ray(view: &View, x: u32, y: u32) -> (DVec3, DVec3) {
    let back = (view.projection * view.view).inverse();
    let ndc = dvec2(x as f64 + 0.5, y as f64 + 0.5) / SIDE as f64 * 2.0 - 1.0;
    let (a, b) = (back.project_point3(ndc.extend(0.6)), back.project_point3(ndc.extend(0.3)));
    (a, (b - a).normalize())
}

/// Where the plate's plane is met: shares of u and v, and linear depth.
fn expected(plate: &PointCloud, view: &View, x: u32, y: u32) -> (DVec2, f64, f64) {
    let [p, pu, _, pv] = [0, 1, 2, 3].map(|i| plate.world(i));
    let (origin, direction) = ray(view, x, y);
    let (u, v) = (pu - p, pv - p);
    let n = u.cross(v);
    let hit = origin + direction * (n.dot(p - origin) / n.dot(direction));
    let inverse = glam::DMat3::from_cols(u, v, n).inverse() * (hit - p);
    (inverse.truncate(), -view.view.transform_point3(hit).z, (n.dot(direction) / n.length()).abs())
}

#[test]
fn a_slanted_plate_has_known_depths_colours_and_light() {
    let plate = plate(vec3(-1.5, -1.0, -0.5), vec3(2.5, 0.25, 1.0), vec3(0.25, 2.0, -0.75));
    let eyes = [dvec3(0.5, 1.0, 4.0), dvec3(-1.0, 0.3, -5.0)];
    let lit = Style { shading: Shading::Headlight { ambient: 0.25 }, ..Style::default() };
    let mut covered = 0;
    for view in eyes.iter().flat_map(|&eye| [perspective(eye, DVec3::ZERO), orthographic(eye, DVec3::ZERO)]) {
        let (plain, shaded) = (one(&plate, &view, &unlit(), 1), one(&plate, &view, &lit, 1));
        for (y, x) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x))) {
            let (share, depth, cosine) = expected(&plate, &view, x, y);
            let inside = share.min_element() > 0.0 && share.max_element() < 1.0;
            let found = at(&plain, x, y);
            if !inside {
                assert_eq!((found, depth_at(&plain, x, y)), ([0.0; 4], f64::INFINITY), "{x}, {y}");
                continue;
            }
            covered += 1;
            // A few dozen roundings of values up to 5 on either side, the inverse matrices' among them.
            let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
            assert!(
                near(found[0], share.x) && near(found[1], share.y) && found[2..] == [0.0, 1.0],
                "{x}, {y}: {found:?}"
            );
            assert!(near(depth_at(&plain, x, y), depth), "{x}, {y}");
            let light = 0.25 + 0.75 * cosine;
            assert!(near(at(&shaded, x, y)[0], share.x * light), "{x}, {y}");
        }
    }
    assert!(covered > 2000, "{covered}");
}

/// Positions are the normals, so at every place of a face the interpolated normal points as the place does.
#[test]
fn normals_are_interpolated_and_turned_to_the_viewer() {
    let mut sphere = sphere_mesh(12, 16);
    let view = perspective(dvec3(1.0, 2.0, 4.0), DVec3::ZERO);
    let style = Style { shading: Shading::Headlight { ambient: 0.0 }, base_color: [255; 3], ..Style::default() };
    let outward = one(&sphere, &view, &style, 1);
    let mut covered = 0;
    for (y, x) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x))) {
        let depth = depth_at(&outward, x, y);
        if depth.is_infinite() {
            continue;
        }
        let (origin, direction) = ray(&view, x, y);
        let z = |p: DVec3| -view.view.transform_point3(p).z;
        let hit = origin + direction * ((depth - z(origin)) / (z(origin + direction) - z(origin)));
        // Also where faces are seen but the normal between them already looks away: turned, it is lit.
        let light = hit.normalize().dot(direction).abs();
        // Positions and normals are the same f32.
        assert!((at(&outward, x, y)[0] - light).abs() < 1e-12, "{x}, {y}");
        covered += 1;
    }
    assert!(covered > 500);
    let inward = sphere.normals.take().unwrap().into_iter().map(|n| -n).collect();
    sphere.normals = Some(inward);
    assert!(one(&sphere, &view, &style, 1).rgba == outward.rgba, "the normals' side does not matter");
}

/// The image of a unit sphere about the view's axis at distance d is a disk of radius f tan(asin(1/d)).
#[test]
fn a_sphere_covers_its_disk() {
    let sphere = sphere_mesh(400, 800);
    let samples = 16;
    let (d, focal) = (3.0, 0.5 * SIDE as f64 / 0.5f64.tan());
    let view = perspective(d * dvec3(0.48, 0.6, 0.64), DVec3::ZERO);
    let picture = one(&sphere, &view, &Style::default(), samples);
    let (mut area, mut moment) = (0.0, DVec2::ZERO);
    for (i, pixel) in picture.rgba.iter().enumerate() {
        let centre = dvec2(i as f64 % SIDE as f64 + 0.5, (i as f64 / SIDE as f64).floor() + 0.5);
        area += pixel[3];
        moment += pixel[3] * (centre - 0.5 * SIDE as f64);
    }
    let radius = focal / (d * d - 1.0f64).sqrt();
    let disk = std::f64::consts::PI * radius * radius;
    // A sample stands for a cell of 1/16 px that holds it. The outline crosses at most 8 r · 16 of them (4 r rows and as many
    // columns, each crossed twice), and what these are wrong by is at most their area. The faces lie within
    // 1 − cos(π/400) = 3·10⁻⁵ of the sphere: 2 π r² · 3·10⁻⁵ less, at most.
    let off = 8.0 * radius / samples as f64 + 2e-4 * radius * radius;
    assert!((area - disk).abs() < off && off < 0.01 * disk, "{area} {disk} {off}");
    // The same cells, each at r from the centre, and the pixels' own extent: not half a pixel.
    let shift = moment / area;
    assert!(shift.length() < off * radius / disk && off * radius / disk < 0.2, "{shift}");
    // Nothing shines through: every pixel wholly within is solid, and has a depth of the near half.
    for (y, x) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x))) {
        let away = dvec2(x as f64 + 0.5, y as f64 + 0.5).distance(DVec2::splat(0.5 * SIDE as f64));
        if away + 1.0 < radius {
            assert_eq!(at(&picture, x, y)[3], 1.0, "{x}, {y}");
            assert!((d - 1.0 - 1e-9..d).contains(&depth_at(&picture, x, y)), "{x}, {y}");
        } else if away - 1.0 > radius {
            assert_eq!(at(&picture, x, y)[3], 0.0, "{x}, {y}");
        }
    }
}

#[test]
fn far_from_the_origin_the_picture_is_the_same() {
    let mut sphere = sphere_mesh(30, 40);
    sphere.colors = Some((0..sphere.len()).map(|i| [(i % 256) as u8, (i / 7 % 256) as u8, 90]).collect());
    let eye = dvec3(1.0, 2.0, 3.5);
    let here = one(&sphere, &perspective(eye, DVec3::ZERO), &Style::default(), SAMPLES);
    let far = dvec3(5e6, -4.2e6, 310.0);
    sphere.origin = far;
    let moved = one(&sphere, &perspective(far + eye, far), &Style::default(), SAMPLES);
    // And by a transform instead: turned, at half the size, from half the distance.
    sphere.origin = DVec3::ZERO;
    let turn = glam::DQuat::from_rotation_y(0.7);
    let transform = DMat4::from_scale_rotation_translation(DVec3::splat(0.5), turn, far);
    let view = View::look_at(
        far + turn * (0.5 * eye),
        far,
        turn * DVec3::Y,
        View::perspective(1.0, 1.0, 0.25),
        Default::default(),
    );
    let turned = cast(&[(&Surface::new(&sphere).unwrap(), transform)], &view, &Style::default(), SAMPLES);
    for i in 0..here.rgba.len() {
        // Eye and origin are off by a few roundings at 5·10⁶: 5 · 2⁻³¹ = 2·10⁻⁹. Colours change by up to 1 over an edge
        // of 0.15: 50 times that; edges and light no faster.
        for (other, scale) in [(&moved, 1.0), (&turned, 2.0)] {
            let off = (0..4).map(|c| (here.rgba[i][c] - other.rgba[i][c]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6, "pixel {i}: {:?} {:?}", here.rgba[i], other.rgba[i]);
            let depth = scale * other.depth[i];
            assert!(here.depth[i] == depth || (here.depth[i] - depth).abs() < 1e-6, "pixel {i}: {depth}");
        }
    }
}

#[test]
fn the_nearest_is_seen_and_edges_are_shares() {
    // Orthographic, 16 px a unit: the near plate ends a quarter into pixel 36.
    let view = orthographic(dvec3(0.0, 0.0, 10.0), DVec3::ZERO);
    let far = Surface::new(&plate(vec3(-1.0, -1.0, 0.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0))).unwrap();
    let mut white = plate(vec3(-1.0, -1.0, 1.0), vec3(1.265625, 0.0, 0.0), vec3(0.0, 2.0, 0.0));
    white.colors = None;
    let near = Surface::new(&white).unwrap();
    let style = Style { base_color: [255; 3], ..unlit() };
    for order in
        [[(&far, DMat4::IDENTITY), (&near, DMat4::IDENTITY)], [(&near, DMat4::IDENTITY), (&far, DMat4::IDENTITY)]]
    {
        let picture = cast(&order, &view, &style, SAMPLES);
        assert_eq!((at(&picture, 35, 32), depth_at(&picture, 35, 32)), ([1.0; 4], 9.0));
        // Red rises by 1/32 a pixel from pixel 16; the samples' mean x of the far plate's three quarters is 5/8.
        let red = 0.25 + 0.75 * (20.625 / 32.0);
        let mixed = at(&picture, 36, 32);
        assert!((mixed[0] - red).abs() < 1e-12 && (mixed[2] - 0.25).abs() < 1e-15 && mixed[3] == 1.0, "{mixed:?}");
        assert_eq!((depth_at(&picture, 36, 32), depth_at(&picture, 40, 32)), (10.0, 10.0));
        assert_eq!((at(&picture, 50, 32), depth_at(&picture, 50, 32)), ([0.0; 4], f64::INFINITY));
        assert_eq!(picture.counts, Counts::default());
        assert!(picture.ties.iter().all(|t| !t));
    }
}

#[test]
fn back_faces_go_only_where_they_are_culled() {
    let front = orthographic(dvec3(0.0, 0.0, 10.0), DVec3::ZERO);
    let behind = orthographic(dvec3(0.0, 0.0, -10.0), DVec3::ZERO);
    let mut plate = plate(vec3(-1.0, -1.0, 0.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0));
    let seen = |plate: &PointCloud, view: &View, back_faces: BackFaces| {
        at(&one(plate, view, &Style { back_faces, ..unlit() }, 2), 32, 32)[3] == 1.0
    };
    for (view, culled) in [(&front, true), (&behind, false)] {
        assert!(seen(&plate, view, BackFaces::Draw) && seen(&plate, view, BackFaces::Auto));
        assert_eq!(seen(&plate, view, BackFaces::Cull), culled);
    }
    // The outer side is the normals', whatever the faces' order says.
    plate.normals = Some(vec![Vec3::NEG_Z; 4]);
    assert!(!seen(&plate, &front, BackFaces::Cull) && seen(&plate, &behind, BackFaces::Cull));
    plate.normals = Some(vec![Vec3::ZERO; 4]);
    assert!(seen(&plate, &front, BackFaces::Cull) && seen(&plate, &behind, BackFaces::Cull));
    // What is dropped hides nothing.
    let sphere = sphere_mesh(20, 30);
    let inside = perspective(DVec3::ZERO, DVec3::Z);
    assert!(seen(&sphere, &inside, BackFaces::Auto) && !seen(&sphere, &inside, BackFaces::Cull));
}

/// The near plane cuts, and what is behind the viewer is not seen.
#[test]
fn nothing_before_the_near_plane() {
    let floor = plate(vec3(-9.0, -1.0, 9.0), vec3(18.0, 0.0, 0.0), vec3(0.0, 0.0, -18.0));
    for view in [perspective(DVec3::ZERO, DVec3::NEG_Z), orthographic(DVec3::ZERO, dvec3(0.0, -1.0, -1.0))] {
        let picture = one(&floor, &view, &unlit(), 1);
        let (mut seen, mut nearer) = (0, 0);
        for (y, x) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x))) {
            let (share, depth, _) = expected(&floor, &view, x, y);
            let on_it = share.min_element() > 0.0 && share.max_element() < 1.0;
            assert_eq!(at(&picture, x, y)[3] == 1.0, on_it && depth >= 0.5, "{x}, {y}: depth {depth}");
            seen += (on_it && depth >= 0.5) as u32;
            nearer += (on_it && depth < 0.5) as u32;
        }
        assert!(seen > 200 && (nearer > 200 || view.is_perspective()), "{seen} seen, {nearer} cut");
    }
}

/// Edge-on by the last bit and exactly: no coverage, no depth, nothing that is not a number.
#[test]
fn edge_on_plates_cover_nothing() {
    let plate = plate(vec3(-1.0, 0.0, -1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 0.0, 2.0));
    for height in [0.0, 1e-16, 1e-12] {
        for view in
            [perspective(dvec3(0.0, height, 5.0), DVec3::ZERO), orthographic(dvec3(0.0, height, 5.0), DVec3::ZERO)]
        {
            let picture = one(&plate, &view, &Style::default(), 5);
            for (pixel, &depth) in picture.rgba.iter().zip(&picture.depth) {
                assert!(pixel.iter().all(|v| v.is_finite()) && (pixel[3] > 0.0) == depth.is_finite(), "{pixel:?}");
            }
        }
    }
}

#[test]
fn threads_change_nothing_and_the_eye_dome_is_last() {
    let sphere = sphere_mesh(40, 60);
    let view = perspective(dvec3(1.0, 2.0, 4.0), DVec3::ZERO);
    let style = Style { eye_dome: Some(EyeDome { strength: 0.5, radius: 2.0 }), ..Style::default() };
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let [one, five] = [1, 5].map(|threads| pool(threads).install(|| self::one(&sphere, &view, &style, 3)));
    assert!(one == five);
    let plain = self::one(&sphere, &view, &Style::default(), 3);
    assert!(plain.depth == one.depth);
    let darker = plain.rgba.iter().zip(&one.rgba).filter(|(p, o)| o[0] < p[0] && o[3] == p[3]).count();
    assert!(darker > 500, "{darker}");
}
