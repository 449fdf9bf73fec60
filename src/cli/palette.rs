//! Colours for values that have none of their own.

/// Control points of viridis (Smith and van der Walt 2015, CC0): even in lightness, safe for colour-blind eyes.
const VIRIDIS: [[u8; 3]; 10] = [
    [68, 1, 84],
    [72, 40, 120],
    [62, 74, 137],
    [49, 104, 142],
    [38, 130, 142],
    [31, 158, 137],
    [53, 183, 121],
    [109, 205, 89],
    [180, 222, 44],
    [253, 231, 37],
];

/// The ramp at `t`, clamped to 0…1; NaN is 0.
pub fn ramp(t: f64) -> [u8; 3] {
    let last = VIRIDIS.len() - 1;
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) };
    let at = t * last as f64;
    let low = (at as usize).min(last - 1);
    let share = at - low as f64;
    std::array::from_fn(|i| {
        let (a, b) = (VIRIDIS[low][i] as f64, VIRIDIS[low + 1][i] as f64);
        (a + (b - a) * share).round() as u8
    })
}

/// Colours in which the ASPRS classes of LAS 1.4 are usually shown.
const CLASSES: [[u8; 3]; 19] = [
    [150, 150, 150], // 0 never classified
    [190, 190, 190], // 1 unclassified
    [168, 118, 72],  // 2 ground
    [160, 208, 110], // 3 low vegetation
    [92, 172, 72],   // 4 medium vegetation
    [36, 124, 48],   // 5 high vegetation
    [216, 92, 72],   // 6 building
    [232, 48, 200],  // 7 low noise
    [240, 220, 80],  // 8 model key point, reserved since 1.4
    [60, 120, 220],  // 9 water
    [110, 90, 150],  // 10 rail
    [120, 124, 136], // 11 road
    [200, 200, 120], // 12 overlap, reserved since 1.4
    [250, 200, 60],  // 13 wire guard
    [255, 160, 40],  // 14 wire conductor
    [80, 190, 200],  // 15 transmission tower
    [255, 120, 120], // 16 wire connector
    [190, 150, 220], // 17 bridge deck
    [255, 0, 120],   // 18 high noise
];

/// The colour of a class. Those without a meaning of their own get hues far from their neighbours'.
pub fn class(code: u8) -> [u8; 3] {
    match CLASSES.get(code as usize) {
        Some(color) => *color,
        None => {
            // Steps of the golden angle never come near each other soon.
            let hue = (code as f64 * 0.618_033_988_75).fract() * 6.0;
            let channel = |shift: f64| {
                let h = (hue + shift) % 6.0;
                let v = (2.0 - (h - 3.0).abs()).clamp(0.0, 1.0);
                (70.0 + 170.0 * (1.0 - v)).round() as u8
            };
            [channel(0.0), channel(4.0), channel(2.0)]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ramp_has_ends_and_takes_anything() {
        assert_eq!(ramp(0.0), VIRIDIS[0]);
        assert_eq!(ramp(1.0), VIRIDIS[9]);
        assert_eq!(ramp(-5.0), VIRIDIS[0]);
        assert_eq!(ramp(f64::INFINITY), VIRIDIS[9]);
        assert_eq!(ramp(f64::NAN), VIRIDIS[0]);
        assert_eq!(ramp(1.5 / 9.0), [67, 57, 129]);
    }

    #[test]
    fn the_ramp_only_gets_lighter() {
        let luma = |t: f64| {
            let [r, g, b] = ramp(t).map(|v| v as f64);
            0.299 * r + 0.587 * g + 0.114 * b
        };
        assert!((0..100).all(|i| luma((i + 1) as f64 / 100.0) > luma(i as f64 / 100.0) - 0.6));
    }

    #[test]
    fn every_class_has_a_visible_colour() {
        assert!((0..=255).all(|c| class(c).iter().any(|v| *v > 100)));
        assert_ne!(class(64), class(65));
    }
}
