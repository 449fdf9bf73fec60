//! Opaque and two-pass, at one pixel, and how every blend's sums become a pixel.

use glam::DVec3;

use super::Scene;
use super::camera::Ray;
use super::fragment::Fragment;
use super::shade::light;
use super::ties::{Doubt, Range, Ties};
use super::tiles::{Entry, Tile};
use super::tiling::Pixel;

/// What the fragments that count add up to.
#[derive(Clone, Copy)]
pub struct Sums {
    /// Front depth.
    pub front: f64,
    /// Σw, Σwc, Σwn.
    pub weight: f64,
    pub color: DVec3,
    pub normal: DVec3,
    /// The front hides a fragment.
    pub hidden: bool,
}

impl Sums {
    pub const NONE: Sums =
        Sums { front: f64::INFINITY, weight: 0.0, color: DVec3::ZERO, normal: DVec3::ZERO, hidden: false };

    /// One more fragment; the front's depth and what is hidden are the blend's.
    pub fn add(&mut self, entry: &Entry, fragment: &Fragment) {
        let weight = fragment.weight();
        self.weight += weight;
        self.color += weight * entry.look.color;
        self.normal += weight * entry.splat.n;
    }

    /// `soft`: coverage is min(1, 2 Σw) where nothing is hidden, else 1.
    pub fn finish(&self, soft: bool, doubt: Doubt, ray: &Ray, scene: &Scene, margin: f64) -> Pixel {
        if self.weight == 0.0 {
            return Pixel { tie: doubt.is_tie(false), ..Pixel::EMPTY };
        }
        let (color, tie) =
            light(&scene.style.shading, self.color / self.weight, self.normal / self.weight, ray, margin);
        // What a soft rim lets through is the background only where nothing lies behind.
        let alpha = if soft && !self.hidden { (2.0 * self.weight).min(1.0) } else { 1.0 };
        let color = color * alpha;
        let tie = tie || doubt.is_tie(soft && self.weight < 0.5);
        // Coverage and premultiplied colour are 2 Σ; else a mean of colours from 0 to 1 moves by Σ dw |c − mean| / Σw.
        let sensitivity = if alpha < 1.0 { 2.0 * doubt.slope } else { doubt.slope / self.weight };
        Pixel { rgba: [color.x, color.y, color.z, alpha], depth: self.front, tie, sensitivity }
    }
}

/// A pixel under way.
#[derive(Clone, Copy)]
struct State<T> {
    /// The host's depth.
    host: f64,
    /// Least z + ε (two-pass).
    limit: f64,
    sums: Sums,
    ties: T,
}

/// The nearest fragment alone.
pub fn opaque<T: Ties>(tile: &Tile, splats: &[Entry]) -> Vec<Pixel> {
    let margin = tile.setup.margin;
    let mut samples = tile.samples(State::<T>::new);
    tile.each::<T, _>(&mut samples, splats, State::nearest);
    if T::KEPT {
        tile.each::<T, _>(&mut samples, splats, |state, entry, fragment| state.nearest_ties(entry, &fragment, margin));
    }
    tile.pixels(&samples, |state, ray| state.sums.finish(false, state.ties.doubt(), ray, tile.scene, margin))
}

/// Visibility, then sums.
pub fn two_pass<T: Ties>(tile: &Tile, splats: &[Entry]) -> Vec<Pixel> {
    let margin = tile.setup.margin;
    let mut samples = tile.samples(State::<T>::new);
    tile.each::<T, _>(&mut samples, splats, State::visibility);
    tile.each::<T, _>(&mut samples, splats, |state, entry, fragment| state.attributes(entry, &fragment, margin));
    tile.pixels(&samples, |state, ray| state.sums.finish(true, state.ties.doubt(), ray, tile.scene, margin))
}

impl<T: Ties> State<T> {
    fn new(host: f64) -> State<T> {
        State { host, limit: f64::INFINITY, sums: Sums::NONE, ties: T::default() }
    }

    /// Opaque: the nearest; of equals the first.
    fn nearest(&mut self, entry: &Entry, fragment: Fragment) {
        if fragment.inside && fragment.z <= self.host && fragment.z < self.sums.front {
            self.sums.front = fragment.z;
            self.sums.weight = 1.0;
            self.sums.color = entry.look.color;
            self.sums.normal = entry.splat.n;
            self.ties.won(entry, &fragment);
        }
    }

    /// Opaque, afterwards: only for ties.
    fn nearest_ties(&mut self, entry: &Entry, fragment: &Fragment, margin: f64) {
        self.ties.nearest(entry, fragment, self.sums.front, Range::host(self.host, margin));
    }

    /// Two-pass, first: the limit min (z + ε).
    fn visibility(&mut self, entry: &Entry, fragment: Fragment) {
        if fragment.inside {
            self.limit = self.limit.min(fragment.z + entry.look.epsilon);
        }
        self.ties.visibility(entry, &fragment);
    }

    /// Two-pass, second: sums over z ≤ min(host, limit).
    fn attributes(&mut self, entry: &Entry, fragment: &Fragment, margin: f64) {
        if fragment.inside && fragment.z <= self.limit.min(self.host) {
            self.sums.front = self.sums.front.min(fragment.z);
            self.sums.add(entry, fragment);
            self.ties.summed(fragment);
        } else if fragment.inside {
            self.sums.hidden = true;
        }
        self.ties.attributes(entry, fragment, Range::host(self.host, margin));
    }
}
