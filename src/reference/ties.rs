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
    fn nearest(&mut self, _: &Entry, _: &Fragment, _front: f64, _host: Range) {}
    /// Two-pass, first pass.
    fn visibility(&mut self, _: &Entry, _: &Fragment) {}
    /// Two-pass, second pass.
    fn attributes(&mut self, _: &Entry, _: &Fragment, _host: Range) {}
    /// Two-pass, second pass: this fragment is summed.
    fn summed(&mut self, _: &Fragment) {}
    /// What came of it.
    fn doubt(&self) -> Doubt {
        Doubt::default()
    }
}

impl Ties for () {
    const KEPT: bool = false;
}

/// What rounding leaves open at a pixel.
#[derive(Clone, Copy, Default)]
pub struct Doubt {
    /// It may decide otherwise about what is summed.
    pub tie: bool,
    /// It may see a hidden fragment.
    pub hidden_perhaps: bool,
    /// It cannot but see one.
    pub hidden_surely: bool,
    /// Sum of the slopes of the summed fragments' weights \[1/px\].
    pub slope: f64,
}

impl Doubt {
    /// Whether the pixel is a tie. `soft`: coverage is below 1 if no fragment is hidden.
    pub fn is_tie(&self, soft: bool) -> bool {
        self.tie || soft && self.hidden_perhaps && !self.hidden_surely
    }
}

/// Where rounding may put a value.
#[derive(Clone, Copy, PartialEq)]
pub struct Range {
    pub low: f64,
    pub high: f64,
}

impl Range {
    pub const INFINITE: Range = Range { low: f64::INFINITY, high: f64::INFINITY };

    pub fn about(value: f64, error: f64) -> Range {
        Range { low: value - error, high: value + error }
    }

    /// Of the host's depth.
    pub fn host(depth: f64, margin: f64) -> Range {
        if depth.is_finite() { Range::about(depth, margin * depth.abs()) } else { Range { low: depth, high: depth } }
    }

    /// Of the lesser of the two values.
    pub fn min(self, other: Range) -> Range {
        Range { low: self.low.min(other.low), high: self.high.min(other.high) }
    }

    /// Of a value that is the one or the other.
    pub fn or(self, other: Range) -> Range {
        Range { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

/// The smallest of some values, with the second for the question what it is without one of them.
#[derive(Clone, Copy)]
pub struct Least {
    pub value: f64,
    /// Whose it is: a splat's number, or a layer's.
    of: u32,
    second: f64,
}

impl Least {
    pub const NONE: Least = Least { value: f64::INFINITY, of: u32::MAX, second: f64::INFINITY };

    pub fn add(&mut self, value: f64, of: u32) {
        if value < self.value {
            *self = Least { value, of, second: self.value };
        } else if value < self.second {
            self.second = value;
        }
    }

    pub fn without(&self, of: u32) -> f64 {
        if of == self.of { self.second } else { self.value }
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
    doubt: Doubt,
}

impl Default for Tie {
    fn default() -> Tie {
        Tie {
            low: Least::NONE,
            high: Least::NONE,
            winner: u32::MAX,
            d_front: 0.0,
            winner_sure: true,
            doubt: Doubt::default(),
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

    fn nearest(&mut self, entry: &Entry, fragment: &Fragment, front: f64, host: Range) {
        let (nearest, farthest) = (fragment.z - fragment.dz, fragment.z + fragment.dz);
        self.doubt.tie |= if entry.number == self.winner {
            !self.winner_sure || farthest > host.low
        } else {
            nearest <= host.high && nearest <= front + self.d_front
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
    fn attributes(&mut self, entry: &Entry, fragment: &Fragment, host: Range) {
        let (high, low) = (self.high.without(entry.number), self.low.without(entry.number));
        let perhaps = fragment.z - fragment.dz <= high.min(host.high);
        let surely = fragment.sure && fragment.z + fragment.dz <= low.min(host.low);
        self.doubt.tie |= perhaps && !surely;
        self.doubt.hidden_perhaps |= !surely;
        self.doubt.hidden_surely |= fragment.sure && !perhaps;
    }

    fn summed(&mut self, fragment: &Fragment) {
        self.doubt.slope += fragment.slope;
    }

    fn doubt(&self) -> Doubt {
        self.doubt
    }
}
