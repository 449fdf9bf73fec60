//! Layered point clouds in frames: what is streamed is drawn as the reference draws the samples of the same cut, in every view, by
//! every blend; and what is not there is stood in for.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{DMat4, DQuat, DVec3, Vec3, dvec3};
use surfel::load::{Pieces, PointCloud, synthetic};
use surfel::select::layered::Refine;
use surfel::select::{DepthConvention, Sight, View};
use surfel::standalone::{Offscreen, Shot};
use surfel::stream::{Access, FileAccess};
use surfel::structure::layered::{Layered, Options, Patience, Streaming, build, in_view};
use surfel::structure::{Cloud, Index};
use surfel::style::Style;
use surfel::technique::{Blend, Primitive, Technique};
use surfel::{FrameStats, Instance};

use crate::against_reference::{Case, FEW, SIZE, UNWEIGHTED, WEIGHTED, check};
use crate::folder::Folder;
use crate::vulkan;

/// Longer than any machine takes to read a file of a few hundred KiB: without it a fault here would have no end.
const PATIENCE: Duration = Duration::from_secs(60);

struct Model {
    _folder: Folder,
    index: Arc<Index>,
    access: Arc<dyn Access>,
}

impl Model {
    /// A torus in colours of its own, or another scene in such, in patches of 256.
    fn new(test: &str, scene: &str, points: usize) -> Model {
        let mut cloud = synthetic::scene(scene, points, 1).expect("a scene");
        let normals = cloud.normals.as_ref().expect("normals");
        cloud.colors = Some(normals.iter().map(|n| n.to_array().map(|v| (127.5 + 127.0 * v) as u8)).collect());
        cloud.closed = false;
        Model::of(test, cloud)
    }

    fn of(test: &str, cloud: PointCloud) -> Model {
        let folder = Folder::new(&format!("gpu-layered-{test}"));
        let path = PathBuf::from(folder.path("m.lpc"));
        let options = Options { samples: 256, ..Options::default() };
        let built = build(vec![Pieces::of(cloud)], &path, &options).expect("a model");
        let access = FileAccess::open(&path).expect("the model");
        Model { _folder: folder, index: Arc::new(built.index), access: Arc::new(access) }
    }

    fn streamed(&self, streaming: Streaming) -> Cloud {
        Layered::new(Arc::clone(&self.index), Arc::clone(&self.access), streaming).into()
    }

    /// The samples of a view's cut, as a flat cloud.
    fn in_view(&self, view: &View, transform: &DMat4, style: &Style, refine: &Refine) -> Cloud {
        let sight = Sight::new(view, SIZE, transform, self.index.origin, style);
        let of = in_view(&self.index, Arc::clone(&self.access), &sight, refine, Patience::default());
        Arc::new(of.expect("a picture").flat).into()
    }
}

/// Draws until nothing is missing.
fn complete(off: &mut Offscreen, shot: &Shot) -> FrameStats {
    let start = Instant::now();
    loop {
        let (stats, _) = off.draw(shot).expect("a frame");
        if stats.layered.iter().all(|l| l.cut.missing == 0) {
            return stats;
        }
        assert!(start.elapsed() < PATIENCE, "patches do not come: {:?}", stats.layered);
    }
}

fn look(eye: DVec3, target: DVec3, lens: DMat4) -> View {
    View::look_at(eye, target, DVec3::Y, lens, DepthConvention::Reversed)
}

fn views() -> Vec<(&'static str, View, f32)> {
    let aspect = SIZE[0] as f64 / SIZE[1] as f64;
    let lens = View::perspective(0.9, aspect, 0.01);
    let place = dvec3(0.8, 2.0, 1.9);
    let flipped = DMat4::from_scale(dvec3(1.0, -1.0, 1.0)) * lens;
    vec![
        ("far", look(2.0 * place, DVec3::ZERO, lens), 4.0),
        ("coarse", look(place, DVec3::ZERO, lens), 12.0),
        ("fine", look(place, DVec3::ZERO, lens), 2.0),
        ("near", look(dvec3(0.9, 0.5, 0.4), dvec3(0.7, 0.0, 0.2), lens), 3.0),
        ("within", look(dvec3(1.0, 0.0, 0.1), dvec3(0.6, 0.8, 0.0), lens), 3.0),
        ("orthographic", look(place, DVec3::ZERO, View::orthographic(2.6, aspect, 0.1, 9.0)), 4.0),
        ("flipped", look(place, DVec3::ZERO, flipped), 4.0),
    ]
}

#[test]
fn what_is_streamed_is_drawn_as_its_cut_by_every_blend() {
    let model = Model::new("blends", "torus", 20_000);
    vulkan::draw(SIZE, true, |off| {
        let (mut coarsest, mut finest) = (u64::MAX, 0);
        for (name, view, threshold) in views() {
            // From nothing, as the reference: patches that are there and out of sight still tell the radii of samples out of sight, of
            // which the account of what is outside would speak.
            let streaming = Streaming { occlusion: false, ..Streaming::STILL };
            let id = off.renderer.add(model.streamed(streaming)).expect("a model");
            for (blend, primitive) in [
                (Blend::TwoPass, Primitive::Point),
                (Blend::TwoPass, Primitive::Quad),
                (Blend::Fuzzy, Primitive::Point),
                (Blend::Opaque, Primitive::Point),
            ] {
                let style = Style { threshold, ..Style::default() };
                let technique = Technique { primitive, blend, ..Technique::TWO_PASS };
                let transform = DMat4::from_rotation_translation(DQuat::from_rotation_y(0.4), dvec3(0.1, 0.0, 0.0));
                let instance = Instance { cloud: id, transform };
                let shot = Shot { view: &view, instances: &[instance], technique, style: &style, count: true };
                let stats = complete(off, &shot);
                let flat = model.in_view(&view, &transform, &style, &Refine::default());
                assert_eq!(stats.points_submitted, flat.points() as u64, "{name}: the samples of the cut");
                (coarsest, finest) = (coarsest.min(stats.points_submitted), finest.max(stats.points_submitted));
                check(
                    off,
                    &Case {
                        name: format!("layered, {name}, {blend}, {primitive}"),
                        size: SIZE,
                        instances: &[(flat, instance)],
                        view: &view,
                        technique,
                        style: &style,
                        bound: if blend == Blend::Opaque { UNWEIGHTED } else { WEIGHTED },
                        ties: FEW,
                    },
                );
            }
            off.renderer.remove(id);
        }
        assert!(coarsest < 3000 && finest > 12_000, "{coarsest} to {finest} samples: views that differ");
    });
}

