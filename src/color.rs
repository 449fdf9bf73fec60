//! The transfer function of sRGB (IEC 61966-2-1), in one place. Blending is in linear light; pictures are encoded once.
#![forbid(unsafe_code)]

use std::sync::LazyLock;

/// Linear light of an encoded value, 0 to 1 both; negative values continue the straight part.
pub fn srgb_to_linear(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// The encoded value of linear light, the inverse of [`srgb_to_linear`]; nothing is clamped.
pub fn linear_to_srgb(v: f64) -> f64 {
    if v <= 0.0031308 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Linear light of every sRGB byte.
pub fn decode_table() -> &'static [f64; 256] {
    static TABLE: LazyLock<[f64; 256]> = LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f64 / 255.0)));
    &TABLE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        assert_eq!(srgb_to_linear(0.0), 0.0);
        assert!((srgb_to_linear(1.0) - 1.0).abs() < 1e-15);
        // ((0.5 + 0.055) / 1.055)^2.4, with bc.
        assert!((srgb_to_linear(0.5) - 0.214041140482232).abs() < 1e-14);
        assert!((linear_to_srgb(0.5) - 0.735356983052445).abs() < 1e-14);
        assert!((decode_table()[10] - 10.0 / 255.0 / 12.92).abs() < 1e-18);
    }

    #[test]
    fn every_byte_survives_the_round_trip() {
        for (i, &linear) in decode_table().iter().enumerate() {
            // The standard's rounded constants leave a step of about 3·10⁻⁸ where the two branches meet (at byte 10.3).
            assert!((linear_to_srgb(linear) * 255.0 - i as f64).abs() < 1e-5, "{i}");
        }
        assert!(decode_table().windows(2).all(|w| w[0] < w[1]));
    }
}
