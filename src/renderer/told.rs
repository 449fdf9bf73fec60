//! What complete frames tell: statistics, and what their occlusion tests have found.

use std::collections::BTreeMap;

use super::Renderer;
use crate::draw::cloud::DeviceCloud;
use crate::draw::count;
use crate::draw::slot::Slot;
use crate::error::{Error, Result};
use crate::host::CloudId;
use crate::stats::{Culled, FrameStats, PassTime};

/// Tells models what a frame's tests have found, and the statistics. Returns the number of points that were not drawn.
fn learn(
    clouds: &mut BTreeMap<CloudId, DeviceCloud>,
    slot: &Slot,
    answers: &[Option<bool>],
    stats: &mut FrameStats,
) -> u64 {
    let mut hidden = 0;
    for (test, visible) in slot.tested.iter().zip(answers).filter_map(|(test, answer)| Some((test, (*answer)?))) {
        if let Some(patches) = clouds.get_mut(&test.cloud).and_then(|cloud| cloud.patches.as_mut()) {
            patches.learn(test, slot.frame, visible);
        }
        if !visible && test.samples > 0 {
            hidden += u64::from(test.samples);
            if let Some(model) = slot.models.iter().position(|id| *id == test.cloud) {
                stats.layered[model].hidden += 1;
            }
        }
    }
    hidden
}

impl Renderer {
    /// Frees what only frames up to `completed` used, and returns their statistics, oldest first.
    ///
    /// `completed` is the host's counter: every frame with an id up to it was submitted and is complete on the device.
    pub fn retire(&mut self, completed: u64) -> Result<Vec<FrameStats>> {
        self.completed = self.completed.max(completed);
        self.retired.collect(&mut self.context, self.completed);
        let mut done = Vec::new();
        for slot in self.slots.iter_mut().filter(|s| s.frame <= self.completed) {
            let Some(mut stats) = slot.stats.take() else { continue };
            if let Some(timestamps) = &slot.timestamps {
                // A frame without times is still a frame; only a lost device is worth an error.
                let times = match timestamps.read(&self.context) {
                    Err(Error::DeviceLost) => return Err(Error::DeviceLost),
                    other => other.unwrap_or_default(),
                };
                stats.passes = times.into_iter().map(|(name, gpu_ms)| PassTime { name, gpu_ms }).collect();
            }
            if let Some((listing, lists)) = slot.kept.take().zip(slot.lists.as_mut()) {
                stats.lists = lists.read(&listing);
            }
            let hidden = match &slot.tests {
                Some(tests) => {
                    let answers = match tests.read(&self.context, slot.tested.len()) {
                        Err(Error::DeviceLost) => return Err(Error::DeviceLost),
                        other => other.unwrap_or_default(),
                    };
                    learn(&mut self.clouds, slot, &answers, &mut stats)
                }
                None => 0,
            };
            if slot.counted {
                let (drawn, culled) = count::account(&slot.read_counts());
                stats.points_drawn = Some(drawn);
                stats.culled = Some(Culled { occluded: hidden, ..culled });
            }
            done.push(stats);
        }
        done.sort_by_key(|s| s.frame);
        Ok(done)
    }
}
