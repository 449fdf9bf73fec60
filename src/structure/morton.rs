//! Places on the Morton curve, which every structure that nests cells sorts by.

use glam::Vec3;

/// Levels that a code resolves: bits of each axis.
pub const LEVELS: u32 = 21;

/// The cube that codes count in: everything that is drawn lies in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cube {
    /// Its lowest corner.
    pub low: Vec3,
    /// Length of its edges, more than 0.
    pub side: f32,
}

impl Cube {
    /// Round a box, with the box's lowest corner.
    pub fn round(low: Vec3, high: Vec3) -> Cube {
        Cube { low, side: (high - low).max_element().max(f32::MIN_POSITIVE) }
    }

    /// Place of a point on the curve: 21 bits of every axis, interleaved, x lowest; the highest three name the octant of the
    /// whole cube. What is outside, or no number, goes to the nearest end.
    pub fn code(&self, p: Vec3) -> u64 {
        let side = self.side as f64;
        let place =
            |v: f32, low: f32| ((v as f64 - low as f64) / side * (1 << 21) as f64).clamp(0.0, ((1 << 21) - 1) as f64);
        // Two zero bits between each two (the usual shifts and masks, from 21 bits to 63).
        let spread = |v: f64| {
            let mut x = v as u64;
            for (shift, mask) in [
                (32, 0x001f_0000_0000_ffff),
                (16, 0x001f_0000_ff00_00ff),
                (8, 0x100f_00f0_0f00_f00f),
                (4, 0x10c3_0c30_c30c_30c3),
                (2, 0x1249_2492_4924_9249),
            ] {
                x = (x | x << shift) & mask;
            }
            x
        };
        spread(place(p.x, self.low.x)) | spread(place(p.y, self.low.y)) << 1 | spread(place(p.z, self.low.z)) << 2
    }
}

/// Places along x, y and z of a code: the bits that [`Cube::code`] interleaved.
pub fn axes(code: u64) -> [u64; 3] {
    [0, 1, 2].map(|axis| {
        // Gathers every third bit: the steps of `code`, backwards.
        let mut x = code >> axis & 0x1249_2492_4924_9249;
        for (shift, mask) in [
            (2, 0x10c3_0c30_c30c_30c3),
            (4, 0x100f_00f0_0f00_f00f),
            (8, 0x001f_0000_ff00_00ff),
            (16, 0x001f_0000_0000_ffff),
            (32, 0x0000_0000_001f_ffff),
        ] {
            x = (x | x >> shift) & mask;
        }
        x
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_what_was_interleaved() {
        let cube = Cube { low: Vec3::ZERO, side: (1 << LEVELS) as f32 };
        for place in [[0, 0, 0], [1, 2, 3], [0x1f_ffff, 0, 0x15_5555], [0x0a_aaaa, 0x1f_ffff, 0x10_0001]] {
            let p = Vec3::from_array(place.map(|v: u32| v as f32));
            assert_eq!(axes(cube.code(p)), place.map(u64::from));
        }
    }
}
