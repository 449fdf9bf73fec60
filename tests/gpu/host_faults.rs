//! Everything that can fail, fails once: the n-th allocation, the n-th creating call, for n = 1, 2, … until a run is
//! through without a failure. Each time the error is typed, nothing is left behind, and the same call works when it is
//! repeated: the pictures are those of a run in which nothing failed.

use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use glam::DMat4;
use surfel::ash::{self, vk};
use surfel::select::DepthConvention;
use surfel::structure::layered::Streaming;
use surfel::style::Style;
use surfel::technique::Technique;
use surfel::{CloudId, Error, Host, Instance, Renderer};

use crate::host_engine::{Engine, Ledger, OwnMemory};
use crate::host_scene::{Lens, camera, sphere};
use crate::host_table;
use crate::host_target::{Depth, Frame, Kind, PLAIN, Target};
use crate::layered::{Model, PATIENCE};

const SMALL: Kind = Kind { size: [16, 12], extent: [16, 12], depth: Depth::Lent, geometry: true, ..PLAIN };
const LARGER: Kind = Kind { size: [20, 12], extent: [20, 12], ..SMALL };

/// Repeats what failed once. Returns the value and whether it failed.
fn twice<T>(failures: &mut Vec<Error>, mut call: impl FnMut() -> surfel::Result<T>) -> T {
    match call() {
        Ok(value) => value,
        Err(e) => {
            failures.push(e);
            call().expect("one failure was planted, the second try succeeds")
        }
    }
}

/// A life of a renderer: made, two clouds, a frame, and frames of another size with everything else that allocates, and with a cloud that
/// streams until all of it is there.
fn life(engine: &Engine, model: &Model, host: impl Fn() -> Host) -> (Vec<Vec<[f32; 4]>>, Vec<Error>) {
    let mut failures = Vec::new();
    let targets = [SMALL, LARGER].map(|kind| Target::new(engine, kind));
    // SAFETY: the handles belong together and outlive the renderer.
    let mut renderer = twice(&mut failures, || unsafe { Renderer::new(host(), targets[0].formats()) });
    let clouds = [60, 40].map(|n| twice(&mut failures, || renderer.add(sphere(n))));
    let streamed = twice(&mut failures, || renderer.add(model.streamed(Streaming::STILL)));
    let style = Style { threshold: 0.25, ..Style::default() };
    // The blend with the fewest shaders to compile; what it allocates is what all do.
    let techniques = ["flat.opaque.point", "flat.opaque.quad"].map(|n| Technique::named(n).expect("a preset"));
    let cmd = engine.command_buffer();
    let mut pictures = Vec::new();
    for (target, technique) in targets.iter().zip(techniques) {
        let view = camera(0, Lens::Straight, DepthConvention::Reversed, 4.0 / 3.0);
        // The streamed one comes with the second size.
        let (all, start) = ([clouds[0], clouds[1], streamed], Instant::now());
        let instances = all.map(|cloud| Instance { cloud, transform: DMat4::IDENTITY });
        let instances = &instances[..2 + pictures.len()];
        loop {
            let id = engine.completed() + 1;
            engine.begin(cmd);
            let frame = Frame { id, views: &[view], instances, technique, style: &style };
            twice(&mut failures, || {
                let recorded = target.try_record(engine, cmd, &mut renderer, &frame);
                if recorded.is_err() {
                    // What an engine does with a frame that it gives up: nothing of it is submitted.
                    // SAFETY: not pending.
                    unsafe { engine.device.reset_command_buffer(cmd, Default::default()) }.expect("reset");
                    engine.begin(cmd);
                }
                recorded
            });
            engine.submit(cmd, id);
            engine.wait(id);
            let layered = renderer.retire(id).expect("statistics").remove(0).layered;
            if layered.iter().all(|l| l.cut.missing == 0) {
                assert!(layered.iter().all(|l| l.cut.drawn > 1), "more than the root");
                break;
            }
            assert!(start.elapsed() < PATIENCE, "patches do not come: {layered:?}");
        }
        pictures.push(target.picture(0));
    }
    // SAFETY: all frames are complete.
    unsafe { renderer.destroy() };
    targets.into_iter().for_each(|t| t.destroy(engine));
    (pictures, failures)
}

