//! The renderer: `new → add → (prepare → render → composite → retire)* → destroy`.
//!
//! It records into the host's command buffers and never submits, waits, presents or makes a device.

mod ready;
mod supply;
mod told;

use std::collections::BTreeMap;

use ash::vk;

use crate::composite::{Before, Composite, resolve};
use crate::draw::assemble::{Assembly, Scene};
use crate::draw::cloud::DeviceCloud;
use crate::draw::layers::Layers;
use crate::draw::params::{Camera, frame_params};
use crate::draw::plan::{CloudTraits, FramePlan};
use crate::draw::slot::{Read, Slot};
use crate::draw::splats::{Bindings, Draw, RUN_STAGES};
use crate::draw::targets::Targets;
use crate::draw::variant::{Pipelines, shaders};
use crate::draw::{count, fuzzy, groups, list, opaque, two_pass};
use crate::error::{Error, Result};
use crate::gpu::Context;
use crate::gpu::barrier::Access;
use crate::gpu::layout::RunPush;
use crate::gpu::pass::{Recorder, Use};
use crate::gpu::program::Program;
use crate::gpu::resource::Buffer;
use crate::gpu::retire::RetireQueue;
use crate::host::{CloudId, FrameInput, Host, Instance, Requirements, TargetFormats};
use crate::stats::{FrameStats, Skip};
use crate::structure::Cloud;
use crate::technique::Blend;

/// Draws clouds into frames that a host records.
pub struct Renderer {
    context: Context,
    formats: TargetFormats,
    splats: Program,
    pipelines: Pipelines,
    composite: Composite,
    indices: Option<Buffer>,
    clouds: BTreeMap<CloudId, DeviceCloud>,
    next_cloud: u64,
    targets: Option<Targets>,
    layers: Option<Layers>,
    slots: Vec<Slot>,
    retired: RetireQueue,
    /// Filled, not yet recorded: the copies of a `prepare` that failed after them wait here for the next one.
    staged: Vec<supply::Staged>,
    current: Option<Current>,
    /// Id of the last frame that was prepared.
    newest: u64,
    completed: u64,
    /// Bytes that one `prepare` uploads at most, rounded up to a chunk (64 MiB of geometry and its attributes): the rest
    /// follows in later frames, and what is there is drawn. Unlimited by default.
    pub upload_budget: u64,
}

/// A frame between `prepare` and `composite`.
struct Current {
    slot: usize,
    plan: FramePlan,
    /// What comes before the splats, or folds their layers.
    before: Option<Before>,
    /// What makes depth of the splats for what is tested against it, for blends that have it elsewhere.
    front_depth: Option<Before>,
    resolve: resolve::Variant,
    /// The picture in the host's target.
    offset: vk::Offset2D,
    extent: vk::Extent2D,
    /// What of it anything is drawn in, in any view.
    reached: vk::Rect2D,
    clouds: Vec<CloudId>,
    views: Vec<Vec<Draw>>,
    count: bool,
}

impl Renderer {
    /// Makes a renderer for one kind of target.
    ///
    /// Fails with [`Error::Unsupported`], naming every missing item, where the device lacks something required, or where
    /// it cannot draw to such a target.
    ///
    /// # Safety
    /// - `host.instance`, `host.physical_device` and `host.device` belong together and outlive the renderer.
    /// - The device was made with the required features of [`Requirements`], and `host.enabled` claims no more than was
    ///   enabled on it.
    /// - A render pass in `formats` is valid during this call, and during every `prepare` that builds a pipeline.
    pub unsafe fn new(host: Host, formats: TargetFormats) -> Result<Renderer> {
        let missing = Requirements::query(&host.instance, host.physical_device).missing();
        if !missing.is_empty() {
            let names: Vec<_> = missing.iter().map(|m| m.to_string()).collect();
            return Err(Error::Unsupported(format!("this device lacks {}", names.join(", "))));
        }
        formats.check(&host.instance, host.physical_device)?;
        let context = Context::new(
            &host.instance,
            host.physical_device,
            host.device,
            host.enabled,
            host.pipeline_cache,
            host.memory,
        );
        let push = vk::PushConstantRange { stage_flags: RUN_STAGES, offset: 0, size: size_of::<RunPush>() as u32 };
        let splats = Program::new(&context, "splats", &shaders(&context.enabled), true, Some(push))?;
        let composite = match Composite::new(&context, formats) {
            Ok(composite) => composite,
            Err(e) => {
                splats.destroy(&context);
                return Err(e);
            }
        };
        Ok(Renderer {
            context,
            formats,
            splats,
            pipelines: Pipelines::default(),
            composite,
            indices: None,
            clouds: BTreeMap::new(),
            next_cloud: 1,
            targets: None,
            layers: None,
            slots: Vec::new(),
            retired: RetireQueue::default(),
            staged: Vec::new(),
            current: None,
            newest: 0,
            completed: 0,
            upload_budget: u64::MAX,
        })
    }

