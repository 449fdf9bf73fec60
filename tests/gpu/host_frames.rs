//! Frames in flight: nothing waits but for the reuse of a slot. Clouds come and go and the picture changes its size while
//! earlier frames run, and every picture must be the one that the same frame gives when each is waited for.

use std::sync::{Arc, Mutex};

use glam::{DMat4, dvec3};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use surfel::ash::vk;
use surfel::select::DepthConvention;
use surfel::style::Style;
use surfel::technique::Technique;
use surfel::{CloudId, FrameInput, Instance, Renderer, SharedAllocator};

use crate::host_engine::Engine;
use crate::host_scene::{Lens, camera, sphere};
use crate::host_target::{Depth, Frame, Kind, PLAIN, Target};

const FRAMES: u64 = 12;

/// What frame `i` is like: the picture changes its size at 5 and 9, once larger, once smaller.
fn kind(i: u64) -> Kind {
    let size = match i {
        0..5 => [48, 40],
        5..9 => [64, 48],
        _ => [40, 32],
    };
    Kind { size, extent: size, depth: Depth::Lent, geometry: true, ..PLAIN }
}

/// Runs the frames, `in_flight` at a time. Returns each frame's picture.
fn run(engine: &Engine, mut renderer: Renderer, in_flight: u64) -> Vec<Vec<[f32; 4]>> {
    let mut clouds: Vec<CloudId> = vec![renderer.add(sphere(800)).expect("a cloud")];
    // Slots of the ring: a command buffer, and the target of the frame that is there.
    let cmds: Vec<_> = (0..in_flight).map(|_| engine.command_buffer()).collect();
    let mut running: Vec<Option<(u64, Target)>> = (0..in_flight).map(|_| None).collect();
    let mut pictures = vec![Vec::new(); FRAMES as usize];
    let first = engine.completed() + 1;
    let mut statistics = Vec::new();
    for i in 0..FRAMES {
        let slot = (i % in_flight) as usize;
        if let Some((old, target)) = running[slot].take() {
            engine.wait(first + old);
            pictures[old as usize] = target.picture(0);
            target.destroy(engine);
        }
        statistics.extend(renderer.retire(engine.completed()).expect("statistics"));
        // Clouds change while earlier frames run.
        match i {
            2 => clouds.push(renderer.add(sphere(500)).expect("a cloud")),
            4 => renderer.remove(clouds.remove(0)),
            // Drawn by a frame that runs now.
            6 => clouds.push(renderer.add(sphere(300)).expect("a cloud")),
            7 => renderer.remove(clouds.remove(0)),
            8 => renderer.remove(clouds.remove(0)),
            10 => clouds.push(renderer.add(sphere(700)).expect("a cloud")),
            _ => {}
        }
        let kind = kind(i);
        let target = Target::new(engine, kind);
        let instances: Vec<_> = (0..)
            .zip(&clouds)
            .map(|(k, &cloud)| Instance {
                cloud,
                transform: DMat4::from_translation(dvec3(0.7 * k as f64, 0.1 * i as f64, 0.0)),
            })
            .collect();
        let view = camera((i % 2) as u32, Lens::Straight, DepthConvention::Reversed, 1.25);
        let style = Style::default();
        let frame = Frame {
            id: first + i,
            views: &[view],
            instances: &instances,
            technique: Technique::default(),
            style: &style,
        };
        engine.begin(cmds[slot]);
        target.record(engine, cmds[slot], &mut renderer, &frame);
        engine.submit(cmds[slot], first + i);
        running[slot] = Some((i, target));
    }
    // A cloud that leaves while the last frames run.
    renderer.remove(clouds.remove(0));
    for (old, target) in running.into_iter().flatten() {
        engine.wait(first + old);
        pictures[old as usize] = target.picture(0);
        target.destroy(engine);
    }
    statistics.extend(renderer.retire(engine.completed()).expect("statistics"));
    let ids: Vec<_> = statistics.iter().map(|s| s.frame).collect();
    assert_eq!(ids, (first..first + FRAMES).collect::<Vec<_>>(), "every frame is accounted for, in order");
    for stats in &statistics {
        let drawn = stats.points_drawn.expect("counted") + stats.culled.expect("counted").total();
        assert_eq!(stats.points_submitted, drawn, "frame {}", stats.frame);
    }
    // The technique never changes: pipelines are built in the first frame, one more for the first frame without any cloud,
    // which has nothing to light, and one for the engine's depth when, still without a cloud, the targets are made anew
    // without normals.
    let building: Vec<_> = statistics.iter().filter(|s| s.pipelines_built > 0).map(|s| s.frame - first).collect();
    assert_eq!(building, [0, 8, 9]);
    // SAFETY: all frames are complete.
    unsafe { renderer.destroy() };
    pictures
}

