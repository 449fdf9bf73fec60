//! Pictures of the f64 reference that are kept: they hold reference and device against drifting together.
//!
//! `SURFEL_BLESS=1` writes them anew (`cargo test --test cpu golden`); look at what changed before it is committed.

use std::path::{Path, PathBuf};

use surfel::measure::{Image, compare};
use surfel::readback::Picture;
use surfel::standalone::stress::{self, Case};

/// The kept cases, by name and file.
pub const KEPT: &[(&str, &str)] = &[
    ("soup back to front of the file, two-pass", "soup-two-pass"),
    ("soup back to front of the file, opaque", "soup-opaque"),
    ("sheet back to front of the file, two-pass", "sheet-two-pass"),
    ("lit at the origin, two-pass", "lit-two-pass"),
    ("oblique parallel, soup, two-pass", "oblique-two-pass"),
    ("across w = 0, two-pass", "across-two-pass"),
    ("0.01 px, two-pass", "dots-two-pass"),
];

pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// The kept cases with their files' names.
pub fn cases() -> Vec<(Case, &'static str)> {
    let all = stress::cases();
    let find = |name: &str| all.iter().find(|c| c.name == name).unwrap_or_else(|| panic!("no case {name}")).clone();
    KEPT.iter().map(|(name, file)| (find(name), *file)).collect()
}

/// As it is kept: 8-bit sRGB over dark grey, three channels.
pub fn encode(picture: &Picture) -> Vec<u8> {
    picture.encode([29, 31, 35, 255]).chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect()
}

/// Compares with the kept picture: at most `off` pixels may differ by more than one step of 255.
///
/// One step: 10⁻⁴ of linear light is at most 12.92 · 255 · 10⁻⁴ = 0.33 steps, which rounding may make one.
pub fn check(folder: &Path, file: &str, width: u32, height: u32, rgb: &[u8], off: u64) -> Result<(), String> {
    let path = folder.join(file).with_extension("png");
    let kept = image::open(&path).map_err(|e| format!("{}: {e}; SURFEL_BLESS=1 makes it", path.display()))?.to_rgb8();
    let kept = Image::from_srgb8(kept.width(), kept.height(), 3, &kept);
    let got = Image::from_srgb8(width, height, 3, rgb);
    let difference = compare(&kept, &got, 1.0001 / 255.0).map_err(|e| format!("{file}: {e}"))?;
    if difference.blank {
        return Err(format!("{file}: both pictures are blank"));
    }
    match difference.over {
        over if over > off => Err(format!("{file}: {over} pixels are off by more than a step, {off} may be")),
        _ => Ok(()),
    }
}