    /// Takes a cloud in; it is uploaded by the next `prepare` calls, and drawn as far as it is there. A layered point cloud takes
    /// the memory of its cache now, and starts its threads; what views need of it comes as they need it.
    pub fn add(&mut self, cloud: impl Into<Cloud>) -> Result<CloudId> {
        let id = CloudId(self.next_cloud);
        self.clouds.insert(id, DeviceCloud::new(&mut self.context, &self.splats, cloud.into())?);
        self.next_cloud += 1;
        Ok(id)
    }

    /// Gives a cloud up, at any time between frames: its memory is freed when every frame recorded so far is complete.
    /// Unknown ids are ignored.
    pub fn remove(&mut self, id: CloudId) {
        if let Some(cloud) = self.clouds.remove(&id) {
            cloud.retire(&mut self.retired, self.newest);
            for gone in self.staged.extract_if(.., |s| s.cloud == Some(id)) {
                gone.upload.retire(&mut self.retired, self.newest);
            }
        }
    }

    /// Sets how many samples of a layered point cloud are drawn at most, over all views, from the next frame on
    /// ([`Streaming::samples`](crate::structure::layered::Streaming::samples)). Others are ignored.
    pub fn limit(&mut self, id: CloudId, samples: Option<u64>) {
        if let Some(patches) = self.clouds.get_mut(&id).and_then(|cloud| cloud.patches.as_mut()) {
            patches.samples = samples;
        }
    }

    /// Bytes that the next `prepare` calls have to upload, of clouds that are here as a whole.
    pub fn pending_upload(&self) -> u64 {
        self.clouds.values().map(DeviceCloud::pending).sum()
    }

