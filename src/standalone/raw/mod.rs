//! Ceilings: how many points and fragments a second a device can do at best, by size, primitive, vertex format and
//! attachments. A technique's rate means something beside the rate of the case that does no more than it must.
//!
//! Every case draws the same points as squares of whole pixels, evenly spread at random, transformed once: no disk, no
//! normal, no weight. What a picture must show is therefore known, and is compared pixel by pixel before a case is timed.

mod case;
mod rig;
mod scene;

pub use case::{Case, Color, Passes, Vertices, cases};
pub use scene::LARGEST;

use super::device::Standalone;
use crate::error::{Error, Result};
use rig::Rig;

/// How much is drawn, and how often.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Setup {
    /// Points of a case whose squares have up to 16 pixels; larger ones have fewer, for as many fragments. At least 1.
    pub points: u32,
    /// Of the picture \[px\]; each side at least [`LARGEST`] and at most 65,535.
    pub extent: [u32; 2],
    /// Rounds: in each, every case is timed once, so that a disturbance meets all of them.
    pub rounds: u32,
}

impl Setup {
    /// Points of a case.
    pub fn points(&self, case: &Case) -> u32 {
        let pixels = case.size as u64 * case.size as u64;
        (self.points as u64).min((16 * self.points as u64).div_ceil(pixels)) as u32
    }
}

/// Why a case was not timed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Untimed {
    /// The device cannot do it: what it lacks.
    Lacking(String),
    /// The picture was not the predicted one: how it differs.
    Wrong(String),
}

/// A case and its times.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The case.
    pub case: Case,
    /// Points drawn.
    pub points: u64,
    /// Fragments that the rasteriser makes of them, in all passes.
    pub fragments: u64,
    /// Fragments counted in the picture, where they are added up in floats: those of the last pass that are not hidden.
    pub counted: Option<u64>,
    /// The device's time of all passes \[ms\], clearing included: one a round, above zero.
    pub times: Result<Vec<f64>, Untimed>,
}

impl Measured {
    /// Points a second, round by round; empty if it was not timed.
    pub fn points_per_second(&self) -> Vec<f64> {
        self.rates(self.points)
    }

    /// Fragments a second, round by round; empty if it was not timed.
    pub fn fragments_per_second(&self) -> Vec<f64> {
        self.rates(self.fragments)
    }

    fn rates(&self, count: u64) -> Vec<f64> {
        self.times.iter().flatten().map(|ms| count as f64 * 1e3 / ms).collect()
    }
}

/// Draws every case once and compares its picture, then times all of them in turn, round by round. `progress` is told
/// how many frames of how many are done.
///
/// # Errors
/// [`Error::Unsupported`] on a device without timestamps, or of smaller pictures; what the driver refuses. A case that the
/// device cannot do or does wrong is no error: [`Untimed`] says so.
///
/// # Panics
/// If `setup` is not as its fields ask for, or a case not as its own.
pub fn measure(
    standalone: &Standalone,
    cases: &[Case],
    setup: &Setup,
    mut progress: impl FnMut(u64, u64),
) -> Result<Vec<Measured>> {
    assert!(setup.points > 0, "some points");
    assert!(
        setup.extent.iter().all(|side| (LARGEST..=65_535).contains(side)),
        "a picture that holds the largest square"
    );
    if !standalone.enabled.timestamps {
        return Err(Error::Unsupported("timing on a device without timestamps".into()));
    }
    let mut rig = Rig::new(standalone, setup)?;
    let all = cases.len() as u64 * (1 + setup.rounds as u64);
    let mut done = 0;
    let mut results = Vec::new();
    let mut drawn = Vec::new();
    for case in cases {
        let points = setup.points(case);
        let mut measured = Measured {
            case: *case,
            points: points as u64,
            fragments: points as u64 * (case.size as u64).pow(2) * case.draws(),
            counted: None,
            times: Ok(Vec::new()),
        };
        match rig.lacks(case) {
            Some(what) => {
                measured.times = Err(Untimed::Lacking(what));
                drawn.push(None);
            }
            None => {
                let ready = rig.ready(case)?;
                match rig.check(&ready)? {
                    Ok(counted) => measured.counted = counted,
                    Err(how) => measured.times = Err(Untimed::Wrong(how)),
                }
                drawn.push(Some(ready));
            }
        }
        results.push(measured);
        done += 1;
        progress(done, all);
    }
    for _ in 0..setup.rounds {
        for (measured, ready) in results.iter_mut().zip(&drawn) {
            if let (Ok(times), Some(ready)) = (&mut measured.times, ready) {
                times.push(rig.time(ready)?);
            }
            done += 1;
            progress(done, all);
        }
    }
    Ok(results)
}
