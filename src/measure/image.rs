//! Pictures as they are compared.

use crate::color::{linear_to_srgb, srgb_to_linear};

/// A picture in the encoding that errors are measured in.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// sRGB-encoded red, green, blue, nominally 0 to 1; rows from the top.
    pub rgb: Vec<[f64; 3]>,
    /// Coverage, 0 to 1, where it is known.
    pub alpha: Option<Vec<f64>>,
    /// Linear view depth \[world\], where it is known; infinite where there is nothing.
    pub depth: Option<Vec<f64>>,
    /// Width of a pixel at linear depth 1, where it is known: in perspective a pixel at depth z is z times as wide.
    pub pixel: Option<f64>,
}

impl Image {
    /// From sRGB bytes, `channels` of them a pixel: 3, or 4 with coverage. Colours are taken as they are.
    ///
    /// # Panics
    /// For any other number of channels, or if `bytes` is not as long as the size asks for.
    pub fn from_srgb8(width: u32, height: u32, channels: usize, bytes: &[u8]) -> Image {
        assert!(channels == 3 || channels == 4, "three or four channels");
        assert_eq!(bytes.len(), width as usize * height as usize * channels, "one value a channel");
        let value = |b: u8| b as f64 / 255.0;
        let pixels = || bytes.chunks_exact(channels);
        Image {
            width,
            height,
            rgb: pixels().map(|p| [value(p[0]), value(p[1]), value(p[2])]).collect(),
            alpha: (channels == 4).then(|| pixels().map(|p| value(p[3])).collect()),
            depth: None,
            pixel: None,
        }
    }

    /// From premultiplied linear light with coverage, as [`crate::reference`] and the float targets have it, over an
    /// sRGB-encoded background, clamped to 0…1 as on a screen.
    ///
    /// # Panics
    /// If there is not one value a pixel.
    pub fn from_linear(width: u32, height: u32, rgba: &[[f64; 4]], background: [u8; 3]) -> Image {
        assert_eq!(rgba.len(), width as usize * height as usize, "one value a pixel");
        let background = background.map(|b| srgb_to_linear(b as f64 / 255.0));
        let over = |p: &[f64; 4]| {
            std::array::from_fn(|i| {
                let v = p[i] + (1.0 - p[3]) * background[i];
                // NaN must stay, so that `compare` can refuse it.
                linear_to_srgb(if v.is_nan() { v } else { v.clamp(0.0, 1.0) })
            })
        };
        let alpha = Some(rgba.iter().map(|p| p[3]).collect());
        Image { width, height, rgb: rgba.iter().map(over).collect(), alpha, depth: None, pixel: None }
    }

    /// From a float picture with what it knows of coverage and depth, over a background as in [`Image::from_linear`].
    ///
    /// # Panics
    /// If there is not one value a pixel.
    #[cfg(feature = "exr")]
    pub fn from_float(picture: &crate::exr::FloatPicture, background: [u8; 3]) -> Image {
        let rgba: Vec<[f64; 4]> = picture.rgba.iter().map(|p| p.map(f64::from)).collect();
        let mut image = Image::from_linear(picture.width, picture.height, &rgba, background);
        if !picture.coverage {
            image.alpha = None;
        }
        image.depth = picture.depth.as_ref().map(|d| d.iter().map(|&z| z as f64).collect());
        assert!(image.depth.as_ref().is_none_or(|d| d.len() == rgba.len()), "one depth a pixel");
        image.pixel = picture.window.map(|w| w as f64 / picture.width as f64);
        image
    }

    /// The picture, taken as not premultiplied, over an sRGB-encoded background; mixed in linear light. Coverage and depth
    /// stay. Without coverage it is the same picture.
    pub fn over(mut self, background: [u8; 3]) -> Image {
        let background = background.map(|b| srgb_to_linear(b as f64 / 255.0));
        for (pixel, &cover) in self.rgb.iter_mut().zip(self.alpha.iter().flatten()) {
            for (value, under) in pixel.iter_mut().zip(background) {
                *value = linear_to_srgb(cover * srgb_to_linear(*value) + (1.0 - cover) * under);
            }
        }
        self
    }

    /// The colours as sRGB bytes, red, green, blue; rows from the top.
    pub fn to_srgb8(&self) -> Vec<u8> {
        self.rgb.iter().flatten().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect()
    }

    /// Luma of ITU-R BT.601 on encoded values, the grey that SSIM's authors use.
    pub(super) fn luma(&self) -> Vec<f64> {
        self.rgb.iter().map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect()
    }

    pub(super) fn is_uniform(&self) -> bool {
        let same = self.rgb.windows(2).all(|w| w[0] == w[1]);
        same && self.alpha.as_ref().is_none_or(|a| a.windows(2).all(|w| w[0] == w[1]))
    }
}
