//! `surfel compare`: how a picture differs from the truth.

use std::path::Path;

use anyhow::{Context, Result, bail};
use serde_json::{Value, json};

use surfel::exr::{FloatPicture, MAGIC};
use surfel::measure::{Difference, Image, compare, difference, flip};

use super::args::{CompareArgs, ErrorMapKind};
use super::{Outcome, Usage, output};

/// Measures and tells. Different pictures are no failure; pictures that cannot be compared are.
pub fn run(args: &CompareArgs) -> Result<Outcome> {
    let [background @ .., 255] = args.background else {
        return Err(Usage("--background of a comparison is opaque: RRGGBB".into()).into());
    };
    if let Some(out) = &args.difference {
        if output::is_float(out)? {
            return Err(Usage(format!("{}: the name of the error's picture must end in .png", out.display())).into());
        }
        for input in [&args.truth, &args.picture] {
            if output::same(input, out) {
                bail!("{}: is an input, and would be overwritten", input.display());
            }
        }
        output::check(out)?;
    }
    let [truth, picture] = images([read(&args.truth)?, read(&args.picture)?], background);
    let names = || format!("{} and {}", args.truth.display(), args.picture.display());
    let d = compare(&truth, &picture, args.tolerance as f64 / 255.0).with_context(names)?;
    if let Some(out) = &args.difference {
        let rgb = error_picture(&truth, &picture, args.map).with_context(names)?;
        let rgba: Vec<u8> = rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        output::png(out, truth.width, truth.height, &rgba)?;
    }
    let text = if args.json { format!("{:#}\n", value(&d, args.tolerance)) } else { as_text(&d, args.tolerance) };
    super::print(&text)?;
    Ok(Outcome::Done)
}

/// A picture as its file has it.
enum Read {
    Bytes(Image),
    Floats(FloatPicture),
}

fn read(path: &Path) -> Result<Read> {
    let name = || path.display().to_string();
    let bytes = std::fs::read(path).with_context(name)?;
    if bytes.starts_with(&MAGIC) {
        return Ok(Read::Floats(FloatPicture::from_bytes(path, &bytes)?));
    }
    let decoded = image::load_from_memory(&bytes).with_context(name)?;
    let (width, height) = (decoded.width(), decoded.height());
    if width == 0 || height == 0 {
        bail!("{}: a picture without pixels", path.display());
    }
    Ok(Read::Bytes(match decoded.color().has_alpha() {
        true => Image::from_srgb8(width, height, 4, &decoded.to_rgba8()),
        false => Image::from_srgb8(width, height, 3, &decoded.to_rgb8()),
    }))
}

/// Floats are shown over the background. Bytes are taken as they are, unless the other has floats: then a transparent pixel's
/// colour, which nobody sees, must not count against the background.
fn images(pictures: [Read; 2], background: [u8; 3]) -> [Image; 2] {
    let floats = pictures.iter().any(|p| matches!(p, Read::Floats(_)));
    pictures.map(|picture| match picture {
        Read::Floats(floats) => Image::from_float(&floats, background),
        Read::Bytes(image) if floats => image.over(background),
        Read::Bytes(image) => image,
    })
}

/// sRGB bytes, three a pixel.
fn error_picture(truth: &Image, picture: &Image, map: ErrorMapKind) -> Result<Vec<u8>> {
    match map {
        ErrorMapKind::Absolute => Ok(difference::absolute(truth, picture, difference::GAIN)),
        ErrorMapKind::Flip => {
            Ok(flip::error_map(truth, picture).context("pictures too large for FLIP; use --map absolute")?.magma())
        }
    }
}

/// Decibels are null where the pictures are equal: JSON has no infinity.
pub fn value(d: &Difference, tolerance: u8) -> Value {
    let finite = |v: f64| v.is_finite().then_some(v);
    let (silhouette, interior, depth) = (d.silhouette, d.interior, d.depth);
    json!({
        "pixels": d.pixels,
        "equal": d.rmse == 0.0 && d.max_alpha.is_none_or(|a| a == 0.0) && depth.is_none_or(|z| z.is_equal()),
        "rmse": d.rmse,
        "psnr": finite(d.psnr),
        "ssim": d.ssim,
        "flip": d.flip,
        "max": d.max,
        "max_alpha": d.max_alpha,
        "covered": d.covered,
        "psnr_covered": d.psnr_covered.and_then(finite),
        "interior": interior.map(|i| i.pixels),
        "rmse_interior": interior.and_then(|i| i.rmse),
        "psnr_interior": interior.and_then(|i| i.psnr).and_then(finite),
        "covered_truth": silhouette.map(|s| s.covered),
        "outline": silhouette.map(|s| s.outline),
        "holes": silhouette.map(|s| s.holes),
        "holes_share": silhouette.and_then(|s| s.holes_share()),
        "holes_inside": silhouette.map(|s| s.holes_inside),
        "spill": silhouette.map(|s| s.spill),
        "spill_share": silhouette.and_then(|s| s.spill_share()),
        "depth": depth.map(|z| json!({
            "pixels": z.pixels,
            "only_truth": z.only_truth,
            "only_picture": z.only_picture,
            "median": z.median,
            "p99": z.p99,
            "max": z.max,
        })),
        "tolerance": tolerance,
        "over": d.over,
        "blank": d.blank,
    })
}

fn as_text(d: &Difference, tolerance: u8) -> String {
    let decibel = |v: f64| if v.is_finite() { format!("{v:.2} dB") } else { "infinite: equal".into() };
    let share = |v: Option<f64>| v.map_or(String::new(), |v| format!(", {:.2} % of the outline", 100.0 * v));
    let mut rows = vec![
        ("rmse", format!("{:.6} of the full range", d.rmse)),
        ("psnr", decibel(d.psnr)),
        ("ssim", d.ssim.map_or("none: smaller than 11 x 11".into(), |v| format!("{v:.6}"))),
    ];
    if let Some(flip) = d.flip {
        rows.push(("flip", format!("{flip:.6} on average, at 67 pixels a degree")));
    }
    rows.push(("max", format!("{:.1} of 255", d.max * 255.0)));
    rows.push(("over", format!("{} of {} pixels by more than {tolerance}", d.over, d.pixels)));
    if let (Some(covered), Some(psnr)) = (d.covered, d.psnr_covered) {
        rows.push(("covered", format!("{} over {covered} pixels", decibel(psnr))));
    }
    if let Some((interior, psnr)) = d.interior.and_then(|i| Some((i, i.psnr?))) {
        rows.push(("interior", format!("{} over {} pixels away from outlines", decibel(psnr), interior.pixels)));
    }
    if let Some(s) = d.silhouette {
        rows.push(("holes", format!("{} pixels{}; {} inside", s.holes, share(s.holes_share()), s.holes_inside)));
        rows.push(("spill", format!("{} pixels{}", s.spill, share(s.spill_share()))));
    }
    if let Some(z) = d.depth {
        if let (Some(median), Some(p99), Some(max)) = (z.median, z.p99, z.max) {
            let errors = format!("off by {median:.2e} (median), {p99:.2e} (99 %), {max:.2e} (largest) of itself");
            rows.push(("depth", format!("{errors} over {} pixels", z.pixels)));
        }
        rows.push(("depth in", format!("truth only {} pixels, picture only {}", z.only_truth, z.only_picture)));
    }
    if d.blank {
        rows.push(("blank", "both show one colour all over".into()));
    }
    rows.iter().map(|(name, value)| format!("{name:<8} {value}\n")).collect()
}
