//! Positions and colours as they are, the rest in what colours leave free.

use std::ops::Range;

use super::{GRAIN, Radii, Streams, narrow_normal, rgb};
use crate::par;
use crate::structure::{Flat, octahedral};

/// 16 B a point, 18 B with normals.
#[derive(Debug, Clone, PartialEq)]
pub struct Exact {
    positions: Vec<[f32; 3]>,
    /// sRGB bytes, red lowest, and the radius' code on top.
    words: Vec<u32>,
    normals: Option<Vec<u16>>,
    colors: bool,
    radii: Radii,
}

impl Exact {
    pub(super) fn pack(full: &Flat) -> Exact {
        let n = full.len();
        let radii = Radii::of(full.geometry.iter().map(|g| g[3]));
        let mut words = vec![0; n];
        par::fill(&mut words, GRAIN, |first, part| {
            for (i, word) in (first..).zip(part) {
                let [r, g, b] = rgb(full, i);
                *word = u32::from_le_bytes([r, g, b, radii.encode(full.geometry[i][3])]);
            }
        });
        let normals = full.has_normals().then(|| {
            let mut normals = vec![0; n];
            par::fill(&mut normals, GRAIN, |first, part| {
                (first..).zip(part).for_each(|(i, normal)| *normal = narrow_normal(full, i));
            });
            normals
        });
        let positions = full.geometry.iter().map(|&[x, y, z, _]| [x, y, z]).collect();
        Exact { positions, words, normals, colors: full.has_colors(), radii }
    }

    pub(super) fn len(&self) -> usize {
        self.positions.len()
    }

    pub(super) fn point(&self, i: usize) -> [f32; 4] {
        let [x, y, z] = self.positions[i];
        [x, y, z, self.radii.decode((self.words[i] >> 24) as u8)]
    }

    pub(super) fn normal(&self, i: usize) -> u32 {
        self.normals.as_ref().map_or(octahedral::NONE, |n| octahedral::widen(n[i]))
    }

    pub(super) fn color(&self, i: usize) -> Option<[u8; 3]> {
        let [r, g, b, _] = self.words[i].to_le_bytes();
        self.colors.then_some([r, g, b])
    }

    pub(super) fn has_normals(&self) -> bool {
        self.normals.is_some()
    }

    pub(super) fn has_colors(&self) -> bool {
        self.colors
    }

    pub(super) fn radii(&self) -> Radii {
        self.radii
    }

    pub(super) fn streams(&self, range: Range<usize>) -> Streams<'_> {
        Streams {
            geometry: bytemuck::cast_slice(&self.positions[range.clone()]),
            normals: self.normals.as_ref().map(|n| bytemuck::cast_slice(&n[range.clone()])),
            colors: Some(bytemuck::cast_slice(&self.words[range])),
            frames: None,
        }
    }
}
