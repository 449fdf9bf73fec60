//! Whether rounding may decide otherwise at a pixel (see [`super::Picture::ties`]), and how much displaced splats change
//! there (see [`super::Picture::sensitivity`]). Nothing else depends on it, and
//! where nobody asks it is compiled away.

use super::fragment::Fragment;
use super::tiles::Entry;

/// What a pixel keeps for its tie: [`Tie`], or `()` for margin 0.
pub trait Ties: Copy + Default + Send {
    /// Whether anything is kept.
    const KEPT: bool;
    /// Opaque: this fragment is the nearest so far.
    fn won(&mut self, _: &Entry, _: &Fragment) {}
    /// Opaque, once the nearest is known at depth `front`: could another have won?
    fn nearest(&mut self, _: &Entry, _: &Fragment, _front: f64, _host: Depth) {}
    /// Two-pass, first pass.
    fn visibility(&mut self, _: &Entry, _: &Fragment) {}
    /// Two-pass, second pass.
    fn attributes(&mut self, _: &Entry, _: &Fragment, _host: Depth) {}
    /// Two-pass, second pass: this fragment is summed.
    fn summed(&mut self, _: &Fragment) {}
    /// Sum of the slopes of the summed fragments' weights \[1/px\].
    fn slope(&self) -> f64 {
        0.0
    }
    /// Whether it is one. `soft`: coverage is below 1 if no fragment is hidden.
    fn is_tie(&self, _soft: bool) -> bool {
        false
    }
}

impl Ties for () {
    const KEPT: bool = false;
}

/// A depth and how far off rounding may be in it.
#[derive(Clone, Copy)]
pub struct Depth {
    pub z: f64,
    pub dz: f64,
}

/// The smallest of some values, with the second for the question what it is without one splat.
#[derive(Clone, Copy)]
struct Least {
    value: f64,
    splat: u32,
    second: f64,
}

impl Least {
    const NONE: Least = Least { value: f64::INFINITY, splat: u32::MAX, second: f64::INFINITY };

    fn add(&mut self, value: f64, splat: u32) {
        if value < self.value {
            *self = Least { value, splat, second: self.value };
        } else if value < self.second {
            self.second = value;
        }
    }

    fn without(&self, splat: u32) -> f64 {
        if splat == self.splat { self.second } else { self.value }
    }
}

/// The evidence for a tie.
#[derive(Clone, Copy)]
pub struct Tie {
    /// Bounds of the limit min (z + ε) under rounding (two-pass).
    low: Least,
    high: Least,
    /// The front's splat and whether it is sure (opaque).
    winner: u32,
    d_front: f64,
    winner_sure: bool,
    /// Rounding may see a hidden fragment (two-pass); cannot but see one.
    hidden_perhaps: bool,
    hidden_surely: bool,
    tie: bool,
    slope: f64,
}

impl Default for Tie {
    fn default() -> Tie {
        Tie {
            low: Least::NONE,
            high: Least::NONE,
            winner: u32::MAX,
            d_front: 0.0,
            winner_sure: true,
            hidden_perhaps: false,
            hidden_surely: false,
            tie: false,
            slope: 0.0,
        }
    }
}

impl Ties for Tie {
    const KEPT: bool = true;

    fn won(&mut self, entry: &Entry, fragment: &Fragment) {
        self.d_front = fragment.dz;
        self.winner = entry.number;
        self.winner_sure = fragment.sure;
    }

    fn nearest(&mut self, entry: &Entry, fragment: &Fragment, front: f64, host: Depth) {
        let (nearest, farthest) = (fragment.z - fragment.dz, fragment.z + fragment.dz);
        self.tie |= if entry.number == self.winner {
            !self.winner_sure || farthest > host.z - host.dz
        } else {
            nearest <= host.z + host.dz && nearest <= front + self.d_front
        };
    }

    fn visibility(&mut self, entry: &Entry, fragment: &Fragment) {
        let back = fragment.z + entry.look.epsilon;
        let d_back = fragment.dz + entry.look.d_epsilon;
        self.low.add(back - d_back, entry.number);
        if fragment.sure {
            self.high.add(back + d_back, entry.number);
        }
    }

    /// A splat never hides itself: both passes compute the same z, so only the others' limits count.
    fn attributes(&mut self, entry: &Entry, fragment: &Fragment, host: Depth) {
        let (high, low) = (self.high.without(entry.number), self.low.without(entry.number));
        let perhaps = fragment.z - fragment.dz <= high.min(host.z + host.dz);
        let surely = fragment.sure && fragment.z + fragment.dz <= low.min(host.z - host.dz);
        self.tie |= perhaps && !surely;
        self.hidden_perhaps |= !surely;
        self.hidden_surely |= fragment.sure && !perhaps;
    }

    fn summed(&mut self, fragment: &Fragment) {
        self.slope += fragment.slope;
    }

    fn slope(&self) -> f64 {
        self.slope
    }

    fn is_tie(&self, soft: bool) -> bool {
        self.tie || soft && self.hidden_perhaps && !self.hidden_surely
    }
}
