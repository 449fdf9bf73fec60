//! Layered point clouds in frames: what is streamed is drawn as the reference draws the samples of the same cut, in every view, by
//! every blend; and what is not there is stood in for.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{DMat4, DQuat, DVec3, Vec3, dvec3};
use surfel::load::{Pieces, PointCloud, synthetic};
use surfel::select::layered::{Cut, Refine, refine};
use surfel::select::{DepthConvention, Sight, View};
use surfel::standalone::{Offscreen, Shot};
use surfel::stream::{Access, FetchOptions, FileAccess};
use surfel::structure::groups::Relax;
use surfel::structure::layered::{Layered, Options, Patience, Streaming, build, in_view};
use surfel::structure::{Cloud, Index};
use surfel::style::Style;
use surfel::technique::{Blend, Primitive, Technique};
use surfel::{FrameStats, Instance, Renderer};

use crate::against_reference::{Case, FEW, SIZE, UNWEIGHTED, WEIGHTED, check};
use crate::folder::Folder;
use crate::host_engine::Engine;
use crate::host_scene::{Lens, camera};
use crate::host_target::{Depth, Frame, Kind, PLAIN, Target};
use crate::vulkan;

/// Longer than any machine takes to read a file of a few hundred KiB: without it a fault here would have no end.
pub const PATIENCE: Duration = Duration::from_secs(60);

pub struct Model {
    folder: Folder,
    index: Arc<Index>,
    access: Arc<dyn Access>,
}

impl Model {
    /// A torus in colours of its own, or another scene in such, in patches of 256. Some samples are as large as if they lay alone.
    pub fn new(test: &str, scene: &str, points: usize) -> Model {
        let mut cloud = synthetic::scene(scene, points, 1).expect("a scene");
        let normals = cloud.normals.as_ref().expect("normals");
        cloud.colors = Some(normals.iter().map(|n| n.to_array().map(|v| (127.5 + 127.0 * v) as u8)).collect());
        cloud.closed = false;
        cloud.radii.as_mut().expect("radii").iter_mut().step_by(97).for_each(|r| *r *= 6.0);
        Model::of(test, cloud)
    }

    fn of(test: &str, cloud: PointCloud) -> Model {
        let folder = Folder::new(&format!("gpu-layered-{test}"));
        let path = PathBuf::from(folder.path("m.lpc"));
        let options = Options { samples: 256, groups: Some(Relax::default()), ..Options::default() };
        let built = build(vec![Pieces::of(cloud)], &path, &options).expect("a model");
        let access = FileAccess::open(&path).expect("the model");
        Model { folder, index: Arc::new(built.index), access: Arc::new(access) }
    }

    pub fn streamed(&self, streaming: Streaming) -> Cloud {
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
pub fn complete(off: &mut Offscreen, shot: &Shot) -> FrameStats {
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
                (Blend::Groups, Primitive::Point),
                (Blend::Groups, Primitive::Quad),
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

/// Pictures with and without occlusion tests are the same to the bit: what is left out contributes nothing, but to the coverage of
/// groups.
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
        (Blend::Groups, Primitive::Point, &views[..2]),
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
                // Where a group's splats overlap, weights may not suffice for coverage, and that something lies behind counts as such: then
                // the same colour, but for the rounding of a product, is less covered.
                let uncovered = |(a, b): &(&[f32; 4], &[f32; 4])| {
                    blend == Blend::Groups
                        && a[3] == 1.0
                        && b[3] < 1.0
                        && (0..3).all(|c| (b[c] - b[3] * a[c]).abs() < 1e-6)
                };
                let differ =
                    expected.rgba.iter().zip(&got.rgba).filter(|pair| pair.0 != pair.1 && !uncovered(pair)).count();
                assert_eq!((differ, expected.depth == got.depth), (0, true), "{name}: pixels that differ");
            }
        }
    });
}

