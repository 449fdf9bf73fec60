//! Numerical stress: the device against the f64 reference where arithmetic is hard, as data that tests run and reports
//! show.
//!
//! # Where the bounds come from
//! A weight is w(u) = 2^(−4u²), so dw = 8 ln 2 · u w du, and u ≤ 1: relative to itself a weight changes by at most
//! 5.55 du. Where a splat's image is displaced by δ \[px\], du ≤ δ / R, R the footprint's smaller radius \[px\], which the
//! low-pass keeps at 1 px and more except within disks seen from the side. Coverage 2 Σw, while below 1, has Σw < ½ and so
//! changes by at most 2 · ½ · 5.55 δ; a colour Σwc / Σw by at most 5.55 δ times the largest |c − mean| ≤ 1: however many
//! splats meet, **5.55 δ** bounds every channel of a pixel with R ≥ 1 px. For the others the reference knows the slopes
//! ([`Picture::sensitivity`](crate::reference::Picture::sensitivity)), and their bound is larger by the same factor.
//!
//! δ is what f32 loses between a stored position and a fragment's offset; each case says how much that may be.

mod invariance;
mod lenses;
mod random;
mod run;
mod scenes;
mod splats;
mod sums;
mod viewports;

use std::sync::Arc;

use glam::DMat4;

use crate::load::PointCloud;
use crate::select::View;
use crate::style::Style;
use crate::technique::{Blend, Technique};

pub use random::random;
pub use run::{Outcome, draw, judge, reference, run};
pub use sums::heap_on_a_pixel;

/// Slope of log w at the rim, 8 ln 2: see above.
pub const STEEPEST: f64 = 8.0 * std::f64::consts::LN_2;

/// What the project promises of ordinary scenes, of the full range.
pub const TARGET: f64 = 1e-4;

/// One picture.
#[derive(Debug, Clone)]
pub struct Take {
    /// What.
    pub cloud: Arc<PointCloud>,
    /// Where it stands.
    pub transform: DMat4,
    /// From where.
    pub view: View,
    /// How it looks.
    pub style: Style,
    /// And how it is drawn.
    pub technique: Technique,
}

/// A second picture that the device must draw like the first.
#[derive(Debug, Clone)]
pub struct Twin {
    /// What is drawn.
    pub take: Take,
    /// How far a channel may be off between the two, at pixels that are no ties.
    pub bound: f64,
}

/// One thing that may go wrong.
#[derive(Debug, Clone)]
pub struct Case {
    /// What, unique in the suite.
    pub name: String,
    /// Which kind of stress.
    pub group: &'static str,
    /// Of the picture \[px\].
    pub size: [u32; 2],
    /// The picture.
    pub take: Take,
    /// How far a channel may be off the reference, of the full range, at pixels that are no ties.
    pub bound: f64,
    /// Where the bound comes from.
    pub why: &'static str,
    /// Ties that may be off further.
    pub off_ties: usize,
    /// Pixels that must show something, so that no blank picture passes.
    pub covered: usize,
    /// How far the depth may be off, relative to itself.
    pub depth_bound: f64,
    /// The same picture in another way.
    pub twin: Option<Twin>,
}

/// δ = 1.8·10⁻⁵ px.
const ORDINARY: &str = "the project's target, 1e-4: images displaced by 1.8e-5 px at most";

impl Case {
    /// An ordinary picture of 160 × 112 px under the project's target.
    fn new(group: &'static str, name: impl Into<String>, take: Take) -> Case {
        let size = [160, 112];
        let opaque = take.technique.blend == Blend::Opaque;
        let name = format!("{}, {}", name.into(), take.technique.blend);
        Case {
            name,
            group,
            size,
            take,
            // Without weights only decoding and division round.
            bound: if opaque { 1e-5 } else { TARGET },
            why: if opaque { "one splat's colour: decoding and division round by 1e-6" } else { ORDINARY },
            // 10⁻⁴ of the pixels; discs cut each other in lines, some four a pixel, where the nearer is rounding's.
            off_ties: if opaque { 8 } else { 2 },
            covered: 1000,
            depth_bound: 2e-5,
            twin: None,
        }
    }

    fn bound(mut self, bound: f64, why: &'static str) -> Case {
        (self.bound, self.why) = (bound, why);
        self
    }

    fn size(mut self, width: u32, height: u32) -> Case {
        self.size = [width, height];
        self
    }

    fn covered(mut self, pixels: usize) -> Case {
        self.covered = pixels;
        self
    }

    fn ties(mut self, off: usize) -> Case {
        self.off_ties = off;
        self
    }

    fn depth(mut self, bound: f64) -> Case {
        self.depth_bound = bound;
        self
    }

    fn twin(mut self, take: Take, bound: f64) -> Case {
        self.twin = Some(Twin { take, bound });
        self
    }
}

/// All of them, in the order of the report.
pub fn cases() -> Vec<Case> {
    [invariance::cases(), lenses::cases(), splats::cases(), sums::cases(), viewports::cases()].concat()
}
