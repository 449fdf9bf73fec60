//! One point in place of many.

use glam::{DVec3, Vec3};

use crate::color::{decode_table, linear_to_srgb};
use crate::structure::{Flat, octahedral};

/// A point that is averaged, ready to be added.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    position: DVec3,
    /// 0 where there is none.
    normal: DVec3,
    /// In linear light; 0 where there is none.
    color: DVec3,
    radius: f32,
}

/// A point as it is stored.
#[derive(Clone, Copy)]
pub(super) struct Stored {
    pub geometry: [f32; 4],
    pub normal: u32,
    pub color: u32,
}

impl Sample {
    /// Of a point of a cloud that is not packed.
    pub fn of(flat: &Flat, i: u32) -> Sample {
        let normal = flat.normals.as_ref().and_then(|n| octahedral::decode(n[i as usize])).unwrap_or_default();
        let color = flat.colors.as_ref().map_or(DVec3::ZERO, |colors| {
            let table = decode_table();
            let [r, g, b, _] = colors[i as usize].to_le_bytes();
            DVec3::new(table[r as usize], table[g as usize], table[b as usize])
        });
        Sample { position: flat.position(i).as_dvec3(), normal, color, radius: flat.geometry[i as usize][3] }
    }
}

/// Mean position, normal and colour, colours in linear light, as large as a cell's side and as the largest of them: in a sparse
/// region two that lie near each other still cover what is around them. Normals of a cloud that is not closed are taken
/// for lines: one that was only estimated may point either way.
pub(super) fn average(samples: impl Iterator<Item = Sample>, closed: bool, side: f32) -> Stored {
    let (mut position, mut normal, mut color) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    let (mut n, mut radius) = (0.0, side);
    for sample in samples {
        position += sample.position;
        normal += if normal.dot(sample.normal) < 0.0 && !closed { -sample.normal } else { sample.normal };
        color += sample.color;
        radius = radius.max(sample.radius);
        n += 1.0;
    }
    let code =
        if normal.length() > 1e-3 * n { octahedral::encode(normal.normalize().as_vec3()) } else { octahedral::NONE };
    let [r, g, b] = (color / n).to_array().map(|v| (linear_to_srgb(v) * 255.0).round() as u8);
    let Vec3 { x, y, z } = (position / n).as_vec3();
    Stored { geometry: [x, y, z, radius], normal: code, color: u32::from_le_bytes([r, g, b, 255]) }
}
