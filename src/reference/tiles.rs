//! Binning into tiles, and the blends within one.

use glam::{DVec2, DVec3, dvec2};
use rayon::prelude::*;

use super::camera::Ray;
use super::fragment::{Fragment, fragment};
use super::shade::light;
use super::splat::{Fate, Setup, Splat};
use super::{Counts, Picture, Scene};
use crate::technique::Blend;

/// Side of a tile \[px\]: a footprint of 4 px falls into 1.3 tiles on average, and a tile's state stays in the L2 cache.
const TILE: u32 = 32;

/// Renders everything but eye-dome lighting.
pub fn draw(scene: &Scene, setup: &Setup) -> Picture {
    let (width, height) = (scene.width, scene.height);
    let pixels = width as usize * height as usize;
    assert!(scene.host_depth.is_none_or(|d| d.len() == pixels), "one host depth a pixel");
    let (bins, counts) = bin(setup);
    let columns = width.div_ceil(TILE);
    let tiles: Vec<Vec<Pixel>> = (0..bins.starts.len() - 1)
        .into_par_iter()
        .map(|tile| {
            let origin = [tile as u32 % columns * TILE, tile as u32 / columns * TILE];
            Tile::new(scene, setup, origin).draw(&bins.splats[bins.starts[tile]..bins.starts[tile + 1]])
        })
        .collect();

    let mut picture = Picture {
        width,
        height,
        rgba: vec![[0.0; 4]; pixels],
        depth: vec![f64::INFINITY; pixels],
        ties: vec![false; pixels],
        sensitivity: vec![0.0; pixels],
        counts,
    };
    for (tile, finished) in tiles.iter().enumerate() {
        let (x0, y0) = (tile as u32 % columns * TILE, tile as u32 / columns * TILE);
        let side = TILE.min(width - x0);
        for (i, pixel) in finished.iter().enumerate() {
            let (x, y) = (x0 + i as u32 % side, y0 + i as u32 / side);
            let at = y as usize * width as usize + x as usize;
            picture.rgba[at] = pixel.rgba;
            picture.depth[at] = pixel.depth;
            picture.ties[at] = pixel.tie;
            picture.sensitivity[at] = pixel.sensitivity;
        }
    }
    picture
}

/// Numbers of the splats that may touch each tile, in draw order.
struct Bins {
    /// First entry of each tile, and the end.
    starts: Vec<usize>,
    splats: Vec<u32>,
}

fn bin(setup: &Setup) -> (Bins, Counts) {
    let camera = &setup.camera;
    let (columns, rows) = (camera.width.div_ceil(TILE), camera.height.div_ceil(TILE));
    // Range of tiles and fate of every splat; an empty range has equal ends.
    let ranges: Vec<([u32; 4], u8)> = (0..setup.len())
        .into_par_iter()
        .with_min_len(1024)
        .map(|number| {
            let (bound, fate) = match setup.point(number) {
                Fate::Invalid => (None, 0),
                Fate::Away(ghost) => (ghost.filter(|_| setup.margin > 0.0).map(|g| g.1), 1),
                Fate::Outside => (None, 2),
                Fate::Drawn(_, bound) => (Some(bound), 3),
            };
            let tiles = bound.map_or([0; 4], |bound| {
                let [x0, y0, x1, y1] = bound.pixels(camera);
                if x0 >= x1 || y0 >= y1 {
                    return [0; 4];
                }
                [x0 / TILE, y0 / TILE, x1.div_ceil(TILE), y1.div_ceil(TILE)]
            });
            (tiles, fate)
        })
        .collect();

    let mut fates = [0u64; 4];
    let mut starts = vec![0usize; (columns * rows) as usize + 1];
    let each =
        |[x0, y0, x1, y1]: [u32; 4]| (y0..y1).flat_map(move |y| (x0..x1).map(move |x| (y * columns + x) as usize));
    for &(range, fate) in &ranges {
        fates[fate as usize] += 1;
        each(range).for_each(|tile| starts[tile + 1] += 1);
    }
    for tile in 1..starts.len() {
        starts[tile] += starts[tile - 1];
    }
    let mut next = starts.clone();
    let mut splats = vec![0; starts[starts.len() - 1]];
    for (number, &(range, _)) in ranges.iter().enumerate() {
        for tile in each(range) {
            splats[next[tile]] = number as u32;
            next[tile] += 1;
        }
    }
    let counts = Counts {
        submitted: setup.len() as u64,
        culled_invalid: fates[0],
        culled_cone: fates[1],
        culled_frustum: fates[2],
        drawn: fates[3],
    };
    (Bins { starts, splats }, counts)
}