/// An upload that finds no room after others did is only postponed: no error, and the next frame has it.
fn check(pictures: &[Vec<[f32; 4]>], wanted: &[Vec<[f32; 4]>], postponed: bool, case: &str) {
    assert_eq!(pictures.len(), 2);
    assert!(postponed || pictures[0] == wanted[0], "first picture, {case}");
    assert!(pictures[1] == wanted[1], "second picture, {case}");
}

fn ledger_memory(engine: &Engine, ledger: &Arc<Mutex<Ledger>>) -> Box<OwnMemory> {
    Box::new(engine.memory().with_ledger(Arc::clone(ledger)))
}

#[test]
fn the_nth_allocation_fails_and_is_repeated() {
    let model = Model::new("nth-allocation", "torus", 2000);
    Engine::with_plain_shaders(|engine| {
        let (wanted, none) = life(engine, &model, || engine.host());
        assert!(none.is_empty() && wanted[0].iter().any(|p| *p != wanted[0][0]));
        let mut reached = 0;
        for n in 1.. {
            let ledger = Arc::new(Mutex::new(Ledger { fail_at: Some(n), ..Ledger::default() }));
            let (pictures, failures) =
                life(engine, &model, || engine.host_with(engine.device.clone(), ledger_memory(engine, &ledger)));
            let postponed = failures.is_empty() && ledger.lock().unwrap().calls >= n;
            check(&pictures, &wanted, postponed, &format!("allocation {n}: {failures:?}"));
            assert_eq!(ledger.lock().unwrap().live, 0, "allocation {n}");
            reached = n;
            match &failures[..] {
                [] if postponed => {}
                [] => break,
                [Error::OutOfDeviceMemory { requested, .. }] => assert!(*requested > 0),
                other => panic!("allocation {n}: {other:?}"),
            }
        }
        assert!(reached > 15, "{reached} allocations were tried");
    });
}

#[test]
fn the_nth_creating_call_fails_and_is_repeated() {
    let model = Model::new("nth-call", "torus", 2000);
    Engine::with_plain_shaders(|engine| {
        let device = host_table::wrapped_device(engine);
        let host = || engine.host_with(device.clone(), Box::new(engine.memory()));
        host_table::fail_at(0);
        let (wanted, _) = life(engine, &model, host);
        let mut seen = std::collections::BTreeMap::new();
        for n in 1.. {
            host_table::fail_at(n);
            let (pictures, failures) = life(engine, &model, host);
            let Some(call) = host_table::failed() else { break };
            *seen.entry(call).or_insert(0) += 1;
            check(&pictures, &wanted, failures.is_empty(), &format!("call {n}, {call}: {failures:?}"));
            match &failures[..] {
                // Postponed.
                [] => {}
                [Error::OutOfDeviceMemory { what, .. }] => assert_eq!(what, call),
                other => panic!("call {n}, {call}: {other:?}"),
            }
        }
        assert_eq!(seen.len(), 14, "every function that the library creates with has failed: {seen:?}");
    });
}

/// Where memory stays short, what fits is drawn, and the rest when there is room again.
#[test]
fn uploads_without_room_wait() {
    Engine::with(|engine| {
        let target = Target::new(engine, SMALL);
        let ledger = Arc::new(Mutex::new(Ledger { keep_failing: true, ..Ledger::default() }));
        let host = engine.host_with(engine.device.clone(), ledger_memory(engine, &ledger));
        // SAFETY: the handles belong together and outlive the renderer.
        let mut renderer = unsafe { Renderer::new(host, target.formats()) }.expect("a renderer");
        let clouds: [CloudId; 2] = [60, 40].map(|n| renderer.add(sphere(n)).expect("a cloud"));
        let instances = clouds.map(|cloud| Instance { cloud, transform: DMat4::IDENTITY });
        let (view, style) = (camera(0, Lens::Straight, DepthConvention::Reversed, 4.0 / 3.0), Style::default());
        let cmd = engine.command_buffer();
        let frame = |renderer: &mut Renderer| {
            let id = engine.completed() + 1;
            engine.begin(cmd);
            let technique = Technique::default();
            let frame = Frame { id, views: &[view], instances: &instances, technique, style: &style };
            let recorded = target.try_record(engine, cmd, renderer, &frame);
            // After an error too: what the engine itself recorded is whole, and nothing else is there.
            engine.submit(cmd, id);
            engine.wait(id);
            recorded.map(|()| renderer.retire(id).expect("statistics").remove(0).points_submitted)
        };
        // Targets take 4, a slot 4, a chunk of geometry, normals, colours and groups with its staging 5: room for one chunk.
        let used = ledger.lock().unwrap().calls;
        ledger.lock().unwrap().fail_at = Some(used + 4 + 4 + 5 + 1);
        assert_eq!(frame(&mut renderer).expect("the first cloud fits"), 60);
        // Nothing more fits: an error, and no harm.
        assert!(matches!(frame(&mut renderer), Err(Error::OutOfDeviceMemory { .. })));
        assert!(matches!(frame(&mut renderer), Err(Error::OutOfDeviceMemory { .. })));
        ledger.lock().unwrap().fail_at = None;
        assert_eq!(frame(&mut renderer).expect("room again"), 100);
        // SAFETY: all frames are complete.
        unsafe { renderer.destroy() };
        assert_eq!(ledger.lock().unwrap().live, 0);
        target.destroy(engine);
    });
}

