//! Draws a case and judges it.

use std::sync::Arc;

use ash::vk;

use super::{Case, STEEPEST, Take};
use crate::error::Result;
use crate::host::Instance;
use crate::readback::Picture;
use crate::reference::{self, MARGIN_F32};
use crate::select::{DepthConvention, DrawList};
use crate::standalone::{Offscreen, Shot};
use crate::stats::FrameStats;
use crate::structure::Flat;

/// How a case ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Pixels that show something.
    pub pixels: usize,
    /// Largest error of a channel of a pixel that is no tie, in terms of the case's bound: errors of pixels that are more
    /// sensitive than a footprint of 1 px are divided by how much.
    pub worst: f64,
    /// What it may be.
    pub bound: f64,
    /// Largest error of a channel against the twin's picture, where there is one.
    pub worst_twin: Option<f64>,
    /// Pixels within rounding of a decision.
    pub ties: usize,
    /// Those that are off by more than the bound.
    pub off_ties: usize,
    /// Drawn, outside, facing away and invalid are as many as the reference says.
    pub counts_equal: bool,
    /// What is wrong, in a line each; empty: passed.
    pub faults: Vec<String>,
}

impl Outcome {
    /// Whether nothing is wrong.
    pub fn passed(&self) -> bool {
        self.faults.is_empty()
    }
}

/// Draws the case into `off`, which must have depth and takes the case's size, and compares.
///
/// Fails where the device cannot draw it at all; a wrong picture is an outcome.
pub fn run(off: &mut Offscreen, case: &Case) -> Result<Outcome> {
    let [width, height] = case.size;
    off.resize(vk::Extent2D { width, height })?;
    let flat = Arc::new(Flat::new(&case.take.cloud));
    let (picture, stats) = shoot(off, &case.take, &flat, true)?;
    let (again, _) = shoot(off, &case.take, &flat, false)?;
    let expected = expect(&case.take, &flat, case.size);
    let mut outcome = Outcome {
        pixels: expected.rgba.iter().filter(|p| p[3] > 0.0).count(),
        worst: 0.0,
        bound: case.bound,
        worst_twin: None,
        ties: expected.ties.iter().filter(|t| **t).count(),
        off_ties: 0,
        counts_equal: true,
        faults: Vec::new(),
    };
    if bytes(&picture) != bytes(&again) {
        outcome.faults.push("two runs differ".into());
    }
    if outcome.pixels < case.covered {
        outcome.faults.push(format!("only {} pixels show anything", outcome.pixels));
    }
    count(&mut outcome, &stats, &expected.counts);
    colors(&mut outcome, case, &picture, &expected);
    depths(&mut outcome, case, &picture, &expected);
    if let Some(twin) = &case.twin {
        let (other, _) = shoot(off, &twin.take, &Arc::new(Flat::new(&twin.take.cloud)), false)?;
        let mut worst = 0.0;
        for i in (0..picture.rgba.len()).filter(|i| !expected.ties[*i]) {
            let error = difference(picture.rgba[i], other.rgba[i].map(f64::from)) / scale(expected.sensitivity[i]);
            worst = f64::max(worst, error);
        }
        outcome.worst_twin = Some(worst);
        if worst > twin.bound {
            outcome.faults.push(format!("off its twin by {worst:.2e}, {:.2e} may be", twin.bound));
        }
    }
    Ok(outcome)
}

fn shoot(off: &mut Offscreen, take: &Take, flat: &Arc<Flat>, count: bool) -> Result<(Picture, FrameStats)> {
    let cloud = off.renderer.add(Arc::clone(flat))?;
    let instances = [Instance { cloud, transform: take.transform }];
    let shot = Shot { view: &take.view, instances: &instances, technique: take.technique, style: &take.style, count };
    let drawn = off.draw(&shot).and_then(|(stats, _)| Ok((off.read()?, stats)));
    off.renderer.remove(cloud);
    drawn
}