    /// Records uploads and what a frame needs before it draws.
    ///
    /// All that can fail is done before anything is recorded: after an error `cmd` is as it was, the frame does not
    /// exist, and the call may be repeated with the same id or a later one, or given up. Where memory runs out in the
    /// middle of the uploads, what was staged is recorded and the rest waits for a later frame; an error says that
    /// nothing at all could be staged. After success the commands must be submitted before the next `prepare`.
    ///
    /// # Safety
    /// - `cmd` is recording, outside any pass, on a queue family with graphics and compute; `render` and `composite` of
    ///   this frame follow in the same or later command buffers of the same queue, submitted in this order, before the
    ///   next frame's `prepare`.
    /// - `input.id` is greater than that of every earlier frame; frames are submitted in order of their ids.
    /// - The clouds in `input.instances` were added and not removed; `input.host_depth`'s view is valid until the frame
    ///   is complete.
    /// - The views are as [`View`](crate::select::View) demands; their number is that of the target's view mask, or 1.
    pub unsafe fn prepare(&mut self, cmd: vk::CommandBuffer, input: &FrameInput) -> Result<()> {
        debug_assert!(input.id > self.newest, "frame ids grow");
        let views = (self.formats.view_mask.count_ones() as usize).max(1);
        if input.views.len() != views {
            return Err(Error::Unsupported(format!("{} views: the target has {views}", input.views.len())));
        }
        if let Some(i) = input.instances.iter().find(|i| !self.clouds.contains_key(&i.cloud)) {
            return Err(Error::Unsupported(format!("an instance of a cloud that is not there: {:?}", i.cloud)));
        }
        debug_assert!(input.views.iter().all(|v| v.depth == input.views[0].depth), "one depth convention a target");
        self.current = None;
        let traits: Vec<CloudTraits> = input.instances.iter().map(|i| self.cloud(i).traits()).collect();
        let plan = FramePlan::new(&input.technique, input.style, &traits, &self.surroundings(input));
        if plan.blend != Blend::Opaque && !input.style.tolerance.is_positive() {
            return Err(Error::Unsupported(format!(
                "{:?}: a blend needs one that is a number and more than 0",
                input.style.tolerance
            )));
        }
        if !(input.style.threshold > 0.0 && input.style.threshold.is_finite()) {
            let text = format!("a threshold of {} px: it is a number and more than 0", input.style.threshold);
            return Err(Error::Unsupported(text));
        }
        if plan.blend == Blend::Groups && traits.iter().any(|t| t.groups.is_none()) {
            return Err(Error::Unsupported(
                "groups of a cloud that has none: see `Flat::groups`, of models `layered::Options::groups`".into(),
            ));
        }
        let mut stats = FrameStats {
            frame: input.id,
            sums: plan.sums,
            blend: plan.blend,
            ordered: plan.ordered,
            layers: plan.layers,
            skipped: plan.skipped.clone(),
            ..FrameStats::default()
        };
        self.ensure_targets(input, &plan)?;
        self.ensure_layers(input, &plan)?;
        if let Some(layers) = self.layers.as_ref().filter(|_| plan.layers > 0) {
            let pixels = input.extent.width as u64 * input.extent.height as u64;
            stats.layer_bytes = pixels * layers.plan.bytes_per_pixel();
        }
        let draws = (input.views.len() * input.instances.len()).max(1) as u64;
        let slot = self.ensure_slot(draws)?;
        self.stage()?;

        let Some(targets) = &self.targets else { unreachable!("made above") };
        let cameras: Vec<Camera> = input.views.iter().map(|v| Camera::new(v, input.extent)).collect();
        let sprite_limit = if plan.quads { f64::MAX } else { self.context.limits.point_size_range[1] as f64 };
        let scene = Scene { input, plan: &plan, targets: targets.plan, sprite_limit, cameras: &cameras };
        let supply::Streamed { table, tested, models } = self.stream(&scene, &mut stats);
        let of_instances: Vec<&DeviceCloud> = input.instances.iter().map(|i| self.cloud(i)).collect();
        let Assembly { views, params, listing, area } = scene.assemble(&of_instances);
        let any_large = views.iter().flatten().any(Draw::has_large);
        let keep = input.keep_lists && !listing.is_empty();
        self.slots[slot].ensure_lists(&mut self.context, &listing, keep)?;
        self.slots[slot].write_cuts(&mut self.context, &table)?;
        self.slots[slot].ensure_tests(&mut self.context, tested)?;
        self.slots[slot].models = models;
        if !any_large {
            stats.skipped.push(Skip {
                stage: "large footprints",
                reason: "no block has a splat near the eye or beyond the point size limit",
            });
        }
        let before = self.before(input, &plan);
        let front_depth = ready::front_depth(&plan, input.host_depth.is_some());
        let tested = views.iter().flatten().any(|d| !d.tests.is_empty());
        let full_screen = before.into_iter().chain(front_depth.filter(|_| tested));
        stats.pipelines_built = self.ensure_pipelines(input, &plan, &views, full_screen)?;
        self.ensure_indices(plan.quads || any_large)?;

        // Nothing fails from here on.
        self.newest = input.id;
        stats.bytes_uploaded = self.record_uploads(cmd, slot);
        self.slots[slot].frame = input.id;
        let slot_ref = &mut self.slots[slot];
        let Some(targets) = &self.targets else { unreachable!("made above") };
        let frame = frame_params(&cameras, input.extent, input.offset, input.style);
        let layers = self.layers.as_ref().filter(|_| plan.layers > 0);
        let read = Read { targets, layers, host_depth: input.host_depth, sampler: self.composite.sampler };
        slot_ref.write(&self.context, &params, &frame, &read);
        // Until it is recorded: a frame may end here.
        slot_ref.counted = false;
        if let Some(lists) = slot_ref.lists.as_mut().filter(|_| !listing.is_empty()) {
            lists.write(&listing);
        }

        stats.triangles_submitted = views.iter().flatten().map(Draw::triangles).sum();
        stats.points_submitted = views.iter().flatten().map(Draw::points).sum();
        let clouds: Vec<CloudId> = input.instances.iter().map(|i| i.cloud).collect();
        let cloud_refs: Vec<&DeviceCloud> = clouds.iter().map(|id| &self.clouds[id]).collect();
        let slot_ref = &mut self.slots[slot];
        let bindings = Bindings {
            program: &self.splats,
            pipelines: &self.pipelines,
            params: slot_ref.params_set,
            select: slot_ref.select_set,
            indices: self.indices.as_ref(),
            lists: slot_ref.lists.as_ref(),
            tests: None,
            clouds: &cloud_refs,
        };
        let mut recorder = Recorder::new(&self.context, cmd, slot_ref.timestamps.as_mut());
        if let Some(lists) = slot_ref.lists.as_ref().filter(|_| !listing.is_empty()) {
            stats.draw_calls += list::record(&mut recorder, &bindings, lists, &listing);
        } else {
            stats.skipped.push(Skip { stage: "compaction", reason: "nothing is tested point by point by compute" });
        }
        if !input.count {
            stats.skipped.push(Skip { stage: "count", reason: "no statistics of points asked for" });
        }
        slot_ref.kept = keep.then_some(listing);
        stats.device_bytes = self.context.allocated;
        self.slots[slot].stats = Some(stats);
        let convention = input.views[0].depth;
        let resolve = resolve::Variant::new(&plan, input.style, convention);
        self.current = Some(Current {
            slot,
            plan,
            before,
            front_depth,
            resolve,
            offset: input.offset,
            extent: input.extent,
            reached: area.of(input.extent),
            clouds,
            views,
            count: input.count,
        });
        Ok(())
    }

