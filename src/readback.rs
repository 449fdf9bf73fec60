//! A finished picture in memory.

use crate::color::linear_to_srgb;

/// A picture as the device left it: premultiplied, linear light.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// \[px\]
    pub width: u32,
    /// \[px\]
    pub height: u32,
    /// Rows from the top, premultiplied RGBA in linear light.
    pub rgba: Vec<[f32; 4]>,
    /// The front's depth in the view's convention, where the target had depth.
    pub depth: Option<Vec<f32>>,
}

impl Picture {
    /// [`encode`]s it.
    pub fn encode(&self, background: [u8; 4]) -> Vec<u8> {
        encode(&self.rgba, background)
    }

    /// Share of pixels that anything covers.
    pub fn coverage(&self) -> f64 {
        let covered = self.rgba.iter().filter(|p| p[3] > 0.0).count();
        covered as f64 / self.rgba.len().max(1) as f64
    }
}

/// Premultiplied linear light to eight-bit sRGB RGBA over a background (sRGB-encoded, its last byte the opacity), not
/// premultiplied. The only encoding on the way from the points to a file.
pub fn encode(rgba: &[[f32; 4]], background: [u8; 4]) -> Vec<u8> {
    let [r, g, b, a] = background.map(|c| c as f64 / 255.0);
    let under = [r, g, b].map(crate::color::srgb_to_linear);
    let mut bytes = Vec::with_capacity(rgba.len() * 4);
    for pixel in rgba {
        let cover = pixel[3] as f64;
        let alpha = cover + (1.0 - cover) * a;
        for (value, under) in pixel.iter().zip(under) {
            let mixed = *value as f64 + (1.0 - cover) * a * under;
            let straight = if alpha > 0.0 { mixed / alpha } else { 0.0 };
            bytes.push((linear_to_srgb(straight.clamp(0.0, 1.0)) * 255.0).round() as u8);
        }
        bytes.push((alpha.clamp(0.0, 1.0) * 255.0).round() as u8);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_knows_backgrounds() {
        let picture = |p: [f32; 4]| Picture { width: 1, height: 1, rgba: vec![p], depth: None };
        assert_eq!(picture([0.0; 4]).encode([1, 2, 3, 255]), [1, 2, 3, 255]);
        assert_eq!(picture([0.0; 4]).encode([1, 2, 3, 0]), [0, 0, 0, 0]);
        assert_eq!(picture([1.0, 1.0, 1.0, 1.0]).encode([9, 9, 9, 255]), [255; 4]);
        // Half of white over nothing stays white, half opaque.
        assert_eq!(picture([0.5, 0.5, 0.5, 0.5]).encode([0; 4]), [255, 255, 255, 128]);
        // Half of white over black is linear one half: sRGB 188.
        assert_eq!(picture([0.5, 0.5, 0.5, 0.5]).encode([0, 0, 0, 255]), [188, 188, 188, 255]);
    }
}