fn expect(take: &Take, flat: &Flat, [width, height]: [u32; 2]) -> reference::Picture {
    let scene = reference::Scene {
        instances: &[reference::Instance { flat, transform: take.transform }],
        list: &DrawList::all([flat.len() as u32]),
        view: &take.view,
        width,
        height,
        technique: take.technique,
        style: &take.style,
        host_depth: None,
    };
    reference::render(&scene, MARGIN_F32)
}

fn bytes(picture: &Picture) -> (Vec<[u32; 4]>, Option<Vec<u32>>) {
    let depth = picture.depth.as_ref().map(|d| d.iter().map(|v| v.to_bits()).collect());
    (picture.rgba.iter().map(|p| p.map(f32::to_bits)).collect(), depth)
}

/// Largest difference of a channel; infinite for what is not a number.
fn difference(got: [f32; 4], want: [f64; 4]) -> f64 {
    let one = |k: usize| (f64::from(got[k]) - want[k]).abs();
    (0..4).map(one).fold(0.0, |worst, e| if e.is_nan() { f64::INFINITY } else { worst.max(e) })
}

/// How much more sensitive a pixel is than footprints of 1 px and more.
fn scale(sensitivity: f64) -> f64 {
    (sensitivity / STEEPEST).max(1.0)
}

fn count(outcome: &mut Outcome, stats: &FrameStats, want: &reference::Counts) {
    let culled = stats.culled.unwrap_or_default();
    let got = [stats.points_drawn.unwrap_or_default(), culled.frustum, culled.cone, culled.invalid];
    let want = [want.drawn, want.culled_frustum, want.culled_cone, want.culled_invalid];
    outcome.counts_equal = got == want;
    if !outcome.counts_equal {
        outcome.faults.push(format!("drawn, outside, facing away, invalid: {got:?} are not {want:?}"));
    }
}

fn colors(outcome: &mut Outcome, case: &Case, picture: &Picture, expected: &reference::Picture) {
    let mut first = None;
    for (i, want) in expected.rgba.iter().enumerate() {
        let error = difference(picture.rgba[i], *want) / scale(expected.sensitivity[i]);
        if expected.ties[i] {
            outcome.off_ties += (error > case.bound) as usize;
        } else {
            if error > outcome.worst {
                first = Some(i);
            }
            outcome.worst = outcome.worst.max(error);
        }
    }
    if outcome.worst > case.bound {
        let i = first.unwrap_or_default();
        let at = (i as u32 % case.size[0], i as u32 / case.size[0]);
        let (got, want, error) = (picture.rgba[i], expected.rgba[i], outcome.worst);
        outcome.faults.push(format!("off by {error:.2e}: pixel {at:?} is {got:?}, not {want:?}"));
    }
    if outcome.off_ties > case.off_ties {
        outcome.faults.push(format!("{} ties are off, {} may be", outcome.off_ties, case.off_ties));
    }
}

fn depths(outcome: &mut Outcome, case: &Case, picture: &Picture, expected: &reference::Picture) {
    let Some(depths) = &picture.depth else {
        outcome.faults.push("no depth".into());
        return;
    };
    let view = case.take.view.right_handed();
    let mut worst: (f64, usize) = (0.0, 0);
    for (i, front) in expected.depth.iter().enumerate().filter(|(i, d)| d.is_finite() && !expected.ties[*i]) {
        // Standard depth is 1 − near / z and little more: its constant, above 1 with a finite far plane, is rounded by
        // 2⁻²⁴, the value below 1 by 2⁻²⁵.
        let step = match view.depth {
            DepthConvention::Reversed => 0.0,
            DepthConvention::Standard => 1.5 * front / view.near() / f64::from(1 << 24),
        };
        let error = (view.linear_depth(depths[i].into()) / front - 1.0).abs() / scale(expected.sensitivity[i]) - step;
        let error = if error.is_nan() { f64::INFINITY } else { error };
        if error > worst.0 {
            worst = (error, i);
        }
    }
    if worst.0 > case.depth_bound {
        let (error, i) = worst;
        let at = (i as u32 % case.size[0], i as u32 / case.size[0]);
        outcome.faults.push(format!("depth off by {error:.2e} of {} at {at:?}", expected.depth[i]));
    }
}