    /// Records all splat passes into the library's own targets.
    ///
    /// # Safety
    /// - `prepare` was recorded for this frame, and `cmd` is as there: recording, outside any pass.
    /// - The host's depth, if given, is in its stated layout, and its writes are visible to sampled reads in fragment
    ///   shaders.
    pub unsafe fn render(&mut self, cmd: vk::CommandBuffer) -> Result<()> {
        let current = self.current.as_ref().expect("prepare comes before render");
        let Some(targets) = &mut self.targets else { unreachable!("made by prepare") };
        let clouds: Vec<&DeviceCloud> = current.clouds.iter().map(|id| &self.clouds[id]).collect();
        let slot = &mut self.slots[current.slot];
        let bindings = Bindings {
            program: &self.splats,
            pipelines: &self.pipelines,
            params: slot.params_set,
            select: slot.select_set,
            indices: self.indices.as_ref(),
            lists: slot.lists.as_ref(),
            tests: slot.tests.as_ref().filter(|_| !slot.tested.is_empty()),
            clouds: &clouds,
        };
        let mut calls = 0;
        let mut recorder = Recorder::new(&self.context, cmd, slot.timestamps.as_mut());
        for (layer, draws) in current.views.iter().enumerate() {
            let (context, composite, set) = (&self.context, &self.composite, slot.frame_set);
            let layers = self.layers.as_ref().filter(|_| current.plan.layers > 0);
            let folded = layers.map(|l| (l.set, current.plan.layers));
            let reached = current.reached;
            let seed = current.before.map(|before| {
                move |cmd| {
                    if matches!(before, Before::Fold { .. }) {
                        context.set_scissor(cmd, reached);
                    }
                    composite.draw_before(context, cmd, before, set, layer as u32, folded)
                }
            });
            let front_depth = |cmd| {
                let before = current.front_depth.expect("planned for blends that need it");
                composite.draw_before(context, cmd, before, set, layer as u32, folded)
            };
            calls += match current.plan.blend {
                Blend::TwoPass => two_pass::draw(&mut recorder, targets, layer, &bindings, draws, seed),
                Blend::Opaque => opaque::draw(&mut recorder, targets, layer, &bindings, draws, seed),
                Blend::Fuzzy => {
                    let access = current.plan.ordered.expect("planned with a way to be drawn");
                    fuzzy::draw(&mut recorder, targets, layer, &bindings, draws, access, (seed, front_depth))
                }
                Blend::Groups => {
                    let layers = self.layers.as_mut().expect("made by prepare");
                    let fold = seed.expect("layers are always folded");
                    groups::draw(&mut recorder, targets, layer, layers, &bindings, draws, (fold, front_depth))
                }
            };
        }
        slot.counted = current.count;
        if slot.counted {
            // Only now is it known what of the doubtful is drawn.
            calls += count::record(&mut recorder, &bindings, &slot.counts, &current.views);
        }
        // Ready for `composite`, which may not place barriers inside the host's pass.
        recorder.barrier(targets.images().map(|i| Use::Image(i, Access::FragmentRead)).collect());
        if let Some(stats) = &mut slot.stats {
            stats.draw_calls += calls;
        }
        Ok(())
    }

