//! Random numbers and functions that give the same bits on every platform.
//!
//! `f64::sin` and its kind are the system's, and differ in the last bit from one to the next. These use only +, −, ×, ÷
//! and √, which IEEE 754 fixes exactly.

/// SplitMix64 (Steele, Lea, Flood: "Fast splittable pseudorandom number generators", 2014).
pub(crate) struct Rng(u64);

/// What the state grows by with every number.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

impl Rng {
    pub(crate) fn new(seed: u64) -> Rng {
        Rng(seed)
    }

    /// The same sequence from `draws` numbers later on.
    pub(crate) fn after(self, draws: u64) -> Rng {
        Rng(self.0.wrapping_add(draws.wrapping_mul(STEP)))
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(STEP);
        mix(self.0)
    }

    /// Uniform in 0..1, never 1.
    pub(crate) fn unit(&mut self) -> f64 {
        to_unit(self.bits())
    }
}

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn to_unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// A number in 0..1 for a cell of a grid.
pub(crate) fn hash(x: i64, y: i64, seed: u64) -> f64 {
    to_unit(mix(
        mix(seed ^ (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)) ^ (y as u64).wrapping_mul(0xd1b5_4a32_d192_ed03)
    ))
}

/// Sine and cosine of `turns` full turns, to about 1e-15.
pub(crate) fn sin_cos(turns: f64) -> (f64, f64) {
    let quarter = (turns * 4.0).round();
    // Within an eighth of a turn of the nearest quarter; exact, since both are multiples of the same power of two.
    let x = (turns - quarter * 0.25) * std::f64::consts::TAU;
    let xx = x * x;
    // Taylor to x^17 and x^16: the next terms are below 1e-18 at π/4.
    let (mut sin, mut cos) = (1.0, 1.0);
    for k in (1..=8).rev() {
        let k = f64::from(k);
        sin = 1.0 - sin * xx / ((2.0 * k) * (2.0 * k + 1.0));
        cos = 1.0 - cos * xx / ((2.0 * k - 1.0) * (2.0 * k));
    }
    sin *= x;
    match quarter.rem_euclid(4.0) as i64 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Point `i` of the sequence that multiples of the golden ratio make in 0..1.
pub(crate) fn golden(i: usize) -> f64 {
    (i as f64 * 0.618_033_988_749_894_9).fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sequence_can_be_entered_anywhere() {
        let mut all = Rng::new(5);
        let numbers: Vec<u64> = (0..9).map(|_| all.bits()).collect();
        assert_eq!(Rng::new(5).after(8).bits(), numbers[8]);
    }

    #[test]
    fn own_sine_agrees_with_the_systems() {
        for i in -4000..4000 {
            let turns = f64::from(i) / 1000.0;
            let (sin, cos) = sin_cos(turns);
            let (s, c) = (turns * std::f64::consts::TAU).sin_cos();
            // The system's gets an argument rounded at up to 8π: 2 ulp of 16 are 3.6e-15.
            assert!((sin - s).abs() < 6e-15 && (cos - c).abs() < 6e-15, "{turns}: {sin} {s} {cos} {c}");
        }
        assert_eq!(sin_cos(0.25), (1.0, -0.0));
    }
}
