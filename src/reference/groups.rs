//! Groups: one layer for each group of splats, in which one of them wins each pixel, then sums over the layers (Zhang,
//! Pajarola: Single-Pass Point Rendering and Transparent Shading, 2006, figs 5 and 7).
//!
//! The paper's tolerance is one for all, from the nearest layer's depth; here it is the least z + ε of the layers'
//! winners. Layers of groups that a tile has no splat of are left out: they would stay empty.

use super::Scene;
use super::fragment::Fragment;
use super::pixel::Sums;
use super::ties::{Doubt, Least, Range, Ties};
use super::tiles::{Entry, Tile};
use super::tiling::Pixel;
use crate::select::Slabs;
use crate::style::Voronoi;

pub const NO_GROUPS: &str = "the blend `groups` needs a cloud's groups: Groups::color makes them";

/// What decides within a layer: the least wins, of equals the first in draw order.
#[derive(Clone, Copy)]
pub enum Key {
    /// z
    Depth,
    /// z + min(ε, r) u
    Cones,
    /// Slab and u, as published: the greatest wins, so its negative.
    Slabs(Slabs),
}

impl Key {
    pub fn new(scene: &Scene) -> Key {
        // All clouds are asked, so that one without groups never passes.
        let overlapping = scene
            .instances
            .iter()
            .map(|i| i.flat.groups.as_ref().expect(NO_GROUPS))
            .fold(false, |o, g| o | g.overlapping);
        match scene.style.voronoi {
            Voronoi::Cones if overlapping => Key::Cones,
            Voronoi::Slabs if overlapping => {
                let drawn = scene.instances.iter().map(|i| (i.flat, i.transform));
                Key::Slabs(Slabs::new(scene.view, scene.style, drawn))
            }
            _ => Key::Depth,
        }
    }

    fn of(&self, entry: &Entry, fragment: &Fragment) -> f64 {
        match self {
            Key::Depth => fragment.z,
            Key::Cones => fragment.z + entry.look.epsilon.min(entry.splat.r) * fragment.u2.sqrt(),
            Key::Slabs(slabs) => -slabs.key(fragment.z, fragment.u2.sqrt()),
        }
    }

    /// Where rounding may have that.
    fn range(&self, entry: &Entry, fragment: &Fragment, margin: f64) -> Range {
        let (epsilon, r) = (entry.look.epsilon, entry.splat.r);
        let (height, d_height) = if epsilon < r { (epsilon, entry.look.d_epsilon) } else { (r, margin * r) };
        let &Fragment { z, dz, du, .. } = fragment;
        let u = fragment.u2.sqrt();
        match self {
            Key::Depth => Range::about(z, dz),
            Key::Cones => Range::about(z + height * u, dz + height * du + d_height * (u + du)),
            Key::Slabs(slabs) => {
                // The place in the range may be in the slab before or behind. The key itself is from 0 to 1 whatever
                // the number of slabs, a few roundings of 2⁻²⁴ off: in u that is so many times as much.
                let dz = dz + margin * (z.abs() + slabs.near.abs());
                let rounding = 0.25 * margin;
                Range { low: -slabs.key(z - dz, u - du) - rounding, high: -slabs.key(z + dz, u + du) + rounding }
            }
        }
    }
}

/// A pixel of a layer.
#[derive(Clone, Copy)]
struct Layer<'e> {
    winner: Option<(&'e Entry, Fragment)>,
    key: f64,
    /// Where rounding may have the key; this and the rest are not kept without ties.
    keys: Range,
    /// Least that the key of any other fragment may be.
    rival: f64,
    /// Least that the depth of any fragment may be.
    nearest: f64,
    /// Some fragment is there whatever rounding does.
    certain: bool,
}