thread_local! {
    static REAL: std::cell::Cell<Option<vk::PFN_vkGetPhysicalDeviceFeatures2>> = const { std::cell::Cell::new(None) };
    static REAL_PROPERTIES: std::cell::Cell<Option<vk::PFN_vkGetPhysicalDeviceProperties>> =
        const { std::cell::Cell::new(None) };
}

/// A device without synchronization2 and blending of its own for each attachment.
unsafe extern "system" fn fewer_features(device: vk::PhysicalDevice, features: *mut vk::PhysicalDeviceFeatures2) {
    // SAFETY: the real function, and a chain of structs that begin as `BaseOutStructure` does.
    unsafe {
        REAL.get().expect("set before use")(device, features);
        (*features).features.independent_blend = vk::FALSE;
        let mut next = (*features).p_next.cast::<vk::BaseOutStructure>();
        while !next.is_null() {
            if (*next).s_type == vk::StructureType::PHYSICAL_DEVICE_VULKAN_1_3_FEATURES {
                (*next.cast::<vk::PhysicalDeviceVulkan13Features>()).synchronization2 = vk::FALSE;
            }
            next = (*next).p_next;
        }
    }
}

/// A device with the storage buffers a stage that Vulkan guarantees.
unsafe extern "system" fn lower_limits(device: vk::PhysicalDevice, to: *mut vk::PhysicalDeviceProperties) {
    // SAFETY: the real function, which fills the struct.
    unsafe {
        REAL_PROPERTIES.get().expect("set before use")(device, to);
        (*to).limits.max_per_stage_descriptor_storage_buffers = 4;
    }
}

#[test]
fn a_device_that_lacks_something_is_refused_by_name() {
    Engine::with(|engine| {
        REAL.set(Some(engine.instance.fp_v1_1().get_physical_device_features2));
        REAL_PROPERTIES.set(Some(engine.instance.fp_v1_0().get_physical_device_properties));
        let instance = engine.instance.handle();
        // SAFETY: the library was loaded by the engine and stays loaded.
        let entry = unsafe { ash::Entry::load() }.expect("a loader");
        let load = |name: &CStr| match name.to_bytes() {
            b"vkGetPhysicalDeviceFeatures2" => fewer_features as *const c_void,
            b"vkGetPhysicalDeviceProperties" => lower_limits as *const c_void,
            // SAFETY: the instance lives; an address or null comes back.
            _ => unsafe { entry.get_instance_proc_addr(instance, name.as_ptr()) }
                .map_or(std::ptr::null(), |f| f as *const c_void),
        };
        // SAFETY: the addresses are the instance's own, or of the same signature.
        let lesser = unsafe { ash::Instance::load_with(load, instance) };
        let requirements = surfel::Requirements::query(&lesser, engine.physical_device);
        let names: Vec<_> = requirements.missing().iter().map(|m| m.name).collect();
        let limit = "maxPerStageDescriptorStorageBuffers ≥ 16";
        assert_eq!(names, ["synchronization2", "independentBlend", limit]);
        let target = Target::new(engine, SMALL);
        let host = Host { instance: lesser, ..engine.host() };
        // SAFETY: the handles belong together.
        let Err(Error::Unsupported(why)) = (unsafe { Renderer::new(host, target.formats()) }) else {
            panic!("it was not refused")
        };
        assert!(why.contains("synchronization2") && why.contains("independentBlend") && why.contains(limit), "{why}");
        target.destroy(engine);
    });
}
