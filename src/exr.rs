//! Float pictures in files: OpenEXR (feature `exr`), one layer with the channels R, G, B, A and, with depth, Z.
//!
//! EXR's own convention is ours: linear light, premultiplied ("associated") alpha, Z the distance along the viewing
//! direction. What is written is compressed without loss and read back bit by bit.
#![forbid(unsafe_code)]

use std::io::Cursor;
use std::path::Path;

use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder,
    ReadChannels, ReadLayers, SmallVec, Vec2, WritableImage, read,
};

use crate::error::{Error, Place, Result};

/// The first bytes of every EXR file.
pub const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// How much smaller than its pixels a file can be: deflate, the densest of EXR's lossless compressions, spends at least
/// two bits on 258 bytes. A header that promises more is not believed, so memory stays in proportion to the file.
const DENSEST: u128 = 1032;

/// A picture in linear light, with depth where it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct FloatPicture {
    /// \[px\]
    pub width: u32,
    /// \[px\]
    pub height: u32,
    /// Rows from the top: red, green, blue in linear light, premultiplied, and coverage.
    pub rgba: Vec<[f32; 4]>,
    /// Whether the fourth value of `rgba` is a coverage that is known (channel A); otherwise it is 1 and not written.
    pub coverage: bool,
    /// Linear view depth \[world\], infinite where there is nothing; rows from the top (channel Z).
    pub depth: Option<Vec<f32>>,
    /// Width of the window that the whole picture is, at linear depth 1 (EXR's `screenWindowWidth`); `None` for views
    /// without perspective. A pixel at depth z is `window · z / width` wide.
    pub window: Option<f32>,
}

impl FloatPicture {
    /// The picture as the bytes of a file: the same for the same picture, always.
    ///
    /// # Errors
    /// For a picture that the format cannot hold: one without pixels, or with sides beyond 2³¹.
    ///
    /// # Panics
    /// If `rgba` or `depth` has not one value a pixel.
    pub fn to_bytes(&self, file: &Path) -> Result<Vec<u8>> {
        let pixels = self.width as usize * self.height as usize;
        assert_eq!(self.rgba.len(), pixels, "one colour a pixel");
        assert!(self.depth.as_ref().is_none_or(|d| d.len() == pixels), "one depth a pixel");
        let refuse = |why: String| Error::data(file, Place::File, why);
        if pixels == 0 || self.width.max(self.height) > i32::MAX as u32 {
            return Err(refuse(format!("a picture of {}×{} cannot be written", self.width, self.height)));
        }
        let plane = |c: usize| FlatSamples::F32(self.rgba.iter().map(|p| p[c]).collect());
        let mut channels: SmallVec<[_; 4]> =
            [("R", 0), ("G", 1), ("B", 2)].into_iter().map(|(name, c)| AnyChannel::new(name, plane(c))).collect();
        if self.coverage {
            channels.push(AnyChannel::new("A", plane(3)));
        }
        if let Some(depth) = &self.depth {
            channels.push(AnyChannel::new("Z", FlatSamples::F32(depth.clone())));
        }
        let encoding =
            Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
        let size = (self.width as usize, self.height as usize);
        // The format wants a number in any case; no window has the width 0.
        let attributes =
            LayerAttributes { screen_window_width: self.window.unwrap_or(0.0), ..LayerAttributes::default() };
        let layer = Layer::new(size, attributes, encoding, AnyChannels::sort(channels));
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).map_err(|e| refuse(e.to_string()))?;
        Ok(bytes.into_inner())
    }

    /// The picture in the bytes of a file, which `file` names in errors. Half floats and whole numbers become f32;
    /// channels other than R, G, B, A, Z are passed over; a missing A leaves the coverage unknown.
    ///
    /// # Errors
    /// [`Error::Data`] for everything but a whole file of one flat layer in scan lines, compressed without
    /// loss, with R, G and B, whose pixels fill the window that
    /// is to be shown.
    pub fn from_bytes(file: &Path, bytes: &[u8]) -> Result<FloatPicture> {
        let refuse = |why: String| Error::data(file, Place::File, why);
        check(bytes).map_err(refuse)?;
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
            .map_err(|e| refuse(e.to_string()))?;
        let Vec2(width, height) = image.layer_data.size;
        let list = &image.layer_data.channel_data.list;
        let find = |name: &str| list.iter().find(|c| c.name.eq(name)).map(|c| &c.sample_data);
        let need = |name: &str| find(name).ok_or_else(|| refuse(format!("it has no channel {name}")));
        let (r, g, b, a) = (need("R")?, need("G")?, need("B")?, find("A"));
        let mut rgba = vec![[0.0, 0.0, 0.0, 1.0]; width * height];
        for (c, plane) in [Some(r), Some(g), Some(b), a].into_iter().enumerate() {
            for (pixel, value) in rgba.iter_mut().zip(plane.into_iter().flat_map(|p| p.values_as_f32())) {
                pixel[c] = value;
            }
        }
        let depth = find("Z").map(|z| z.values_as_f32().collect());
        // Sides fit: the file's own are of 31 bits.
        let window = Some(image.layer_data.attributes.screen_window_width).filter(|w| w.is_finite() && *w > 0.0);
        Ok(FloatPicture { width: width as u32, height: height as u32, rgba, coverage: a.is_some(), depth, window })
    }

    /// Writes a file, in place of one that is there.
    ///
    /// # Errors
    /// As [`FloatPicture::to_bytes`], and [`Error::Io`].
    ///
    /// # Panics
    /// As [`FloatPicture::to_bytes`].
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        std::fs::write(path, self.to_bytes(path)?).map_err(|e| Error::io(path, e))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// As [`FloatPicture::from_bytes`], and [`Error::Io`].
    pub fn read(path: impl AsRef<Path>) -> Result<FloatPicture> {
        let path = path.as_ref();
        FloatPicture::from_bytes(path, &std::fs::read(path).map_err(|e| Error::io(path, e))?)
    }
}

/// Refuses, before anything is allocated for it, a header whose pixels cannot be in these bytes or that is not ours to read.
fn check(bytes: &[u8]) -> Result<(), String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    let [header] = meta.headers.as_slice() else { return Err(format!("{} layers, not one", meta.headers.len())) };
    if header.deep {
        return Err("deep pictures are not read".into());
    }
    if header.channels.list.iter().any(|c| c.sampling != Vec2(1, 1)) {
        return Err("channels of fewer pixels than the picture are not read".into());
    }
    // The crate trusts the level that a tile names (exr 1.74: a debug assertion in `FlatSamplesReader`).
    if header.blocks != BlockDescription::ScanLines {
        return Err("tiled pictures are not read".into());
    }
    // What is measured must be what was drawn. The decoders of the lossy ones also panic on broken files (exr 1.74: B44).
    use Compression::{PIZ, RLE, Uncompressed, ZIP1, ZIP16};
    if !matches!(header.compression, Uncompressed | RLE | ZIP1 | ZIP16 | PIZ) {
        return Err(format!("lossy compression ({}) is not read", header.compression));
    }
    if header.data_window() != header.shared_attributes.display_window {
        return Err("its pixels do not fill the window that is to be shown".into());
    }
    let Vec2(width, height) = header.layer_size;
    let needed = width as u128 * height as u128 * header.channels.bytes_per_pixel as u128;
    if needed > DENSEST * bytes.len() as u128 {
        return Err(format!("{width}×{height} pixels cannot be in {} bytes", bytes.len()));
    }
    Ok(())
}

#[cfg(test)]
#[path = "exr_tests.rs"]
mod tests;