impl<'e> Layer<'e> {
    const EMPTY: Layer<'static> = Layer {
        winner: None,
        key: f64::INFINITY,
        keys: Range::INFINITE,
        rival: f64::INFINITY,
        nearest: f64::INFINITY,
        certain: false,
    };

    fn add<T: Ties>(&mut self, entry: &'e Entry, fragment: Fragment, decides: &Key, margin: f64) {
        let key = decides.of(entry, &fragment);
        let wins = fragment.inside && (key < self.key || self.winner.is_none());
        if T::KEPT {
            let keys = decides.range(entry, &fragment, margin);
            self.rival = self.rival.min(if wins { self.keys.low } else { keys.low });
            self.keys = if wins { keys } else { self.keys };
            self.nearest = self.nearest.min(fragment.z - fragment.dz);
            self.certain |= fragment.sure;
        }
        if wins {
            self.winner = Some((entry, fragment));
            self.key = key;
        }
    }

    /// Rounding may have another winner, or none, or one where there is none.
    fn doubtful(&self) -> bool {
        self.winner.is_some_and(|(_, fragment)| !fragment.sure)
            || self.rival < f64::INFINITY && self.rival <= self.keys.high
    }
}

pub fn draw<T: Ties>(tile: &Tile, splats: &mut [Entry]) -> Vec<Pixel> {
    let Some(decides) = &tile.setup.key else { unreachable!("the setup of groups has a key") };
    let margin = tile.setup.margin;
    // Stable: each group's splats stay in draw order.
    splats.sort_by_key(|entry| entry.layer);
    let layers: Vec<Vec<Layer>> = splats
        .chunk_by(|a, b| a.layer == b.layer)
        .map(|group| {
            // Faces have no u.
            let decides = if group[0].layer == u32::MAX { &Key::Depth } else { decides };
            let mut layer = tile.samples(|_| Layer::EMPTY);
            tile.each::<T, _>(&mut layer, group, |pixel, entry, fragment| {
                pixel.add::<T>(entry, fragment, decides, margin);
            });
            layer
        })
        .collect();
    // The layers of one sample.
    let mut stack = Vec::with_capacity(layers.len());
    let hosts: Vec<(usize, f64)> = tile.samples(|host| host).into_iter().enumerate().collect();
    tile.pixels(&hosts, |&(sample, host), ray| {
        stack.clear();
        stack.extend(layers.iter().map(|layer| layer[sample]));
        let (sums, slope) = composite(&stack, host);
        let doubt = if T::KEPT { doubt(&stack, Range::host(host, margin)) } else { Doubt::default() };
        sums.finish(true, Doubt { slope, ..doubt }, ray, tile.scene, margin)
    })
}

/// Sums over the winners within the tolerance of the front, and the sum of their slopes.
fn composite(layers: &[Layer], host: f64) -> (Sums, f64) {
    let winners = || layers.iter().filter_map(|layer| layer.winner.as_ref());
    let limit = winners().fold(host, |limit, (entry, fragment)| limit.min(fragment.z + entry.look.epsilon));
    let (mut sums, mut slope) = (Sums::NONE, 0.0);
    for (entry, fragment) in winners() {
        if fragment.z <= limit {
            sums.front = sums.front.min(fragment.z);
            sums.add(entry, fragment);
            slope += fragment.slope;
        } else {
            sums.hidden = true;
        }
    }
    (sums, slope)
}

/// As two-pass, over the winners. Layers whose winner is uncertain make a tie, unless everything in them lies behind the
/// limit that the others set: then whoever wins is hidden, and sets no limit.
fn doubt(layers: &[Layer], host: Range) -> Doubt {
    let certain = || layers.iter().zip(0u32..).filter(|(layer, _)| !layer.doubtful());
    let (mut low, mut high) = (Least::NONE, Least::NONE);
    for (layer, number) in certain() {
        if let Some((entry, fragment)) = &layer.winner {
            let back = Range::about(fragment.z + entry.look.epsilon, fragment.dz + entry.look.d_epsilon);
            low.add(back.low, number);
            high.add(back.high, number);
        }
    }
    let mut doubt = Doubt::default();
    for layer in layers.iter().filter(|layer| layer.doubtful()) {
        let behind = layer.nearest > high.value.min(host.high);
        doubt.tie |= !behind;
        doubt.hidden_perhaps = true;
        doubt.hidden_surely |= behind && layer.certain;
    }
    for (layer, number) in certain() {
        let Some((_, fragment)) = &layer.winner else { continue };
        // A winner never hides itself, so only the others' limits count.
        let perhaps = fragment.z - fragment.dz <= high.without(number).min(host.high);
        let surely = fragment.z + fragment.dz <= low.without(number).min(host.low);
        doubt.tie |= perhaps && !surely;
        doubt.hidden_perhaps |= !surely;
        doubt.hidden_surely |= !perhaps;
    }
    doubt
}
