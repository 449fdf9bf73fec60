//! Values of options, from text. What is refused here is a usage error.

use std::ffi::OsString;
use std::path::PathBuf;

use glam::DVec3;

use surfel::load::synthetic::{DEMO_POINTS, SCENES};

/// Where points come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// A file.
    File(PathBuf),
    /// A model behind a server: `http://` or `https://`.
    Remote(String),
    /// A scene from formulas.
    Scene { name: String, points: usize, seed: u64 },
}

/// Direction and distance from the centre of the bounding sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// About `up`, counter-clockwise seen from above [degrees].
    pub azimuth: f64,
    /// Above the horizon, −90 to 90 [degrees].
    pub elevation: f64,
    /// In radii of the bounding sphere, ≥ 0.
    pub distance: f64,
}

/// Where radii come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Radius {
    /// By the library's rule.
    Auto,
    /// This for all \[world units\].
    Value(f32),
    /// A factor on the automatic ones.
    Scale(f32),
    /// A scanner's angular step \[rad\], times the distance from it; `None`: the step that the file tells.
    Angular(Option<f32>),
    /// Opaque points of so many pixels.
    Pixels(f32),
}

/// The largest cloud that missing attributes can be completed for.
pub const MAX_POINTS: usize = 1 << 29;

/// A path, an address, or `scene:NAME[:POINTS[:SEED]]`.
pub fn input(text: OsString) -> Result<Input, String> {
    if let Some(address) = text.to_str().filter(|t| t.starts_with("http://") || t.starts_with("https://")) {
        return Ok(Input::Remote(address.to_owned()));
    }
    let Some(scene) = text.to_str().and_then(|t| t.strip_prefix("scene:")) else {
        return Ok(Input::File(text.into()));
    };
    let mut parts = scene.split(':');
    let name = parts.next().unwrap_or_default();
    if !SCENES.iter().any(|(n, _)| *n == name) {
        let names = SCENES.map(|(n, _)| n).join(", ");
        return Err(format!("there is no scene {name:?}; there are {names}"));
    }
    // A hundred points at each of ten places already say all there is to see: eight of each are drawn.
    let usual = if name == "coincident" { 1000 } else { DEMO_POINTS };
    let points = parts.next().map_or(Ok(usual), count)?;
    let seed = match parts.next() {
        None => 1,
        Some(seed) => seed.parse().map_err(|_| format!("{seed:?} is not a seed: a whole number"))?,
    };
    if parts.next().is_some() {
        return Err("more than scene:NAME:POINTS:SEED".into());
    }
    Ok(Input::Scene { name: name.into(), points, seed })
}

/// A number of points, with `k` or `M` behind it or not.
fn count(text: &str) -> Result<usize, String> {
    let (digits, unit) = match text.as_bytes().last() {
        Some(b'k' | b'K') => (&text[..text.len() - 1], 1_000),
        Some(b'm' | b'M') => (&text[..text.len() - 1], 1_000_000),
        _ => (text, 1),
    };
    let n = digits.parse::<usize>().ok().and_then(|n| n.checked_mul(unit));
    // What a command holds in memory it bounds itself: `build` makes some scenes in pieces.
    const MOST: usize = 1 << 40;
    n.filter(|n| (1..=MOST).contains(n))
        .ok_or_else(|| format!("{text:?} is not a number of points: 1 to {MOST}, such as 200000, 200k or 2M"))
}

/// Memory to work in: [`bytes`], 64M at least.
pub fn memory(text: &str) -> Result<u64, String> {
    let wrong = || format!("{text:?} is no amount of memory: 64M or more, such as 512M or 2G");
    bytes(text).ok().filter(|n| *n >= 64 << 20).ok_or_else(wrong)
}

/// Bytes: a whole number above 0, or one with `M` or `G` behind it.
pub fn bytes(text: &str) -> Result<u64, String> {
    let (digits, unit) = match text.as_bytes().last() {
        Some(b'm' | b'M') => (&text[..text.len() - 1], 1 << 20),
        Some(b'g' | b'G') => (&text[..text.len() - 1], 1 << 30),
        _ => (text, 1),
    };
    let bytes = digits.parse::<u64>().ok().and_then(|n| n.checked_mul(unit)).filter(|n| *n > 0);
    bytes.ok_or_else(|| format!("{text:?} is no amount of memory, such as 512M or 2G"))
}

/// `1280x720`.
pub fn size(text: &str) -> Result<[u32; 2], String> {
    let parse = |t: &str| t.parse::<u32>().ok().filter(|n| *n > 0);
    text.split_once(['x', 'X', '×'])
        .and_then(|(w, h)| Some([parse(w)?, parse(h)?]))
        .ok_or_else(|| "a size is WIDTHxHEIGHT in pixels, each at least 1, such as 1280x720".into())
}

fn finite(text: &str) -> Option<f64> {
    text.trim().parse::<f64>().ok().filter(|v| v.is_finite())
}

