//! The blends, at one pixel.

use glam::DVec3;

use super::Scene;
use super::camera::Ray;
use super::fragment::Fragment;
use super::shade::light;
use super::ties::{Depth, Ties};
use super::tiles::Entry;
use super::tiling::Pixel;

/// A pixel under way.
#[derive(Clone, Copy)]
pub struct State<T> {
    /// The host's depth.
    host: f64,
    /// Least z + ε (two-pass).
    limit: f64,
    /// Front depth.
    front: f64,
    /// Σw, Σwc, Σwn.
    weight: f64,
    color: DVec3,
    normal: DVec3,
    /// The front hides a fragment (two-pass).
    hidden: bool,
    ties: T,
}

impl<T: Ties> State<T> {
    pub fn new(host: f64) -> State<T> {
        State {
            host,
            limit: f64::INFINITY,
            front: f64::INFINITY,
            weight: 0.0,
            color: DVec3::ZERO,
            normal: DVec3::ZERO,
            hidden: false,
            ties: T::default(),
        }
    }

    fn host(&self, margin: f64) -> Depth {
        Depth { z: self.host, dz: if self.host.is_finite() { margin * self.host.abs() } else { 0.0 } }
    }

    /// Opaque: the nearest; of equals the first.
    pub fn nearest(&mut self, entry: &Entry, fragment: Fragment) {
        if fragment.inside && fragment.z <= self.host && fragment.z < self.front {
            self.front = fragment.z;
            self.weight = 1.0;
            self.color = entry.look.color;
            self.normal = entry.splat.n;
            self.ties.won(entry, &fragment);
        }
    }

    /// Opaque, afterwards: only for ties.
    pub fn nearest_ties(&mut self, entry: &Entry, fragment: Fragment, margin: f64) {
        let (front, host) = (self.front, self.host(margin));
        self.ties.nearest(entry, &fragment, front, host);
    }

    /// Two-pass, first: the limit min (z + ε).
    pub fn visibility(&mut self, entry: &Entry, fragment: Fragment) {
        if fragment.inside {
            self.limit = self.limit.min(fragment.z + entry.look.epsilon);
        }
        self.ties.visibility(entry, &fragment);
    }

    /// Two-pass, second: sums over z ≤ min(host, limit).
    pub fn attributes(&mut self, entry: &Entry, fragment: Fragment, margin: f64) {
        if fragment.inside && fragment.z <= self.limit.min(self.host) {
            let weight = fragment.weight();
            self.front = self.front.min(fragment.z);
            self.weight += weight;
            self.color += weight * entry.look.color;
            self.normal += weight * entry.splat.n;
            self.ties.summed(&fragment);
        } else if fragment.inside {
            self.hidden = true;
        }
        let host = self.host(margin);
        self.ties.attributes(entry, &fragment, host);
    }

    pub fn finish(&self, two_pass: bool, ray: &Ray, scene: &Scene, margin: f64) -> Pixel {
        if self.weight == 0.0 {
            return Pixel { tie: self.ties.is_tie(false), ..Pixel::EMPTY };
        }
        let (color, tie) =
            light(&scene.style.shading, self.color / self.weight, self.normal / self.weight, ray, margin);
        // What a soft rim lets through is the background only where nothing lies behind.
        let alpha = if two_pass && !self.hidden { (2.0 * self.weight).min(1.0) } else { 1.0 };
        let color = color * alpha;
        let tie = T::KEPT && tie || self.ties.is_tie(two_pass && self.weight < 0.5);
        // Coverage and premultiplied colour are 2 Σ; else a mean of colours from 0 to 1 moves by Σ dw |c − mean| / Σw.
        let sensitivity = if alpha < 1.0 { 2.0 * self.ties.slope() } else { self.ties.slope() / self.weight };
        Pixel { rgba: [color.x, color.y, color.z, alpha], depth: self.front, tie, sensitivity }
    }
}
