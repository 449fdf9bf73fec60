//! Positions in 30 bits, relative to the box of a run of points.

use glam::Vec3;

/// Points a run: consecutive in stored order, from a multiple on.
pub const RUN: usize = 256;

/// Steps along an axis.
const STEPS: u32 = 1023;
/// Exponent and two bits of a float that is positive: what is below.
const STEP_SHIFT: u32 = 21;
/// The least step but 0, 2⁻¹⁰⁰: no product or sum comes near subnormal numbers, which devices may take for 0.
const LEAST: u32 = (1.0f32 / (1u128 << 100) as f32).to_bits() >> STEP_SHIFT;

/// The box of a run: 16 B on the device. A position is corner + q · step, q of 10 bits. Steps have three significant bits, so that
/// the product is exact, and are less than a quarter larger than the box needs.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Frame {
    /// Lowest corner relative to the cloud's origin.
    pub corner: [f32; 3],
    /// Steps along x, y and z: 10 bits each, x lowest, of a float's exponent and the two bits after it.
    pub steps: u32,
}

fn normal_or_zero(v: f32) -> f32 {
    if v.is_subnormal() { 0.0 } else { v }
}

impl Frame {
    /// Round points that are finite; nothing at all without any.
    pub fn around(points: impl Iterator<Item = Vec3>) -> Frame {
        let (low, high) = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        if low.x > high.x {
            return Frame { corner: [0.0; 3], steps: 0 };
        }
        let corner = low.to_array().map(normal_or_zero);
        let mut steps = 0;
        for axis in 0..3 {
            let extent = normal_or_zero(high[axis]) as f64 - corner[axis] as f64;
            if extent > 0.0 {
                let wanted = extent / STEPS as f64;
                let field = ((wanted as f32).to_bits() >> STEP_SHIFT).max(LEAST);
                let enough = |field: &u32| f32::from_bits(*field << STEP_SHIFT) as f64 >= wanted;
                steps |= (field..field + 2).find(enough).unwrap_or(field + 1) << (10 * axis);
            }
        }
        Frame { corner, steps }
    }

    /// The step along an axis; positions are off by at most half of it, and the rounding of one sum.
    pub fn step(&self, axis: usize) -> f32 {
        f32::from_bits((self.steps >> (10 * axis) & STEPS) << STEP_SHIFT)
    }

    /// Farthest that a position within the box is from the nearest that can be said.
    pub fn half_diagonal(&self) -> f32 {
        // In f64, since squares of steps may leave the range of single floats.
        let square = |axis| (self.step(axis) as f64).powi(2);
        (0.5 * (square(0) + square(1) + square(2)).sqrt() * (1.0 + f32::EPSILON as f64)) as f32
    }

    /// 30 bits of a position within the box.
    pub fn encode(&self, position: Vec3) -> u32 {
        let field = |axis: usize| {
            let steps = (position[axis] as f64 - self.corner[axis] as f64) / self.step(axis) as f64;
            // What is not a number is 0: an axis without extent.
            (steps.round().clamp(0.0, STEPS as f64) as u32) << (10 * axis)
        };
        field(0) | field(1) | field(2)
    }

    /// The position.
    pub fn decode(&self, place: u32) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.corner[axis] + (place >> (10 * axis) & STEPS) as f32 * self.step(axis))
    }
}