/// A wall, and behind it what nobody sees but from the side: a sphere of several patches, and a second wall.
fn behind_a_wall() -> PointCloud {
    let side = 70;
    let at = |i: usize| (i as f32 + 0.5) / side as f32 * 4.0 - 2.0;
    let mut cloud = synthetic::scene("sphere", 6000, 1).expect("a sphere");
    let spacing = 4.0 / side as f32;
    for z in [1.5, -1.5] {
        for (i, j) in (0..side * side).map(|n| (n / side, n % side)) {
            cloud.positions.push(Vec3::new(at(i), at(j), z));
            cloud.normals.iter_mut().for_each(|n| n.push(Vec3::Z));
            cloud.radii.iter_mut().for_each(|r| r.push(spacing));
        }
    }
    let position = |p: &Vec3| [p.x, p.y, p.z].map(|v| (127.5 + 60.0 * v) as u8);
    cloud.colors = Some(cloud.positions.iter().map(position).collect());
    cloud.closed = false;
    cloud
}

/// Pictures with and without occlusion tests are the same to the bit: what is left out contributes nothing.
#[test]
fn what_is_hidden_is_not_drawn_and_nothing_is_missed() {
    let model = Model::of("hidden", behind_a_wall());
    let aspect = SIZE[0] as f64 / SIZE[1] as f64;
    let lens = View::perspective(0.7, aspect, 0.01);
    let front = look(dvec3(0.1, 0.2, 4.5), dvec3(0.0, 0.0, 1.5), lens);
    let flat = View { projection: View::orthographic(3.4, aspect, 0.1, 9.0), ..front };
    let flipped = View { projection: DMat4::from_scale(dvec3(1.0, -1.0, 1.0)) * lens, ..front };
    // At most so much of what the cut has is drawn, in percent.
    let views = [
        ("front", front, 50),
        ("beside", look(dvec3(3.5, 0.6, 3.0), dvec3(1.0, 0.0, 0.0), lens), 97),
        ("grazing", look(dvec3(3.0, 1.0, 1.7), dvec3(0.0, 0.0, 1.2), lens), 100),
        ("orthographic", flat, 95),
        ("flipped", flipped, 80),
        ("between", look(dvec3(0.0, 0.0, 1.3), dvec3(0.0, 0.0, -1.5), lens), 50),
    ];
    // Hard discs just meet at the corners of a grid, and something is seen between them.
    let between_discs = [("front", front, 97)];
    let techniques = [
        (Blend::TwoPass, Primitive::Point, &views[..]),
        (Blend::TwoPass, Primitive::Quad, &views[5..]),
        (Blend::Opaque, Primitive::Point, &between_discs[..]),
        (Blend::Fuzzy, Primitive::Point, &views[..2]),
    ];
    vulkan::draw(SIZE, true, |off| {
        for (blend, primitive, views) in techniques {
            let technique = Technique { primitive, blend, ..Technique::TWO_PASS };
            for (name, view, most) in views {
                let style = Style { threshold: 1.0, ..Style::default() };
                let draw = |off: &mut Offscreen, occlusion, frames| {
                    let streaming = Streaming { occlusion, ..Streaming::STILL };
                    let id = off.renderer.add(model.streamed(streaming)).expect("a model");
                    let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
                    let shot = Shot { view, instances: &instances, technique, style: &style, count: true };
                    let mut stats = complete(off, &shot);
                    for _ in 0..frames {
                        stats = off.draw(&shot).expect("a frame").0;
                    }
                    let (cut, culled) = (&stats.layered[0].cut, stats.culled.expect("counted"));
                    assert_eq!(cut.visited, cut.drawn + cut.frustum + cut.cone + cut.missing + cut.occluded);
                    let drawn = stats.points_drawn.expect("counted");
                    assert_eq!(stats.points_submitted, drawn + culled.total(), "{name}: the account");
                    assert_eq!(stats.layered[0].hidden > 0, culled.occluded > 0);
                    off.renderer.remove(id);
                    (off.read().expect("a picture"), drawn, culled.occluded)
                };
                let (expected, all, none) = draw(off, false, 0);
                // What is new is tested at once, and what is visible after 2, 4 and 8 frames more.
                let (got, drawn, hidden) = draw(off, true, 14);
                let name = format!("occlusion, {name}, {blend}, {primitive}");
                println!("{name}: {drawn} of {all} samples, {hidden} found hidden in the last frame");
                assert!(none == 0 && (hidden > 0 || *most == 100), "{name}: {hidden}");
                assert!(100 * drawn <= most * all, "{name}: {drawn} of {all} samples are drawn");
                let differ = expected.rgba.iter().zip(&got.rgba).filter(|(a, b)| a != b).count();
                assert_eq!((differ, expected.depth == got.depth), (0, true), "{name}: pixels that differ");
            }
        }
    });
}
