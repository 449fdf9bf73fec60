//! Triangles near the viewer and points beyond: nothing lost, no hole, and near enough the mesh itself.

use std::sync::Arc;

use glam::{DMat4, DVec3, DVec4, Vec3};
use surfel::load::{Mesh, PointCloud, attributes};
use surfel::reference::{self, Instance, MeshInstance, MeshScene, Picture, Scene, Surface, ray_cast};
use surfel::select::{DrawList, Sight, View, cut};
use surfel::structure::nodes::ErrorRule;
use surfel::structure::sequential::Options;
use surfel::structure::{Cloud, Flat, Hybrid};
use surfel::style::{Style, Tolerance};
use surfel::technique::{Blend, Technique};

use crate::groups::random;
use crate::hybrid_common::torus;

const SIDE: u32 = 160;
/// As `measure` counts them.
const HOLE: f64 = 0.5;

fn hybrid(cloud: &PointCloud, options: &Options) -> Hybrid {
    Hybrid::build(&Flat::new(cloud), cloud.mesh.as_ref().unwrap(), options)
}

fn corners(cloud: &PointCloud, face: &[u32; 3]) -> [Vec3; 3] {
    face.map(|i| cloud.positions[i as usize])
}

fn longest([a, b, c]: [Vec3; 3]) -> f32 {
    a.distance(b).max(b.distance(c)).max(c.distance(a))
}

#[test]
fn faces_are_all_there_largest_first() {
    let cloud = torus(120, 60);
    let faces = &cloud.mesh.as_ref().unwrap().triangles;
    let triangles = hybrid(&cloud, &Options::default()).triangles;
    let (mut stored, mut given) = (triangles.corners.clone(), faces.clone());
    stored.sort_unstable();
    given.sort_unstable();
    assert_eq!(stored, given);
    assert!(triangles.blocks.len() > 2);
    let mut next = 0;
    for block in &triangles.blocks {
        assert_eq!(block.first, next);
        next += block.count;
        let range = block.first as usize..next as usize;
        assert!(triangles.sizes[range.clone()].is_sorted_by(|a, b| a >= b));
        for face in &triangles.corners[range] {
            let inside = corners(&cloud, face).iter().all(|p| p.cmpge(block.min).all() && p.cmple(block.max).all());
            assert!(inside, "{face:?}");
        }
    }
    assert_eq!(next as usize, faces.len());
    // By definition, corner by corner.
    for (face, size) in triangles.corners.iter().zip(&triangles.sizes).step_by(97) {
        let at = |corner: &u32| {
            let there = faces.iter().filter(|face| face.contains(corner));
            there.map(|face| longest(corners(&cloud, face))).fold(0.0, f32::max)
        };
        let expected = face.iter().map(at).fold(f32::INFINITY, f32::min);
        assert!((expected / size - 1.0).abs() < 1e-6 && longest(corners(&cloud, face)) <= size * (1.0 + 1e-6));
    }
}

#[test]
fn slivers_are_as_large_as_what_is_around_them() {
    // A square in two triangles, one cut again near a side.
    let positions = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.49]];
    let mut cloud = PointCloud {
        positions: positions.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec(),
        mesh: Some(Mesh { triangles: vec![[0, 1, 4], [1, 2, 4], [0, 4, 2], [0, 2, 3], [3, 3, 3]] }),
        ..PointCloud::default()
    };
    attributes::complete(&mut cloud, &attributes::Options::default());
    let hybrid = hybrid(&cloud, &Options::default());
    assert_eq!(hybrid.triangles.len(), 5, "a face at one place lies at a corner of large ones");
    let diagonal = 2f32.sqrt();
    let sizes = &hybrid.triangles.sizes;
    let expected = [diagonal, diagonal, diagonal, 1.0, 1.0];
    assert!(sizes.iter().zip(expected).all(|(s, e)| (s / e - 1.0).abs() < 1e-6), "{sizes:?}");
    // Of two corners that a node suffices for, that is all that is left; and no point is there near by.
    assert_eq!(hybrid.tree.flat.len(), 5, "a root, three corners, and what stands for the other two");
    let error = hybrid.tree.lists.iter().map(|l| l.error).fold(f32::INFINITY, f32::min);
    assert!(error > 0.5, "{error}");
}

/// From everywhere, τ from below anything to τ_max.
fn sights(tau_max: f64, count: usize) -> Vec<Sight> {
    let mut next = random(5);
    (0..count)
        .map(|k| {
            let mut vector = || DVec3::from([0; 3].map(|_: u8| 2.0 * next() as f64 - 1.0));
            let eye = vector() * [1.0, 1.5, 4.0, 30.0][k % 4];
            let tau = tau_max * (-7.0 * next() as f64).exp2();
            Sight { eye: eye.extend(1.0), tau, planes: [DVec4::W; 5], radius_scale: 1.0 }
        })
        .collect()
}