fn renderer(engine: &Engine) -> Renderer {
    let target = Target::new(engine, kind(0));
    // SAFETY: the handles belong together and outlive the renderer.
    let renderer = unsafe { Renderer::new(engine.host(), target.formats()) }.expect("a renderer");
    target.destroy(engine);
    renderer
}

#[test]
fn two_and_three_frames_in_flight_show_what_one_shows() {
    Engine::with(|engine| {
        let one = run(engine, renderer(engine), 1);
        for (i, picture) in one.iter().enumerate() {
            let kinds = kind(i as u64);
            assert_eq!(picture.len() as u32, kinds.size[0] * kinds.size[1]);
        }
        // Frames 8 and 9 have no cloud left but the one that frame 8 took away: the picture is the engine's alone.
        assert!(one.windows(2).all(|w| w[0] != w[1]), "no two frames are alike, so a mix-up would show");
        for in_flight in [2, 3] {
            let many = run(engine, renderer(engine), in_flight);
            for (i, (a, b)) in one.iter().zip(&many).enumerate() {
                assert!(a == b, "frame {i} differs with {in_flight} in flight");
            }
        }
    });
}

/// The same with the engine's `gpu_allocator`, which must be empty at the end.
#[test]
fn an_engine_with_gpu_allocator_and_fences_gets_the_same_pictures() {
    Engine::with_progress(true, |engine| {
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: engine.instance.clone(),
            device: engine.device.clone(),
            physical_device: engine.physical_device,
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        });
        let allocator = Arc::new(Mutex::new(allocator.expect("an allocator")));
        let target = Target::new(engine, kind(0));
        let memory = Box::new(SharedAllocator::new(Arc::clone(&allocator)));
        let host = engine.host_with(engine.device.clone(), memory);
        // SAFETY: the handles belong together and outlive the renderer.
        let shared = unsafe { Renderer::new(host, target.formats()) }.expect("a renderer");
        target.destroy(engine);
        let one = run(engine, renderer(engine), 1);
        assert!(one == run(engine, shared, 3), "the allocator makes no difference");
        let report = allocator.lock().unwrap().generate_report();
        assert!(report.allocations.is_empty(), "left behind: {report:?}");
    });
}

/// Nothing to draw is a picture too: no instance, a cloud without points, a cloud that nobody draws.
#[test]
fn nothing_to_draw_is_drawn() {
    Engine::with(|engine| {
        let mut renderer = renderer(engine);
        let empty = renderer.add(sphere(0)).expect("a cloud");
        let unused = renderer.add(sphere(10)).expect("a cloud");
        let style = Style::default();
        let view = camera(0, Lens::Straight, DepthConvention::Reversed, 1.25);
        let at = |cloud| Instance { cloud, transform: DMat4::IDENTITY };
        let cmd = engine.command_buffer();
        for (instances, drawn) in [(vec![], false), (vec![at(empty)], false), (vec![at(empty), at(unused)], true)] {
            for (_, technique) in surfel::technique::PRESETS {
                let target = Target::new(engine, Kind { geometry: false, ..kind(0) });
                let id = engine.completed() + 1;
                engine.begin(cmd);
                let frame = Frame { id, views: &[view], instances: &instances, technique: *technique, style: &style };
                target.record(engine, cmd, &mut renderer, &frame);
                engine.submit(cmd, id);
                engine.wait(id);
                let stats = renderer.retire(id).expect("statistics");
                assert_eq!(stats[0].points_submitted, if drawn { 10 } else { 0 });
                let seen = target.picture(0).iter().any(|p| *p != [0.0; 4]);
                assert_eq!(seen, drawn, "{instances:?}");
                target.destroy(engine);
            }
        }
        assert_eq!(renderer.pending_upload(), 0);
        // SAFETY: all frames are complete.
        unsafe { renderer.destroy() };
    });
}

