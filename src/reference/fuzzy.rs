//! Fuzzy: depth test and blending in one pass, a fragment at a time in draw order (Dachsbacher, Vogelgsang, Stamminger:
//! Sequential Point Trees, 2003, section 5).
//!
//! The paper has one tolerance for all. Here each splat has its own: where a fragment replaces what is there it is the
//! incoming splat's, where it is tested against the front it is the front's. So a fragment in front of a pixel's others,
//! or behind them, is judged as two-pass would: by the ε of the nearer.

use super::fragment::Fragment;
use super::pixel::Sums;
use super::ties::{Doubt, Range, Ties};
use super::tiles::{Entry, Tile};
use super::tiling::Pixel;
use crate::style::Front;

/// A pixel under way.
#[derive(Clone, Copy)]
struct State {
    host: f64,
    /// The front's z + ε, or the host's depth: what lies behind it is not there.
    limit: f64,
    /// With zd as the front.
    sums: Sums,
    /// Where rounding may have zd and the limit; not kept without ties.
    fronts: Range,
    limits: Range,
    doubt: Doubt,
}

pub fn draw<T: Ties>(tile: &Tile, splats: &[Entry]) -> Vec<Pixel> {
    let (margin, front) = (tile.setup.margin, tile.scene.style.front);
    let mut samples = tile.samples(|host| State {
        host,
        limit: host,
        sums: Sums::NONE,
        fronts: Range::INFINITE,
        limits: Range::host(host, margin),
        doubt: Doubt::default(),
    });
    tile.each::<T, _>(&mut samples, splats, |state, entry, fragment| {
        if T::KEPT {
            state.doubt(entry, &fragment, front, Range::host(state.host, margin));
        }
        if fragment.inside {
            state.add(entry, &fragment, front);
        }
    });
    tile.pixels(&samples, |state, ray| state.sums.finish(true, state.doubt, ray, tile.scene, margin))
}

impl State {
    fn add(&mut self, entry: &Entry, fragment: &Fragment, front: Front) {
        let (z, back) = (fragment.z, fragment.z + entry.look.epsilon);
        if z > self.limit {
            self.sums.hidden = true;
            return;
        }
        if back < self.sums.front {
            let hidden = self.sums.hidden || self.sums.weight > 0.0;
            self.sums = Sums { front: z, hidden, ..Sums::NONE };
            self.limit = self.host.min(back);
            self.doubt.slope = 0.0;
        } else if front == Front::Nearest {
            self.sums.front = self.sums.front.min(z);
            self.limit = self.limit.min(back);
        }
        self.sums.add(entry, fragment);
        self.doubt.slope += fragment.slope;
    }

    /// What a fragment may do in any state that rounding may have led to: where that is more than one thing the pixel is a
    /// tie, and the ranges are those of all. A fragment that replaces whatever is there ends the doubt about it: what
    /// follows depends on nothing before but whether anything was hidden.
    fn doubt(&mut self, entry: &Entry, fragment: &Fragment, front: Front, host: Range) {
        let z = Range::about(fragment.z, fragment.dz);
        let back = Range::about(fragment.z + entry.look.epsilon, fragment.dz + entry.look.d_epsilon);
        let (fronts, limits) = (self.fronts, self.limits);
        let rejected = z.high > limits.low;
        let accepted = z.low <= limits.high;
        let replaces = accepted && back.low < fronts.high;
        let joins = accepted && back.high >= fronts.low;

        let (there_perhaps, there_surely) = (fronts.low < f64::INFINITY, fronts.high < f64::INFINITY);
        self.doubt.hidden_perhaps |= rejected || replaces && there_perhaps;
        self.doubt.hidden_surely |= fragment.sure && !joins && (!replaces || there_surely);

        let stays = rejected || !fragment.sure;
        let replaced = (z, host.min(back));
        let joined = if front == Front::Nearest { (fronts.min(z), limits.min(back)) } else { (fronts, limits) };
        (self.fronts, self.limits) = match (stays, replaces, joins) {
            (true, false, false) => (fronts, limits),
            (false, true, false) => {
                self.doubt.tie = false;
                replaced
            }
            (false, false, true) => joined,
            _ => {
                self.doubt.tie = true;
                [(stays, (fronts, limits)), (replaces, replaced), (joins, joined)]
                    .into_iter()
                    .filter_map(|(may, ranges)| may.then_some(ranges))
                    .reduce(|a, b| (a.0.or(b.0), a.1.or(b.1)))
                    .unwrap_or((fronts, limits))
            }
        };
    }
}