#[test]
fn every_vertex_that_no_triangle_stands_for_is_stood_for() {
    let cloud = torus(90, 40);
    let radii = cloud.radii.as_ref().unwrap();
    for rule in [ErrorRule::Geometric, ErrorRule::Split, ErrorRule::Diameter] {
        let options = Options { rule, blocks: 500, ..Options::default() };
        let hybrid = hybrid(&cloud, &options);
        let (tree, triangles) = (&hybrid.tree, &hybrid.triangles);
        let (mut needed, mut both) = (0, 0);
        for sight in sights(options.tau_max as f64, 60) {
            let (mut list, mut drawn) = (DrawList::default(), Vec::new());
            tree.select(&sight, Default::default(), false, 0, &mut list);
            for i in list.spans.iter().flat_map(|s| s.first..s.first + s.count) {
                if sight.test().selects(&tree.nodes, i as usize) {
                    drawn.push(i);
                }
            }
            triangles.select(&sight, 0, &mut list);
            let mut submitted = vec![false; triangles.len()];
            for span in &list.triangles {
                submitted[span.first as usize..][..span.count as usize].fill(true);
            }
            let eye = sight.eye.truncate();
            for (i, (face, submitted)) in triangles.corners.iter().zip(submitted).enumerate() {
                let corners = corners(&cloud, face);
                let size = triangles.sizes[i] as f64;
                let near = corners.iter().map(|p| (p.as_dvec3() - eye).length()).fold(f64::INFINITY, f64::min);
                assert!(submitted || size <= sight.tau * near * (1.0 + 1e-6), "{face:?} from {eye}");
                // What is covered by points: corners whose triangle ends no farther than a radius beyond them.
                for (corner, p) in face.iter().zip(corners) {
                    let (r, radius) = ((p.as_dvec3() - eye).length(), radii[*corner as usize] as f64);
                    if size > sight.tau * (r + radius) {
                        both += 1;
                        continue;
                    }
                    needed += 1;
                    let covers = |i: &u32| {
                        let [x, y, z, reach] = tree.flat.geometry[*i as usize];
                        Vec3::new(x, y, z).distance(p) <= reach * (1.0 + 1e-5)
                    };
                    assert!(drawn.iter().any(covers), "{rule}, corner {corner} from {eye}, τ {}", sight.tau);
                }
            }
        }
        assert!(needed > 10_000 && both > 10_000, "{rule}: {needed} and {both}");
    }
}

fn view(distance: f64) -> View {
    let eye = DVec3::new(0.45, -0.8, 0.6).normalize() * distance;
    View::look_at(eye, DVec3::ZERO, DVec3::Z, View::perspective(0.8, 1.0, 0.01), Default::default())
}

fn style(threshold: f32) -> Style {
    Style { threshold, ..Style::default() }
}

fn draw(cloud: &Cloud, view: &View, style: &Style, blend: Blend) -> (Picture, DrawList) {
    let list = cut::drawn(&[(cloud, DMat4::IDENTITY)], view, [SIDE; 2], style);
    let scene = Scene {
        instances: &[Instance::of(cloud, DMat4::IDENTITY)],
        list: &list,
        view,
        width: SIDE,
        height: SIDE,
        technique: Technique { blend, ..Technique::default() },
        style,
        host_depth: None,
    };
    (reference::render(&scene, 0.0), list)
}

fn truth(cloud: &PointCloud, view: &View, style: &Style) -> Picture {
    let surface = Surface::new(cloud).unwrap();
    let instances = [MeshInstance { surface: &surface, transform: DMat4::IDENTITY }];
    ray_cast(&MeshScene { instances: &instances, view, width: SIDE, height: SIDE, style }, 1)
}

#[test]
fn near_by_it_is_the_mesh() {
    let cloud = torus(40, 20);
    let hybrid: Cloud = Arc::new(hybrid(&cloud, &Options::default())).into();
    // Where ε is more, what lies within it behind a steep front is blended in.
    let style = Style { tolerance: Tolerance { absolute: 1e-9, relative: 0.0 }, ..style(1.0) };
    for blend in [Blend::TwoPass, Blend::Fuzzy, Blend::Opaque] {
        let (picture, list) = draw(&hybrid, &view(1.9), &style, blend);
        assert_eq!((list.submitted(), list.triangles.len()), (0, 1), "{blend}: every face is larger than a pixel");
        let truth = truth(&cloud, &view(1.9), &style);
        let mut seen = 0;
        for (i, (got, want)) in picture.rgba.iter().zip(&truth.rgba).enumerate() {
            let at = (i as u32 % SIDE, i as u32 / SIDE);
            assert_eq!(got[3], want[3], "{blend}, {at:?}");
            if want[3] > 0.0 {
                seen += 1;
                assert!((picture.depth[i] / truth.depth[i] - 1.0).abs() < 1e-9, "{blend}, {at:?}");
                // Normals have 2 × 16 bits here: 3·10⁻⁵, and their interpolation no more.
                let error = (0..3).map(|k| (got[k] - want[k]).abs()).fold(0.0, f64::max);
                assert!(error < 1e-4, "{blend}, {at:?}: {got:?}, {want:?}");
            }
        }
        assert!(seen > 8000, "{seen}");
    }
}

#[test]
fn the_border_has_no_hole() {
    let cloud = torus(160, 70);
    let hybrid: Cloud = Arc::new(hybrid(&cloud, &Options::default())).into();
    let mut mixed = 0;
    for distance in [1.7, 2.4, 3.5, 5.0, 8.0] {
        for threshold in [1.0, 2.0, 3.0, 4.0] {
            let (view, style) = (view(distance), style(threshold));
            let (picture, list) = draw(&hybrid, &view, &style, Blend::TwoPass);
            mixed += (list.submitted() > 100 && !list.triangles.is_empty()) as u32;
            let truth = truth(&cloud, &view, &style);
            for (i, (got, want)) in picture.rgba.iter().zip(&truth.rgba).enumerate() {
                let inner = |step: usize| {
                    truth.rgba.get(i.wrapping_sub(step)).is_some_and(|p| p[3] > 0.0)
                        && truth.rgba.get(i + step).is_some_and(|p| p[3] > 0.0)
                };
                if want[3] > 0.0 && inner(1) && inner(SIDE as usize) {
                    let at = (i as u32 % SIDE, i as u32 / SIDE);
                    assert!(got[3] >= HOLE, "distance {distance}, {threshold} px, {at:?}: {got:?}");
                }
            }
        }
    }
    assert!(mixed > 4, "{mixed}");
}
