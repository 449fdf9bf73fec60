//! Positions in steps of the box of their run.

use std::ops::Range;

use glam::Vec3;

use super::{Frame, GRAIN, RUN, Radii, Streams, narrow_normal, rgb};
use crate::par;
use crate::structure::flat::is_splat;
use crate::structure::{Flat, octahedral};

/// 8 B a point, 9 B with both normals and colours, and 16 B a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantised {
    /// 30 bits of the position; with normals and colours the highest two of the colour on top.
    places: Vec<u32>,
    /// With normals and colours 16 bits of the normal, and 16 of the colour's 18 on top. Else the normal or the colour, and the
    /// radius' code on top.
    words: Vec<u32>,
    /// With normals and colours: the radii's codes.
    codes: Option<Vec<u8>>,
    frames: Vec<Frame>,
    normals: bool,
    colors: bool,
    radii: Radii,
}

/// The nearest of 64 values of a channel.
pub(super) fn six_bits(channel: u8) -> u32 {
    (channel as u32 * 63 + 127) / 255
}

/// Six bits as a byte: from 0 to 255.
pub(super) fn eight_bits(value: u32) -> u8 {
    let value = value & 63;
    (value << 2 | value >> 4) as u8
}

impl Quantised {
    /// What cannot be drawn gets no radius, and no say in the box of its run.
    pub(super) fn pack(full: &Flat) -> Quantised {
        let n = full.len();
        let (normals, colors) = (full.has_normals(), full.has_colors());
        let both = normals && colors;
        let splats = full.geometry.iter().filter(|g| is_splat(g));
        let radii = Radii::of(splats.map(|g| g[3]));
        let code = |i: usize| {
            let g = &full.geometry[i];
            if is_splat(g) { radii.encode(g[3]) } else { 0 }
        };
        let place = |&[x, y, z, _]: &[f32; 4]| Vec3::new(x, y, z);
        let runs: Vec<&[[f32; 4]]> = full.geometry.chunks(RUN).collect();
        let frames = par::map(&runs, |run| Frame::around(run.iter().filter(|g| is_splat(g)).map(place)));
        let color = |i: usize| {
            let [r, g, b] = rgb(full, i).map(six_bits);
            r | g << 6 | b << 12
        };
        let mut places = vec![0; n];
        par::fill(&mut places, GRAIN, |first, part| {
            for (i, word) in (first..).zip(part) {
                let g = &full.geometry[i];
                *word = if is_splat(g) { frames[i / RUN].encode(place(g)) } else { 0 };
                *word |= if both { color(i) >> 16 << 30 } else { 0 };
            }
        });
        let mut words = vec![0; n];
        par::fill(&mut words, GRAIN, |first, part| {
            for (i, word) in (first..).zip(part) {
                *word = if both {
                    narrow_normal(full, i) as u32 | color(i) << 16
                } else if normals {
                    narrow_normal(full, i) as u32 | (code(i) as u32) << 24
                } else {
                    let [r, g, b] = rgb(full, i);
                    u32::from_le_bytes([r, g, b, code(i)])
                };
            }
        });
        let codes = both.then(|| (0..n).map(code).collect());
        Quantised { places, words, codes, frames, normals, colors, radii }
    }

    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    pub(super) fn point(&self, i: usize) -> [f32; 4] {
        let [x, y, z] = self.frames[i / RUN].decode(self.places[i]);
        let code = self.codes.as_ref().map_or((self.words[i] >> 24) as u8, |codes| codes[i]);
        [x, y, z, self.radii.decode(code)]
    }

    pub(super) fn normal(&self, i: usize) -> u32 {
        if self.normals { octahedral::widen(self.words[i] as u16) } else { octahedral::NONE }
    }

    pub(super) fn color(&self, i: usize) -> Option<[u8; 3]> {
        let word = self.words[i];
        let [r, g, b, _] = word.to_le_bytes();
        match (self.colors, self.normals) {
            (false, _) => None,
            (true, false) => Some([r, g, b]),
            (true, true) => {
                let color = word >> 16 | self.places[i] >> 30 << 16;
                Some([0, 6, 12].map(|shift| eight_bits(color >> shift)))
            }
        }
    }

    pub(super) fn has_normals(&self) -> bool {
        self.normals
    }

    pub(super) fn has_colors(&self) -> bool {
        self.colors
    }

    pub(super) fn radii(&self) -> Radii {
        self.radii
    }

    /// Boxes of the runs.
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    pub(super) fn streams(&self, range: Range<usize>) -> Streams<'_> {
        let runs = range.start / RUN..range.end.div_ceil(RUN);
        Streams {
            geometry: bytemuck::cast_slice(&self.places[range.clone()]),
            normals: self.codes.as_ref().map(|codes| &codes[range.clone()]),
            colors: Some(bytemuck::cast_slice(&self.words[range])),
            frames: Some(bytemuck::cast_slice(&self.frames[runs])),
        }
    }
}
