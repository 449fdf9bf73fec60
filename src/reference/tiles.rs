//! The splats of a scene, tile by tile.

use glam::{DVec2, dvec2};

use super::bins::{Bins, TILE};
use super::bound::Bound;
use super::camera::Ray;
use super::fragment::{Fragment, fragment};
use super::splat::{Fate, Look, Setup, Splat};
use super::ties::{Tie, Ties};
use super::tiling::{self, Pixel};
use super::{Picture, Scene, fuzzy, groups, pixel};
use crate::technique::Blend;

/// Renders everything but eye-dome lighting: `factor` × `factor` samples a pixel of the scene, the mean of which is the
/// pixel. `setup` is the scene's with both sides `factor` times as long; `factor` divides [`TILE`].
///
/// Every tile of samples is folded into pixels as soon as it is finished: a thread holds the samples of one tile.
pub fn draw(scene: &Scene, setup: &Setup, factor: u32) -> Picture {
    let (width, height) = (scene.width, scene.height);
    let pixels = width as usize * height as usize;
    assert!(scene.host_depth.is_none_or(|d| d.len() == pixels), "one host depth a pixel");
    let bins = Bins::new(setup);
    let mut picture = tiling::picture(width, height, TILE / factor, |tile, area| {
        let area = area.map(|edge| edge * factor);
        let (numbers, tile) = (bins.tile(tile), Tile { setup, scene, area, factor });
        let samples = if setup.margin > 0.0 { tile.draw::<Tie>(numbers) } else { tile.draw::<()>(numbers) };
        fold(samples, area, factor)
    });
    picture.counts = bins.counts;
    picture
}

/// Pixels from the samples of an area, both row by row.
fn fold(samples: Vec<Pixel>, [x0, y0, x1, y1]: [u32; 4], factor: u32) -> Vec<Pixel> {
    if factor == 1 {
        return samples;
    }
    let factor = factor as usize;
    let (width, height) = ((x1 - x0) as usize, (y1 - y0) as usize);
    let mut block = Vec::with_capacity(factor * factor);
    let mut pixels = Vec::with_capacity(samples.len() / (factor * factor));
    for y in (0..height).step_by(factor) {
        for x in (0..width).step_by(factor) {
            block.clear();
            for row in y..y + factor {
                block.extend_from_slice(&samples[row * width + x..][..factor]);
            }
            pixels.push(Pixel::mean(&block));
        }
    }
    pixels
}

/// A tile and what it is made of.
pub struct Tile<'a> {
    pub setup: &'a Setup<'a>,
    pub scene: &'a Scene<'a>,
    /// x0, y0, x1, y1, the last two exclusive \[samples\].
    area: [u32; 4],
    /// Samples along a pixel's side.
    factor: u32,
}

/// A splat of a tile.
pub struct Entry {
    pub number: u32,
    pub splat: Splat,
    pub look: Look,
    /// Its layer; 0 for blends without layers.
    pub layer: u32,
    /// The only fragment, of a triangle.
    fragment: Option<Fragment>,
    /// x0, y0, x1, y1 within the tile, the last two exclusive \[samples\].
    area: [u32; 4],
}

impl Tile<'_> {
    fn draw<T: Ties>(&self, numbers: &[u32]) -> Vec<Pixel> {
        let mut splats = self.prepare(numbers);
        match self.scene.technique.blend {
            Blend::Opaque => pixel::opaque::<T>(self, &splats),
            Blend::TwoPass => pixel::two_pass::<T>(self, &splats),
            Blend::Fuzzy => fuzzy::draw::<T>(self, &splats),
            Blend::Groups => groups::draw::<T>(self, &mut splats),
        }
    }

    /// The splats of these numbers with the tile's samples that they may touch.
    fn prepare(&self, numbers: &[u32]) -> Vec<Entry> {
        let [x0, y0, x1, y1] = self.area;
        let grouped = self.scene.technique.blend == Blend::Groups;
        let layer = |number| if grouped { self.setup.layer(number) } else { 0 };
        let within = |bound: Bound| {
            let [left, top, right, bottom] = bound.pixels(&self.setup.camera);
            [left.max(x0), top.max(y0), right.min(x1), bottom.min(y1)]
        };
        let mut entries = Vec::with_capacity(numbers.len());
        for &number in numbers {
            match self.setup.item(number) {
                Fate::Drawn(splat, bound) | Fate::Away(Some((splat, bound))) => {
                    let look = self.setup.look(number, &splat);
                    let (layer, area) = (layer(number), within(bound));
                    entries.push(Entry { number, splat, look, layer, fragment: None, area });
                }
                Fate::Face(face, bound) => {
                    // Everything about it changes from pixel to pixel: an entry for each.
                    let [left, top, right, bottom] = within(bound);
                    let layer = layer(number);
                    for (x, y) in (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y))) {
                        if let Some((splat, look, fragment)) = face.fragment(self.setup, centre(x, y)) {
                            let area = [x, y, x + 1, y + 1];
                            entries.push(Entry { number, splat, look, layer, fragment: Some(fragment), area });
                        }
                    }
                }
                Fate::Invalid | Fate::Away(None) | Fate::Outside | Fate::NoFace => {}
            }
        }
        entries
    }

    /// A state for each sample, row by row, from the host's depth there.
    pub fn samples<S>(&self, new: impl Fn(f64) -> S) -> Vec<S> {
        let [x0, y0, x1, y1] = self.area;
        let state = |x: u32, y: u32| {
            let pixel = (y / self.factor) as usize * self.scene.width as usize + (x / self.factor) as usize;
            new(self.scene.host_depth.map_or(f64::INFINITY, |d| self.setup.camera.host_depth(d[pixel])))
        };
        (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))).map(|(x, y)| state(x, y)).collect()
    }

    /// Calls `f` for every fragment of these splats, splat by splat in the given order. Rays are cheaper computed than
    /// loaded: a sample's state is all that comes from memory.
    pub fn each<'e, T: Ties, S>(
        &self,
        samples: &mut [S],
        splats: &'e [Entry],
        f: impl Fn(&mut S, &'e Entry, Fragment),
    ) {
        let [x0, y0, x1, _] = self.area;
        for entry in splats {
            let [left, top, right, bottom] = entry.area;
            for y in top..bottom {
                let row = &mut samples[((y - y0) * (x1 - x0)) as usize..];
                for (x, state) in (left..right).zip(&mut row[(left - x0) as usize..(right - x0) as usize]) {
                    let at = centre(x, y);
                    let found = match entry.fragment {
                        None => fragment::<T>(self.setup, &entry.splat, at, &self.setup.camera.ray(at)),
                        only => only.filter(|f| T::KEPT || f.inside),
                    };
                    if let Some(fragment) = found {
                        f(state, entry, fragment);
                    }
                }
            }
        }
    }

    /// Finished samples from the states, given the ray of each.
    pub fn pixels<S>(&self, samples: &[S], mut finish: impl FnMut(&S, &Ray) -> Pixel) -> Vec<Pixel> {
        let [x0, y0, x1, y1] = self.area;
        let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| centre(x, y)));
        samples.iter().zip(places).map(|(state, at)| finish(state, &self.setup.camera.ray(at))).collect()
    }
}

/// Where a sample is.
fn centre(x: u32, y: u32) -> DVec2 {
    dvec2(x as f64 + 0.5, y as f64 + 0.5)
}
