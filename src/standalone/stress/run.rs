//! Draws a case and judges it.

use std::sync::Arc;

use ash::vk;

use super::{Case, STEEPEST, Take};
use crate::error::Result;
use crate::host::Instance;
use crate::readback::Picture;
use crate::reference::{self, MARGIN_F32};
use crate::select::{DepthConvention, DrawList, Sight, cut};
use crate::standalone::{Offscreen, Shot};
use crate::stats::FrameStats;
use crate::structure::groups::{Groups, Relax};
use crate::structure::{Cloud, Flat};
use crate::technique::Blend;

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
    let (picture, stats) = shoot(off, case, &case.take, true)?;
    let (again, _) = shoot(off, case, &case.take, false)?;
    let expected = reference(case)?;
    let mut outcome = judge(case, &picture, &expected);
    count(&mut outcome, &stats, &expected.counts);
    if bytes(&picture) != bytes(&again) {
        outcome.faults.push("two runs differ".into());
    }
    if let Some(twin) = &case.twin {
        let (other, _) = shoot(off, case, &twin.take, false)?;
        let sure = (0..picture.rgba.len()).filter(|i| !expected.ties[*i]);
        let error =
            |i: usize| difference(picture.rgba[i], other.rgba[i].map(f64::from)) / scale(expected.sensitivity[i]);
        let worst = sure.map(error).fold(0.0, f64::max);
        outcome.worst_twin = Some(worst);
        if worst > twin.bound {
            outcome.faults.push(format!("off its twin by {worst:.2e}, {:.2e} may be", twin.bound));
        }
    }
    Ok(outcome)
}

/// The device's picture of a case; `off` takes the case's size.
pub fn draw(off: &mut Offscreen, case: &Case) -> Result<Picture> {
    Ok(shoot(off, case, &case.take, false)?.0)
}

/// The reference's picture of a case, with the ties of f32.
pub fn reference(case: &Case) -> Result<reference::Picture> {
    let (take, [width, height]) = (&case.take, case.size);
    let flat = Arc::new(flat(take)?);
    let mut list = DrawList::default();
    let sight = Sight::new(&take.view, case.size, &take.transform, flat.origin, &take.style);
    cut::cut(&Cloud::Flat(Arc::clone(&flat)), &sight, &take.style, false, 0, &mut list);
    let scene = reference::Scene {
        instances: &[reference::Instance::points(&flat, take.transform)],
        list: &list,
        view: &take.view,
        width,
        height,
        technique: take.technique,
        style: &take.style,
        host_depth: None,
    };
    Ok(reference::render(&scene, MARGIN_F32))
}

/// Compares a picture with what is expected; counts and twin are left to [`run`].
pub fn judge(case: &Case, picture: &Picture, expected: &reference::Picture) -> Outcome {
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
    if outcome.pixels < case.covered {
        outcome.faults.push(format!("only {} pixels show anything", outcome.pixels));
    }
    colors(&mut outcome, case, picture, expected);
    depths(&mut outcome, case, picture, expected);
    bytes_shown(&mut outcome, case, picture, expected);
    outcome
}

fn shoot(off: &mut Offscreen, case: &Case, take: &Take, count: bool) -> Result<(Picture, FrameStats)> {
    let [width, height] = case.size;
    off.resize(vk::Extent2D { width, height })?;
    let cloud = off.renderer.add(Arc::new(flat(take)?))?;
    let instances = [Instance { cloud, transform: take.transform }];
    let shot = Shot { view: &take.view, instances: &instances, technique: take.technique, style: &take.style, count };
    let drawn = off.draw(&shot).and_then(|(stats, _)| Ok((off.read()?, stats)));
    off.renderer.remove(cloud);
    drawn
}

/// The points of a take, with groups where its blend needs them.
fn flat(take: &Take) -> Result<Flat> {
    let mut flat = Flat::new(&take.cloud);
    if take.technique.blend == Blend::Groups {
        flat.groups = Some(Groups::color(&flat, &Relax::default())?);
    }
    Ok(flat)
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
        // Orthographic depth has steps of the whole range, wherever it is.
        let step = match view.depth {
            _ if !view.is_perspective() => 2.0 * (view.far() - view.near()) / front.abs() / f64::from(1 << 24),
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

/// What ships: 8-bit sRGB over black within one step, wherever float light is within 3·10⁻⁴ (12.92 · 255 · 3·10⁻⁴ < 1, which
/// rounding makes one step at most).
fn bytes_shown(outcome: &mut Outcome, case: &Case, picture: &Picture, expected: &reference::Picture) {
    if case.bound > 3e-4 {
        return;
    }
    let rgba = expected.rgba.iter().map(|p| p.map(|v| v as f32)).collect();
    let want = Picture { rgba, depth: None, ..*picture };
    let (got, want) = (picture.encode([0, 0, 0, 255]), want.encode([0, 0, 0, 255]));
    let sure = |i: &usize| !expected.ties[*i] && case.bound * scale(expected.sensitivity[*i]) <= 3e-4;
    let step = |i: usize| (4 * i..4 * i + 4).map(|k| got[k].abs_diff(want[k])).max().unwrap_or_default();
    if let Some(i) = (0..expected.rgba.len()).filter(sure).find(|i| step(*i) > 1) {
        let at = (i as u32 % case.size[0], i as u32 / case.size[0]);
        outcome.faults.push(format!("off by {} of 255 at {at:?}", step(i)));
    }
}
