//! What comes to the device: clouds chunk by chunk, patches of layered ones as views need them.

use ash::vk;

use super::Renderer;
use crate::draw::assemble::Scene;
use crate::draw::cuts::CutTable;
use crate::draw::occlusion::Tested;
use crate::draw::patches::Occluding;
use crate::error::{Error, Result};
use crate::gpu::barrier::Access;
use crate::gpu::pass::{Recorder, Use};
use crate::gpu::upload::Upload;
use crate::host::CloudId;
use crate::stats::{FrameStats, Skip};

/// Copies to record, and the cloud that they fill; none for what belongs to the renderer.
pub(super) struct Staged {
    pub cloud: Option<CloudId>,
    pub upload: Upload,
}

/// What a frame knows of the layered point clouds that it shows.
#[derive(Default)]
pub(super) struct Streamed {
    pub table: CutTable,
    pub tested: Vec<Tested>,
    /// In the order of the statistics.
    pub models: Vec<CloudId>,
}

impl Renderer {
    pub(super) fn stage(&mut self) -> Result<()> {
        let mut bytes: u64 = self.staged.iter().map(|s| s.upload.bytes()).sum();
        for (&id, cloud) in &mut self.clouds {
            while bytes < self.upload_budget {
                match cloud.upload_next(&mut self.context, &self.splats) {
                    Ok(Some(upload)) => {
                        bytes += upload.bytes();
                        self.staged.push(Staged { cloud: Some(id), upload });
                    }
                    Ok(None) => break,
                    // What is staged is freed when this frame is complete: there may be room then.
                    Err(Error::OutOfDeviceMemory { .. }) if bytes > 0 => return Ok(()),
                    Err(e) => return Err(e),
                }
            }
        }
        Ok(())
    }

    pub(super) fn stream(&mut self, scene: &Scene, stats: &mut FrameStats) -> Streamed {
        let input = scene.input;
        let mut streamed = Streamed::default();
        let margin = input.style.footprint_margin().max(1.0) / input.style.threshold as f64;
        let margin = self.context.enabled.conditional.then_some(margin);
        for instance in input.instances {
            let (id, done) = (instance.cloud, &mut streamed.models);
            let Some(cloud) = self.clouds.get_mut(&id).filter(|c| c.patches.is_some() && !done.contains(&id)) else {
                continue;
            };
            done.push(id);
            let (sights, culled) = scene.sights(cloud, |i| i.cloud == id);
            let Some(patches) = &mut cloud.patches else { continue };
            let mut occluding =
                Occluding { cloud: id, margin: margin.filter(|_| patches.occlusion()), tests: &mut streamed.tested };
            let staged: u64 = self.staged.iter().map(|s| s.upload.bytes()).sum();
            let budget = self.upload_budget.saturating_sub(staged);
            let upload = patches.take_in(input.id, self.completed, &cloud.chunks, budget);
            self.staged.extend(upload.map(|upload| Staged { cloud: Some(id), upload }));
            patches.select(input.id, &sights, culled, &mut streamed.table, &mut occluding);
            patches.ask();
            stats.layered.push(patches.stats());
        }
        let mut skip = |reason| stats.skipped.push(Skip { stage: "occlusion", reason });
        match stats.layered.iter().all(|l| l.occlusion_idle) {
            _ if stats.layered.is_empty() => skip("no layered point cloud"),
            _ if margin.is_none() => skip("conditionalRendering is not enabled"),
            true => skip("so little was hidden lately that new patches are drawn without a test"),
            false if streamed.tested.is_empty() => skip("nothing is due to be tested"),
            false => {}
        }
        streamed
    }

    pub(super) fn record_uploads(&mut self, cmd: vk::CommandBuffer, slot: usize) -> u64 {
        if let Some(timestamps) = &mut self.slots[slot].timestamps {
            timestamps.reset(&self.context, cmd);
        }
        if let Some(tests) = self.slots[slot].tests.as_ref().filter(|_| !self.slots[slot].tested.is_empty()) {
            tests.reset(&self.context, cmd, self.slots[slot].tested.len());
        }
        let staged = std::mem::take(&mut self.staged);
        if !staged.is_empty() {
            let mut recorder = Recorder::new(&self.context, cmd, self.slots[slot].timestamps.as_mut());
            // What a patch takes the place of, complete frames have read: layers that do not know the host's semaphores cannot tell.
            let before = vec![Use::Memory(Access::VertexRead, Access::CopyWrite)];
            recorder.pass("upload", before, |context, cmd| staged.iter().for_each(|s| s.upload.record(context, cmd)));
            recorder.barrier(vec![Use::Memory(Access::CopyWrite, Access::VertexRead)]);
        }
        let mut bytes = 0;
        for Staged { upload, .. } in staged {
            bytes += upload.bytes();
            upload.retire(&mut self.retired, self.newest);
        }
        bytes
    }
}