/// A finished pixel.
struct Pixel {
    rgba: [f64; 4],
    depth: f64,
    tie: bool,
    sensitivity: f64,
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

/// A pixel under way.
#[derive(Clone, Copy)]
struct State {
    at: DVec2,
    ray: Ray,
    /// The host's depth and how far off rounding may be in it.
    host: f64,
    d_host: f64,
    /// Least z + ε (two-pass).
    limit: f64,
    /// Bounds of the same under rounding.
    low: Least,
    high: Least,
    /// Front depth.
    front: f64,
    /// The front's splat and whether it is sure (opaque).
    winner: u32,
    d_front: f64,
    winner_sure: bool,
    /// Σw, Σwc, Σwn.
    weight: f64,
    color: DVec3,
    normal: DVec3,
    /// Sum of the slopes of the weights.
    slope: f64,
    /// The front hides a fragment (two-pass); whether rounding may see one; whether it cannot but see one.
    hidden: bool,
    hidden_perhaps: bool,
    hidden_surely: bool,
    tie: bool,
}

struct Tile<'a> {
    setup: &'a Setup<'a>,
    scene: &'a Scene<'a>,
    /// x0, y0, x1, y1, the last two exclusive \[px\].
    area: [u32; 4],
    pixels: Vec<State>,
}

impl<'a> Tile<'a> {
    fn new(scene: &'a Scene<'a>, setup: &'a Setup<'a>, [x0, y0]: [u32; 2]) -> Tile<'a> {
        let area = [x0, y0, (x0 + TILE).min(scene.width), (y0 + TILE).min(scene.height)];
        let state = |x: u32, y: u32| {
            let at = dvec2(x as f64 + 0.5, y as f64 + 0.5);
            let host = scene
                .host_depth
                .map_or(f64::INFINITY, |d| setup.camera.host_depth(d[y as usize * scene.width as usize + x as usize]));
            State {
                at,
                ray: setup.camera.ray(at),
                host,
                d_host: if host.is_finite() { setup.margin * host.abs() } else { 0.0 },
                limit: f64::INFINITY,
                low: Least::NONE,
                high: Least::NONE,
                front: f64::INFINITY,
                winner: u32::MAX,
                d_front: 0.0,
                winner_sure: true,
                weight: 0.0,
                color: DVec3::ZERO,
                normal: DVec3::ZERO,
                slope: 0.0,
                hidden: false,
                hidden_perhaps: false,
                hidden_surely: false,
                tie: false,
            }
        };
        let pixels = (y0..area[3]).flat_map(|y| (x0..area[2]).map(move |x| (x, y))).map(|(x, y)| state(x, y)).collect();
        Tile { setup, scene, area, pixels }
    }

    fn draw(mut self, splats: &[u32]) -> Vec<Pixel> {
        if !splats.is_empty() {
            let splats = self.prepare(splats);
            let splats = splats.as_slice();
            match self.scene.technique.blend {
                Blend::Opaque => {
                    self.each(splats, State::nearest);
                    if self.setup.margin > 0.0 {
                        self.each(splats, State::nearest_ties);
                    }
                }
                Blend::TwoPass => {
                    self.each(splats, State::visibility);
                    self.each(splats, State::attributes);
                }
            }
        }
        let two_pass = self.scene.technique.blend == Blend::TwoPass;
        self.pixels.iter().map(|p| p.finish(two_pass, self.scene, self.setup.margin)).collect()
    }

    /// The splats of these numbers with the tile's pixels that they may touch.
    fn prepare(&self, numbers: &[u32]) -> Vec<Entry> {
        let [x0, y0, x1, y1] = self.area;
        let entry = |&number: &u32| match self.setup.point(number) {
            Fate::Drawn(splat, bound) | Fate::Away(Some((splat, bound))) => {
                let [left, top, right, bottom] = bound.pixels(&self.setup.camera);
                Some(Entry { number, splat, area: [left.max(x0), top.max(y0), right.min(x1), bottom.min(y1)] })
            }
            _ => None,
        };
        numbers.iter().filter_map(entry).collect()
    }

    /// Calls `f` for every fragment of these splats, splat by splat in the given order.
    fn each(&mut self, splats: &[Entry], f: impl Fn(&mut State, &Splat, u32, Fragment)) {
        let [x0, y0, x1, _] = self.area;
        for Entry { number, splat, area: [left, top, right, bottom] } in splats {
            for y in *top..*bottom {
                let row = ((y - y0) * (x1 - x0)) as usize;
                for state in &mut self.pixels[row..][(left - x0) as usize..(right - x0) as usize] {
                    if let Some(fragment) = fragment(self.setup, splat, state.at, &state.ray) {
                        f(state, splat, *number, fragment);
                    }
                }
            }
        }
    }
}