/// A renderer that is destroyed before it drew, or with clouds that were never uploaded, leaves nothing.
#[test]
fn a_renderer_that_never_drew_leaves_nothing() {
    Engine::with(|engine| {
        // SAFETY: nothing was recorded.
        unsafe { renderer(engine).destroy() };
        let mut waiting = renderer(engine);
        let gone = waiting.add(sphere(20)).expect("a cloud");
        waiting.add(sphere(10)).expect("a cloud");
        assert_eq!(waiting.pending_upload(), 30 * 25);
        waiting.remove(gone);
        waiting.remove(gone);
        assert_eq!(waiting.pending_upload(), 10 * 25);
        // SAFETY: as above.
        unsafe { waiting.destroy() };
    });
}

/// The upload budget spreads clouds over frames; what is there is drawn.
#[test]
fn a_budget_spreads_uploads_over_frames() {
    Engine::with(|engine| {
        let mut renderer = renderer(engine);
        renderer.upload_budget = 1;
        let clouds = [renderer.add(sphere(400)).expect("a cloud"), renderer.add(sphere(600)).expect("a cloud")];
        let instances = clouds.map(|cloud| Instance { cloud, transform: DMat4::IDENTITY });
        let style = Style::default();
        let view = camera(0, Lens::Straight, DepthConvention::Reversed, 1.25);
        let cmd = engine.command_buffer();
        for (submitted, pending) in [(400, 600 * 25), (1000, 0), (1000, 0)] {
            let target = Target::new(engine, kind(0));
            let id = engine.completed() + 1;
            engine.begin(cmd);
            let technique = Technique::default();
            let frame = Frame { id, views: &[view], instances: &instances, technique, style: &style };
            target.record(engine, cmd, &mut renderer, &frame);
            engine.submit(cmd, id);
            engine.wait(id);
            assert_eq!(renderer.retire(id).expect("statistics")[0].points_submitted, submitted);
            assert_eq!(renderer.pending_upload(), pending);
            target.destroy(engine);
        }
        // SAFETY: all frames are complete.
        unsafe { renderer.destroy() };
    });
}

/// A frame may end after `prepare`, as when a window is hidden: the uploads count, and the next frame draws.
#[test]
fn a_frame_may_end_after_prepare() {
    Engine::with(|engine| {
        let mut renderer = renderer(engine);
        let cloud = renderer.add(sphere(400)).expect("a cloud");
        let instances = [Instance { cloud, transform: DMat4::IDENTITY }];
        let (view, style) = (camera(0, Lens::Straight, DepthConvention::Reversed, 1.25), Style::default());
        let target = Target::new(engine, Kind { geometry: false, ..kind(0) });
        let cmd = engine.command_buffer();
        engine.begin(cmd);
        let id = engine.completed() + 1;
        let input = FrameInput {
            id,
            extent: vk::Extent2D { width: 48, height: 40 },
            offset: vk::Offset2D::default(),
            views: &[view],
            instances: &instances,
            technique: Technique::default(),
            style: &style,
            host_depth: None,
            count: true,
            keep_lists: false,
        };
        // SAFETY: recording outside a pass; ids grow.
        unsafe { renderer.prepare(cmd, &input) }.expect("prepare");
        engine.submit(cmd, id);
        engine.wait(id);
        let stats = renderer.retire(id).expect("statistics").remove(0);
        assert!(stats.bytes_uploaded >= 400 * 25, "{stats:?}");
        assert!(stats.points_drawn.is_none() && stats.culled.is_none(), "nothing was drawn: {stats:?}");
        assert!(stats.passes.iter().all(|p| !["visibility", "accumulate", "composite"].contains(&p.name)));
        engine.begin(cmd);
        let technique = Technique::default();
        let frame = Frame { id: id + 4, views: &[view], instances: &instances, technique, style: &style };
        target.record(engine, cmd, &mut renderer, &frame);
        engine.submit(cmd, id + 4);
        engine.wait(id + 4);
        let stats = renderer.retire(id + 4).expect("statistics").remove(0);
        assert_eq!((stats.frame, stats.bytes_uploaded), (id + 4, 0));
        assert!(stats.points_drawn.is_some_and(|n| n > 0), "{stats:?}");
        assert!(target.picture(0).iter().any(|p| p[3] > 0.0), "the cloud is there");
        target.destroy(engine);
        // SAFETY: all frames are complete.
        unsafe { renderer.destroy() };
    });
}

#[test]
fn the_renderer_may_move_between_threads() {
    fn send<T: Send>() {}
    fn share<T: Send + Sync>() {}
    send::<Renderer>();
    send::<surfel::Host>();
    share::<surfel::Requirements>();
    share::<surfel::FrameStats>();
    share::<surfel::Error>();
    share::<CloudId>();
}
