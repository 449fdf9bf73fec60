//! The frames of a fly-through, one after the other: nothing waits for a patch.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use glam::DMat4;

use surfel::select::layered::TimeBudget;
use surfel::standalone::{FrameTimes, Offscreen, Shot};
use surfel::stats::LayeredStats;
use surfel::style::Style;
use surfel::technique::{Blend, Technique};
use surfel::{CloudId, Instance};

use super::super::output;
use super::super::progress::Progress;
use super::path::{Camera, Path};

/// What is flown.
pub struct Flight<'a> {
    pub path: &'a Path,
    pub camera: Camera,
    /// Of one lap.
    pub frames: u32,
    pub laps: u32,
    pub technique: Technique,
    pub style: &'a Style,
    /// Time that a frame should take [ms].
    pub aim: Option<f64>,
    /// Folder for pictures, and every so many frames one.
    pub save: Option<(PathBuf, u32)>,
    pub background: [u8; 4],
}

/// One frame.
#[derive(Debug, Clone)]
pub struct Frame {
    pub times: FrameTimes,
    /// On the device, where it has timestamps [ms].
    pub gpu: Option<f64>,
    pub layered: LayeredStats,
    pub uploaded: u64,
    pub device_bytes: u64,
    pub pipelines_built: u32,
    /// The blend that was drawn.
    pub blend: Blend,
    /// When it was complete, since the model was opened [ms].
    pub at: f64,
}

impl Frame {
    /// Whether it shows all that it should.
    pub fn is_complete(&self) -> bool {
        self.layered.cut.missing == 0
    }
}

/// Samples to begin with where a time is aimed at: any device's frame with so few is short, and nine frames later the measured rate
/// has taken over.
const FIRST: u64 = 100_000;

/// Flies all laps. `opened`: when the model was.
pub fn fly(
    flight: &Flight,
    offscreen: &mut Offscreen,
    cloud: CloudId,
    opened: Instant,
    progress: &Progress,
) -> Result<Vec<Vec<Frame>>> {
    let instances = [Instance { cloud, transform: DMat4::IDENTITY }];
    let mut budget = flight.aim.map(|ms| TimeBudget::new(1e-3 * ms, FIRST));
    let mut laps = Vec::new();
    for lap in 1..=flight.laps {
        let step = progress.step(format!("lap {lap} of {}", flight.laps), flight.frames as u64);
        let mut frames = Vec::with_capacity(flight.frames as usize);
        for number in 0..flight.frames {
            if let Some(budget) = &budget {
                offscreen.renderer.limit(cloud, Some(budget.samples()));
            }
            let view = flight.camera.view(flight.path.key(number, flight.frames));
            let Flight { technique, style, .. } = *flight;
            let shot = Shot { view: &view, instances: &instances, technique, style, count: false };
            let (mut stats, times) = offscreen.draw(&shot)?;
            let at = 1e3 * opened.elapsed().as_secs_f64();
            let layered = stats.layered.pop().unwrap_or_default();
            if let Some(budget) = &mut budget {
                budget.measured(layered.cut.samples, 1e-3 * times.frame);
            }
            frames.push(Frame {
                times,
                gpu: (!stats.passes.is_empty()).then(|| stats.gpu_ms()),
                layered,
                uploaded: stats.bytes_uploaded,
                device_bytes: stats.device_bytes,
                pipelines_built: stats.pipelines_built,
                blend: stats.blend,
                at,
            });
            if let Some((folder, every)) = &flight.save
                && number.is_multiple_of(*every)
            {
                let path = folder.join(format!("lap{lap}-{number:05}.png"));
                output::picture(&path, &output::float(offscreen.read()?, &view), flight.background)?;
            }
            step.set(number as u64 + 1, flight.frames as u64);
        }
        laps.push(frames);
    }
    Ok(laps)
}