fn three(text: &str) -> Option<[f64; 3]> {
    let parts: Vec<f64> = text.split(',').map(finite).collect::<Option<_>>()?;
    parts.try_into().ok()
}

/// `x,y,z`.
pub fn vector(text: &str) -> Result<DVec3, String> {
    three(text).map(DVec3::from).ok_or_else(|| "three finite numbers x,y,z without blanks".into())
}

/// An axis, perhaps with a sign, or a vector; of unit length.
pub fn up(text: &str) -> Result<DVec3, String> {
    let (sign, axis) = match text.as_bytes().first() {
        Some(b'-') => (-1.0, &text[1..]),
        Some(b'+') => (1.0, &text[1..]),
        _ => (1.0, text),
    };
    let given = match axis {
        "x" | "X" => sign * DVec3::X,
        "y" | "Y" => sign * DVec3::Y,
        "z" | "Z" => sign * DVec3::Z,
        _ => vector(text).map_err(|_| "x, y, z, -x, -y, -z, or three finite numbers x,y,z".to_string())?,
    };
    // By the largest component first: squares of huge and tiny numbers leave the range of f64.
    let scaled = given / given.abs().max_element();
    if scaled.is_finite() { Ok(scaled.normalize()) } else { Err("an up vector of length zero".into()) }
}

/// `AZ,EL,DIST`.
pub fn orbit(text: &str) -> Result<Orbit, String> {
    let [azimuth, elevation, distance] =
        three(text).ok_or("three finite numbers AZIMUTH,ELEVATION,DISTANCE, such as 30,20,2.5")?;
    if !(-90.0..=90.0).contains(&elevation) {
        return Err("an elevation lies from -90 to 90 degrees".into());
    }
    if !(0.0..=1e9).contains(&distance) {
        return Err("a distance lies from 0 to 1e9 bounding radii".into());
    }
    Ok(Orbit { azimuth, elevation, distance })
}

/// Degrees.
pub fn fov(text: &str) -> Result<f64, String> {
    // Below a thousandth of a degree f32 no longer tells pixels apart; towards 180° the tangent runs away.
    finite(text).filter(|v| (0.001..=179.0).contains(v)).ok_or_else(|| "an angle from 0.001 to 179 degrees".into())
}

/// At least zero, and small enough for an f32.
/// From 0 to 1.
pub fn factor(text: &str) -> Result<f32, String> {
    let value = finite(text).filter(|v| (0.0..=1.0).contains(v)).ok_or("a number from 0 to 1")?;
    Ok(value as f32)
}

pub fn not_negative(text: &str) -> Result<f64, String> {
    finite(text).filter(|v| (0.0..=1e30).contains(v)).ok_or_else(|| "a finite number, at least 0".into())
}

/// Above zero, and small enough for an f32.
pub fn positive(text: &str) -> Result<f64, String> {
    finite(text).filter(|v| (1e-30..=1e30).contains(v)).ok_or_else(|| "a finite number above 0".into())
}

/// `RRGGBB` or `RRGGBBAA`, with `#` or without.
pub fn color(text: &str) -> Result<[u8; 4], String> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    let wrong = || "six or eight hexadecimal digits RRGGBB[AA], such as 202020 or ffffff00".to_string();
    if !matches!(digits.len(), 6 | 8) || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
        return Err(wrong());
    }
    let value = u32::from_str_radix(digits, 16).map_err(|_| wrong())?;
    Ok(if digits.len() == 6 { value << 8 | 0xff } else { value }.to_be_bytes())
}

/// `auto`, a length, `scale:S`, `angle:DEG`, `angle:auto` or `px:N`.
pub fn radius(text: &str) -> Result<Radius, String> {
    let positive = |t: &str| {
        finite(t).map(|v| v as f32).filter(|v| *v > 0.0 && *v < 1e30).ok_or("a radius is a finite number above 0")
    };
    if text == "auto" {
        return Ok(Radius::Auto);
    }
    if let Some(scale) = text.strip_prefix("scale:") {
        return Ok(Radius::Scale(positive(scale)?));
    }
    if text == "angle:auto" {
        return Ok(Radius::Angular(None));
    }
    if let Some(degrees) = text.strip_prefix("angle:") {
        let degrees = positive(degrees)?;
        return match degrees < 90.0 {
            true => Ok(Radius::Angular(Some(degrees.to_radians()))),
            false => Err("an angular step is less than 90 degrees".into()),
        };
    }
    if let Some(pixels) = text.strip_prefix("px:") {
        let pixels = positive(pixels)?;
        return match pixels <= 4096.0 {
            true => Ok(Radius::Pixels(pixels)),
            false => Err("points have at most 4096 pixels".into()),
        };
    }
    Ok(Radius::Value(
        positive(text).map_err(|_| "auto, a length above 0, scale:FACTOR, angle:DEGREES, angle:auto or px:PIXELS")?,
    ))
}

#[cfg(test)]
#[path = "parse_tests.rs"]
mod tests;