#[test]
fn a_small_cache_makes_the_threshold_grow_for_all_views_alike() {
    let model = Model::new("small-cache", "torus", 12_000);
    let aspect = SIZE[0] as f64 / SIZE[1] as f64;
    let view = look(dvec3(0.8, 2.0, 1.9), DVec3::ZERO, View::perspective(0.9, aspect, 0.01));
    let style = Style { threshold: 2.0, ..Style::default() };
    // Slots of 256 samples with normals, colours and groups.
    let slot = 256 * 25;
    let streaming = Streaming { cache: 20 * slot, occlusion: false, ..Streaming::STILL };
    vulkan::draw(SIZE, true, |off| {
        let id = off.renderer.add(model.streamed(streaming)).expect("a model");
        let away = DMat4::from_translation(dvec3(0.0, 0.0, -3.0));
        let instances = [DMat4::IDENTITY, away].map(|transform| Instance { cloud: id, transform });
        let technique = Technique::TWO_PASS;
        let shot = Shot { view: &view, instances: &instances, technique, style: &style, count: true };
        let stats = complete(off, &shot);
        let layered = &stats.layered[0];
        assert_eq!(stats.layered.len(), 1, "both instances are of one model, and share its cache");
        assert!(layered.slots == 20 && layered.resident <= 20 && layered.factor > 1.5, "{layered:?}");
        // Both are drawn as their cuts at that factor are, one after the other.
        let refine = Refine { factor: layered.factor, ..Refine::default() };
        let clouds = instances.map(|i| (model.in_view(&view, &i.transform, &style, &refine), i));
        assert_eq!(stats.points_submitted, clouds.iter().map(|(c, _)| c.points() as u64).sum::<u64>());
        check(
            off,
            &Case {
                name: "layered, small cache".into(),
                size: SIZE,
                instances: &clouds,
                view: &view,
                technique,
                style: &style,
                bound: WEIGHTED,
                ties: FEW,
            },
        );
        // A limit of samples, from one frame to the next.
        let all = stats.points_submitted;
        off.renderer.limit(id, Some(all / 2));
        let limited = complete(off, &shot);
        assert!(limited.points_submitted <= all / 2 && limited.layered[0].factor > layered.factor);
        off.renderer.limit(id, None);
        assert_eq!(complete(off, &shot).points_submitted, all);
    });
}

#[test]
fn a_moving_camera_comes_to_rest_at_the_cut_of_its_view() {
    let model = Model::new("moving", "torus", 12_000);
    [false, true].into_iter().for_each(|occlusion| moves_and_rests(&model, occlusion));
}

fn moves_and_rests(model: &Model, occlusion: bool) {
    let aspect = SIZE[0] as f64 / SIZE[1] as f64;
    let lens = View::perspective(0.9, aspect, 0.01);
    let style = Style { threshold: 2.0, ..Style::default() };
    // Room for a third of the model: patches take each other's place while frames are in flight.
    let streaming = Streaming { cache: 30 * 256 * 25, occlusion, ..Streaming::default() };
    vulkan::draw(SIZE, true, |off| {
        let id = off.renderer.add(model.streamed(streaming)).expect("a model");
        let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
        let (mut evicted, mut missing) = (0, 0);
        for frame in 0..60 {
            let angle = 0.25 * frame as f64;
            let distance = 1.7 + (0.3 * frame as f64).sin();
            let view = look(distance * dvec3(angle.sin(), 0.7, angle.cos()), DVec3::ZERO, lens);
            let blend = [Blend::TwoPass, Blend::Fuzzy, Blend::Opaque, Blend::Groups][frame % 4];
            let technique = Technique { blend, ..Technique::TWO_PASS };
            let shot = Shot { view: &view, instances: &instances, technique, style: &style, count: true };
            let (stats, _) = off.draw(&shot).expect("a frame");
            let layered = &stats.layered[0];
            let cut = &layered.cut;
            assert_eq!(cut.visited, cut.drawn + cut.frustum + cut.cone + cut.missing + cut.occluded, "frame {frame}");
            let drawn = stats.points_drawn.expect("counted") + stats.culled.expect("counted").total();
            assert_eq!(stats.points_submitted, drawn, "frame {frame}: the account");
            assert!(layered.resident <= layered.slots);
            (evicted, missing) = (layered.evicted, missing + cut.missing);
        }
        assert!(evicted > 0 && missing > 0, "{evicted} evicted, {missing} missing: the camera moved fast enough");
        // At rest: all that the view wants comes in, over as many frames as arrivals fade.
        let view = look(dvec3(0.8, 1.2, 1.1), DVec3::ZERO, lens);
        let shot =
            Shot { view: &view, instances: &instances, technique: Technique::TWO_PASS, style: &style, count: true };
        complete(off, &shot);
        let mut last = complete(off, &shot);
        for _ in 0..30 {
            last = complete(off, &shot);
        }
        let (cut, factor) = (last.layered[0].cut, last.layered[0].factor);
        let options = Refine { factor, fade: streaming.fade, prefetch: streaming.prefetch, ..Refine::default() };
        let sight = Sight::new(&view, SIZE, &DMat4::IDENTITY, model.index.origin, &style);
        let mut expected = Cut::default();
        refine(&model.index, &sight, &options, |_| 1.0, &mut expected);
        let all: u64 = expected.drawn().map(|s| u64::from(model.index.nodes[s.node as usize].samples)).sum();
        // What lies below something hidden is not refined.
        if !occlusion {
            assert_eq!((cut, last.points_submitted), (expected.counts, all));
            let faded = last.culled.expect("counted").interval;
            assert!(faded > 0 && faded == all - expected.counts.samples, "{faded} samples of {all} are faded out");
        }
    });
}

