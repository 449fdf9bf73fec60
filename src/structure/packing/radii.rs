//! Radii in eight bits.

/// What the codes of a cloud's radii mean: the bits of a positive float, read as a whole number, grow as its logarithm does
/// (straight within an octave), so steps of equal size in them are steps of nearly equal ratio. Code 255 is the largest radius,
/// code 0 no splat. Codes are rounded up, so a radius that covers still does.
///
/// With s the step, a decoded radius is at most 1 + s / 2²³ times the stored one ([`factor`](Self::factor)): adding t = s / 2²³ ≤ 1
/// to e + m takes (1 + m) 2ᵉ to (1 + m + t) 2ᵉ, or beyond the octave to 2 (m + t) 2ᵉ, and neither is more than 1 + t times as
/// much, for m + t < 1 and from there on. A range of eight octaves gives 1.032, one radius gives 1 + 2⁻²³.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Radii {
    /// Bits of the largest radius.
    pub most: u32,
    /// Bits from one code to the next, 1 to 2²³.
    pub step: u32,
}

/// Bits of what is a radius. Devices may take subnormal numbers for 0.
fn bits(radius: f32) -> Option<u32> {
    (radius > 0.0 && radius.is_finite()).then(|| radius.max(f32::MIN_POSITIVE).to_bits())
}

impl Radii {
    /// Those that hold all radii that are more than 0 and finite.
    pub fn of(radii: impl Iterator<Item = f32>) -> Radii {
        let (low, high) = radii.filter_map(bits).fold((u32::MAX, 0), |(low, high), b| (low.min(b), high.max(b)));
        Radii { most: high, step: high.saturating_sub(low).div_ceil(254).max(1) }
    }

    /// The code of the least radius that is not smaller; 0 for what is no radius.
    pub fn encode(&self, radius: f32) -> u8 {
        bits(radius).map_or(0, |b| 255 - (self.most.saturating_sub(b) / self.step).min(254) as u8)
    }

    /// The radius of a code.
    pub fn decode(&self, code: u8) -> f32 {
        if code == 0 { 0.0 } else { f32::from_bits(self.most - (255 - code) as u32 * self.step) }
    }

    /// No decoded radius is more times the stored one.
    pub fn factor(&self) -> f64 {
        1.0 + self.step as f64 / (1u32 << 23) as f64
    }
}
