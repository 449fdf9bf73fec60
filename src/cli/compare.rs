//! `surfel compare`: how two pictures differ.

use std::path::Path;

use anyhow::{Context, Result, bail};
use serde_json::json;

use surfel::measure::{Difference, Image, compare};

use super::Outcome;
use super::args::CompareArgs;

/// Measures and tells. Different pictures are no failure; pictures that cannot be compared are.
pub fn run(args: &CompareArgs) -> Result<Outcome> {
    let (a, b) = (read(&args.a)?, read(&args.b)?);
    let d = compare(&a, &b, args.tolerance as f64 / 255.0)
        .with_context(|| format!("{} and {}", args.a.display(), args.b.display()))?;
    let text = if args.json { as_json(&d, args.tolerance) } else { as_text(&d, args.tolerance) };
    super::print(&text)?;
    Ok(Outcome::Done)
}

fn read(path: &Path) -> Result<Image> {
    let name = || path.display().to_string();
    let decoded = image::ImageReader::open(path)
        .and_then(|r| r.with_guessed_format())
        .with_context(name)?
        .decode()
        .with_context(name)?;
    let (width, height) = (decoded.width(), decoded.height());
    if width == 0 || height == 0 {
        bail!("{}: a picture without pixels", path.display());
    }
    Ok(match decoded.color().has_alpha() {
        true => Image::from_srgb8(width, height, 4, &decoded.to_rgba8()),
        false => Image::from_srgb8(width, height, 3, &decoded.to_rgb8()),
    })
}

/// `psnr` is null where the pictures are equal: JSON has no infinity.
fn as_json(d: &Difference, tolerance: u8) -> String {
    let finite = |v: f64| v.is_finite().then_some(v);
    let value = json!({
        "pixels": d.pixels,
        "equal": d.rmse == 0.0 && d.max_alpha.is_none_or(|a| a == 0.0),
        "rmse": d.rmse,
        "psnr": finite(d.psnr),
        "ssim": d.ssim,
        "max": d.max,
        "max_alpha": d.max_alpha,
        "covered": d.covered,
        "psnr_covered": d.psnr_covered.and_then(finite),
        "tolerance": tolerance,
        "over": d.over,
        "blank": d.blank,
    });
    format!("{value:#}\n")
}

fn as_text(d: &Difference, tolerance: u8) -> String {
    let decibel = |v: f64| if v.is_finite() { format!("{v:.2} dB") } else { "infinite: equal".into() };
    let mut rows = vec![
        ("rmse", format!("{:.6} of the full range", d.rmse)),
        ("psnr", decibel(d.psnr)),
        ("ssim", d.ssim.map_or("none: smaller than 11 x 11".into(), |v| format!("{v:.6}"))),
        ("max", format!("{:.1} of 255", d.max * 255.0)),
        ("over", format!("{} of {} pixels by more than {tolerance}", d.over, d.pixels)),
    ];
    if let (Some(covered), Some(psnr)) = (d.covered, d.psnr_covered) {
        rows.push(("covered", format!("{} over {covered} pixels", decibel(psnr))));
    }
    if d.blank {
        rows.push(("blank", "both show one colour all over".into()));
    }
    rows.iter().map(|(name, value)| format!("{name:<8} {value}\n")).collect()
}