/// A splat of a tile.
struct Entry {
    number: u32,
    splat: Splat,
    /// x0, y0, x1, y1 within the tile, the last two exclusive \[px\].
    area: [u32; 4],
}

impl State {
    /// Opaque: the nearest; of equals the first.
    fn nearest(&mut self, splat: &Splat, number: u32, fragment: Fragment) {
        if fragment.inside && fragment.z <= self.host && fragment.z < self.front {
            self.front = fragment.z;
            self.d_front = fragment.dz;
            self.winner = number;
            self.winner_sure = fragment.sure;
            self.weight = 1.0;
            self.color = splat.color;
            self.normal = splat.n;
        }
    }

    /// Opaque: could another have won?
    fn nearest_ties(&mut self, _: &Splat, number: u32, fragment: Fragment) {
        let (nearest, farthest) = (fragment.z - fragment.dz, fragment.z + fragment.dz);
        self.tie |= if number == self.winner {
            !self.winner_sure || farthest > self.host - self.d_host
        } else {
            nearest <= self.host + self.d_host && nearest <= self.front + self.d_front
        };
    }

    /// Two-pass, first: the limit min (z + ε).
    fn visibility(&mut self, splat: &Splat, number: u32, fragment: Fragment) {
        let back = fragment.z + splat.epsilon;
        let d_back = fragment.dz + splat.d_epsilon;
        self.low.add(back - d_back, number);
        if fragment.sure {
            self.high.add(back + d_back, number);
        }
        if fragment.inside {
            self.limit = self.limit.min(back);
        }
    }

    /// Two-pass, second: sums over z ≤ min(host, limit).
    fn attributes(&mut self, splat: &Splat, number: u32, fragment: Fragment) {
        if fragment.inside && fragment.z <= self.limit.min(self.host) {
            self.front = self.front.min(fragment.z);
            self.weight += fragment.weight;
            self.color += fragment.weight * splat.color;
            self.normal += fragment.weight * splat.n;
            self.slope += fragment.slope;
        } else if fragment.inside {
            self.hidden = true;
        }
        // A splat never hides itself: both passes compute the same z, so only the others' limits count.
        let perhaps = fragment.z - fragment.dz <= self.high.without(number).min(self.host + self.d_host);
        let surely = fragment.sure && fragment.z + fragment.dz <= self.low.without(number).min(self.host - self.d_host);
        self.tie |= perhaps && !surely;
        self.hidden_perhaps |= !surely;
        self.hidden_surely |= fragment.sure && !perhaps;
    }

    fn finish(&self, two_pass: bool, scene: &Scene, margin: f64) -> Pixel {
        if self.weight == 0.0 {
            let tie = margin > 0.0 && self.tie;
            return Pixel { rgba: [0.0; 4], depth: f64::INFINITY, tie, sensitivity: 0.0 };
        }
        let (color, tie) =
            light(&scene.style.shading, self.color / self.weight, self.normal / self.weight, &self.ray, margin);
        // What a soft rim lets through is the background only where nothing lies behind.
        let alpha = if two_pass && !self.hidden { (2.0 * self.weight).min(1.0) } else { 1.0 };
        let color = color * alpha;
        let tie = tie || self.tie || two_pass && self.hidden_perhaps && !self.hidden_surely && self.weight < 0.5;
        // Coverage and premultiplied colour are 2 Σ; else a mean of colours from 0 to 1 moves by Σ dw |c − mean| / Σw.
        let sensitivity = if alpha < 1.0 { 2.0 * self.slope } else { self.slope / self.weight };
        let rgba = [color.x, color.y, color.z, alpha];
        Pixel { rgba, depth: self.front, tie: margin > 0.0 && tie, sensitivity }
    }
}