    /// Records one triangle into the host's pass: premultiplied colour over what is there and, with a depth target, the
    /// front's depth, tested against the host's.
    ///
    /// # Safety
    /// - `render` was recorded for this frame; `cmd` is recording inside a pass of the kind and formats given to `new`,
    ///   and on the same queue.
    /// - The target covers offset and extent of the frame's input.
    pub unsafe fn composite(&mut self, cmd: vk::CommandBuffer) -> Result<()> {
        let current = self.current.take().expect("render comes before composite");
        let slot = &mut self.slots[current.slot];
        let views = current.views.len() as u32;
        self.context.begin_label(cmd, "composite");
        if let Some(timestamps) = &mut slot.timestamps {
            timestamps.begin(&self.context, cmd, "composite", views);
        }
        let Current { offset, extent, reached, .. } = current;
        let within = vk::Offset2D { x: offset.x + reached.offset.x, y: offset.y + reached.offset.y };
        let (area, reached) = (vk::Rect2D { offset, extent }, vk::Rect2D { offset: within, ..reached });
        self.composite.resolve(&self.context, cmd, current.resolve, slot.frame_set, (area, reached));
        if let Some(timestamps) = &mut slot.timestamps {
            timestamps.end(&self.context, cmd, views);
        }
        self.context.end_label(cmd);
        if let Some(stats) = &mut slot.stats {
            stats.draw_calls += 1;
            debug_assert!(current.plan.lit || current.resolve.is_unlit());
        }
        Ok(())
    }

    /// Bytes of device memory held now.
    pub fn device_bytes(&self) -> u64 {
        self.context.allocated
    }

    /// Destroys everything. The device no longer executes any frame that was recorded.
    ///
    /// # Safety
    /// - Every frame recorded is complete, or was never submitted and will not be.
    pub unsafe fn destroy(mut self) {
        let context = &mut self.context;
        for cloud in std::mem::take(&mut self.clouds).into_values() {
            cloud.retire(&mut self.retired, u64::MAX);
        }
        self.retired.collect(context, u64::MAX);
        for supply::Staged { upload, .. } in self.staged {
            upload.destroy(context);
        }
        for slot in self.slots {
            slot.destroy(context);
        }
        if let Some(targets) = self.targets {
            targets.destroy(context);
        }
        if let Some(layers) = self.layers {
            layers.destroy(context);
        }
        if let Some(indices) = self.indices {
            indices.destroy(context);
        }
        self.pipelines.destroy(context);
        self.composite.destroy(context);
        self.splats.destroy(context);
        debug_assert_eq!(context.allocated, 0, "everything was given back");
    }

    fn cloud(&self, instance: &Instance) -> &DeviceCloud {
        self.clouds.get(&instance.cloud).expect("an instance's cloud was added and not removed")
    }
}