#[test]
fn a_broken_patch_is_said_and_stood_in_for() {
    let model = Model::new("broken", "torus", 12_000);
    let path = PathBuf::from(model.folder.path("m.lpc"));
    let mut bytes = std::fs::read(&path).expect("the model");
    // A node that the view below wants, with children.
    let node = model.index.nodes.iter().position(|n| n.level == 3 && n.split < 3).expect("a node");
    let of = &model.index.nodes[node];
    bytes[of.at as usize + 40] ^= 1;
    std::fs::write(&path, bytes).expect("altered");
    let access = FileAccess::open(&path).expect("the model");
    let fetch = FetchOptions { decodings: 2, ..FetchOptions::DEFAULT };
    let streaming = Streaming { fetch, ..Streaming::STILL };
    let cloud: Cloud = Layered::new(Arc::clone(&model.index), Arc::new(access), streaming).into();
    let aspect = SIZE[0] as f64 / SIZE[1] as f64;
    let view = look(dvec3(0.8, 2.0, 1.9), DVec3::ZERO, View::perspective(0.9, aspect, 0.01));
    let style = Style { threshold: 1.0, ..Style::default() };
    vulkan::draw(SIZE, true, |off| {
        let id = off.renderer.add(cloud).expect("a model");
        let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
        let technique = Technique::TWO_PASS;
        let shot = Shot { view: &view, instances: &instances, technique, style: &style, count: false };
        let start = Instant::now();
        let stats = loop {
            let (stats, _) = off.draw(&shot).expect("a frame");
            let layered = &stats.layered[0];
            // Nothing more is asked for, and only the broken one is lacking.
            if layered.fault.is_some() && layered.wished == 0 && layered.cut.missing == 1 {
                break stats;
            }
            assert!(start.elapsed() < PATIENCE, "{layered:?}");
        };
        let layered = &stats.layered[0];
        let why = layered.fault.as_deref().unwrap_or_default();
        assert!(why.contains("m.lpc") && why.contains("checksum"), "{why}");
        assert_eq!((layered.fetched.given_up, layered.fetched.corrupt), (1, 2));
        let covered = off.read().expect("a picture").rgba.iter().filter(|p| p[3] > 0.5).count();
        assert!(covered > 3000, "{covered} pixels: its parent's samples stand for it");
    });
}

/// Two views of a multiview target, with geometry of the engine's own: each has tests of its own.
#[test]
fn what_is_hidden_in_one_view_is_seen_in_the_other() {
    let model = Model::of("stereo", behind_a_wall());
    Engine::with(|engine| {
        let kind = Kind { depth: Depth::Lent, geometry: true, views: 2, ..PLAIN };
        let views = [0, 1].map(|side| camera(side, Lens::Straight, DepthConvention::Reversed, 4.0 / 3.0));
        let target = Target::new(engine, kind);
        // SAFETY: the handles belong together and outlive the renderer.
        let mut renderer = unsafe { Renderer::new(engine.host(), target.formats()) }.expect("a renderer");
        let cmd = engine.command_buffer();
        let style = Style { threshold: 0.5, ..Style::default() };
        for blend in [Blend::TwoPass, Blend::Fuzzy, Blend::Groups] {
            let technique = Technique { blend, ..Technique::TWO_PASS };
            let mut pictures = Vec::new();
            for occlusion in [false, true] {
                let cloud = renderer.add(model.streamed(Streaming { occlusion, ..Streaming::STILL })).expect("a model");
                let instances = [Instance { cloud, transform: DMat4::IDENTITY }];
                let (start, mut settled) = (Instant::now(), 0);
                // As in the test above: tests after 0, 2, 4 and 8 frames.
                let frames = if occlusion { 15 } else { 1 };
                while settled < frames {
                    let id = engine.completed() + 1;
                    engine.begin(cmd);
                    let frame = Frame { id, views: &views, instances: &instances, technique, style: &style };
                    target.record(engine, cmd, &mut renderer, &frame);
                    engine.submit(cmd, id);
                    engine.wait(id);
                    let stats = renderer.retire(id).expect("statistics").pop().expect("of this frame");
                    let drawn = stats.points_drawn.expect("counted") + stats.culled.expect("counted").total();
                    assert_eq!(stats.points_submitted, drawn, "{blend}: the account");
                    settled += (stats.layered[0].cut.missing == 0) as u32;
                    assert!(settled < 15 || stats.layered[0].hidden > 0, "{blend}: {:?}", stats.layered);
                    assert!(start.elapsed() < PATIENCE, "patches do not come: {:?}", stats.layered);
                }
                pictures.push([0, 1].map(|view| target.picture(view)));
                renderer.remove(cloud);
            }
            assert!(pictures[0] == pictures[1], "{blend}: pictures differ");
            assert!(pictures[0][0] != pictures[0][1], "two views");
        }
        // SAFETY: all frames are complete.
        unsafe { renderer.destroy() };
        target.destroy(engine);
    });
}
