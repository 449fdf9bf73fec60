//! The frames of one picture: upload, one that counts, warm-up, timed ones.

use anyhow::{Context, Result, bail};

use surfel::FrameStats;
use surfel::measure::Summary;
use surfel::standalone::{Offscreen, Shot};

use super::progress::Progress;

/// What the frames did and took.
#[derive(Debug, Default)]
pub struct Account {
    /// Of the counting frame, with the timed frames' number of draw calls.
    pub stats: FrameStats,
    /// Median time of each pass on the device \[ms\], in order; empty where the device has no timestamps.
    pub passes: Vec<(&'static str, f64)>,
    /// Medians over the timed frames \[ms\].
    pub gpu: Option<f64>,
    /// From the start of recording to the device's completion.
    pub frame: Option<f64>,
    /// `prepare` alone.
    pub prepare: Option<f64>,
}

/// Draws them all. The picture that is left is the last one's.
pub fn draw(offscreen: &mut Offscreen, shot: &Shot, warmup: u32, frames: u32, progress: &Progress) -> Result<Account> {
    upload(offscreen, shot, progress)?;
    let step = progress.step("draw", 1);
    let all = 1 + warmup as u64 + frames as u64;
    // It counts in a pass of its own, so it is not timed; it also builds what is built once.
    let (mut stats, _) = offscreen.draw(&Shot { count: true, ..*shot })?;
    for i in 0..warmup as u64 {
        step.set(1 + i, all);
        offscreen.draw(&Shot { count: false, ..*shot })?;
    }
    let mut timed = Vec::new();
    for i in 0..frames as u64 {
        step.set(1 + warmup as u64 + i, all);
        timed.push(offscreen.draw(&Shot { count: false, ..*shot })?);
    }
    if let Some((last, _)) = timed.last() {
        stats.draw_calls = last.draw_calls;
        stats.device_bytes = last.device_bytes;
    }
    let median = |values: Vec<f64>| Summary::of(&values).map(|s| s.median);
    let passes = timed.first().map_or(&[][..], |(first, _)| &first.passes);
    let pass = |i: usize| median(timed.iter().filter_map(|(s, _)| s.passes.get(i)).map(|p| p.gpu_ms).collect());
    Ok(Account {
        passes: passes.iter().enumerate().filter_map(|(i, p)| Some((p.name, pass(i)?))).collect(),
        gpu: median(timed.iter().filter(|(s, _)| !s.passes.is_empty()).map(|(s, _)| s.gpu_ms()).collect()),
        frame: median(timed.iter().map(|(_, t)| t.frame).collect()),
        prepare: median(timed.iter().map(|(_, t)| t.prepare).collect()),
        stats,
    })
}

/// Frames that draw nothing, until everything is on the device.
pub fn upload(offscreen: &mut Offscreen, shot: &Shot, progress: &Progress) -> Result<()> {
    let total = offscreen.renderer.pending_upload();
    let step = progress.step("upload", total);
    let mut left = total;
    while left > 0 {
        offscreen.draw(&Shot { instances: &[], count: false, ..*shot }).context("upload")?;
        let now = offscreen.renderer.pending_upload();
        if now >= left {
            bail!("upload stands still: {now} of {total} bytes are left");
        }
        left = now;
        step.set(total - left, total);
    }
    Ok(())
}
