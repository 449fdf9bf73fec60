//! The report: one HTML file that needs nothing beside it.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use base64::Engine as _;
use image::imageops::FilterType;

use surfel::measure;

use super::args::SweepArgs;
use super::plot::{Plot, Series, svg};
use super::summary::{Point, points, scenes};
use super::sweep::{Stress, Sweep};

/// Larger side of the pictures in the report \[px\]. The folder has them in full.
const THUMBNAIL: u32 = 300;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;margin:2em auto;max-width:1180px;padding:0 1em;color:#1c1e21}\
h1{font-size:1.6em}h2{font-size:1.25em;margin-top:2.2em;border-bottom:1px solid #ddd}table{border-collapse:collapse;font-size:13px;margin:1em 0}\
td,th{padding:.25em .6em;text-align:right;border-bottom:1px solid #eee;white-space:nowrap}td:first-child,th:first-child{text-align:left}\
tr.front td{background:#eef6ee}figure{display:inline-block;margin:.4em;vertical-align:top}figcaption{font-size:12px;max-width:300px}\
img{display:block;image-rendering:auto}.plots svg{max-width:100%;height:auto}.note{color:#555;max-width:80ch}";

/// The whole page. `compared`: what became of an earlier run's times, as text.
pub fn html(sweep: &Sweep, args: &SweepArgs, out: &Path, compared: &str) -> Result<String> {
    let mut page = String::new();
    let device = &sweep.device;
    let all = points(&sweep.records, &sweep.ceilings);
    // Writing to a string cannot fail.
    let _ = write!(
        page,
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>surfel: time against error</title>\
         <style>{STYLE}</style></head><body>\n<h1>Time against error</h1>\n<p>surfel {}, {} ({})</p>\n",
        env!("CARGO_PKG_VERSION"),
        escape(&device.name),
        escape(&device.driver),
    );
    page += &timed(args, device.kind == "cpu");
    for scene in scenes(&all) {
        let of: Vec<&Point> = all.iter().filter(|p| p.scene == scene).collect();
        let _ = write!(page, "<h2>{}</h2>\n<p>Truth: {}.</p>\n", escape(&scene), escape(&of[0].first.truth));
        page += "<div class=\"plots\">";
        page += &plots(&of)?;
        page += "</div>\n";
        page += &table(&of);
        page += &pictures(&of, args, out)?;
    }
    if !compared.is_empty() {
        let _ = write!(page, "<h2>Against before</h2>\n<pre>{}</pre>\n", escape(compared.trim()));
    }
    if let Some(stress) = &sweep.stress {
        page += &stressed(stress);
    }
    page += "</body></html>\n";
    Ok(page)
}

/// What a time is, and what it is not.
fn timed(args: &SweepArgs, software: bool) -> String {
    let mut text = format!(
        "<p class=\"note\"><b>Timed:</b> the splat passes and the composite of a frame on the device, by its timestamps \
         (where it has none, the frame by the processor's clock). <b>Frame:</b> from the start of recording to the \
         device's completion. <b>Not timed:</b> loading, uploads, counting, reading back. The target has float colour \
         and depth. In each of {} rounds every combination drew one frame untimed and {} timed ones, in turn, so that a \
         disturbance meets all alike. Times are medians and quartiles, averaged over {} views.</p>\n",
        args.rounds,
        args.frames,
        args.views.len()
    );
    text += "<p class=\"note\"><b>Errors</b> are taken of sRGB-encoded values, 1 = from black to white, over the background, \
             against a supersampled truth in f64. <b>Interior:</b> pixels whose neighbourhood is covered in both. \
             <b>Holes:</b> the truth covers the pixel, the picture does not; <b>spill:</b> the reverse; sums over the views, \
             and in brackets as a share of the truth's outline.</p>\n";
    text += "<p class=\"note\"><b>Ceiling:</b> points a second of the device itself (<code>surfel bench raw</code>), measured \
             after the views with the same passes and attachments and squares of the footprints' root mean squared side: no disk, no \
             weight, no selection. In brackets the technique's rate as a share of it; what drops points without drawing \
             them, such as back faces, may exceed it.</p>\n";
    if software {
        text += "<p class=\"note\"><b>This device is a processor.</b> Its times say nothing about a GPU.</p>\n";
    }
    text
}

/// A coordinate of a point.
type Value = fn(&Point) -> Option<f64>;

fn plots(of: &[&Point]) -> Result<String> {
    let mut text = String::new();
    let sampled = of.iter().any(|p| p.samples.is_some());
    let curve = |y: Value, x: Value| {
        let mut series: Vec<Series> = Vec::new();
        for p in of {
            let (Some(x), Some(y)) = (x(p), y(p)) else { continue };
            match series.iter_mut().find(|s| s.name == p.curve) {
                Some(s) => s.points.push((x, y)),
                None => series.push(Series { name: p.curve.clone(), points: vec![(x, y)], line: false }),
            }
        }
        series.iter_mut().for_each(|s| s.line = s.points.len() > 1);
        series
    };
    let rmse: Value = |p| Some(p.rmse);
    for (name, error) in [("RMSE", rmse), ("mean FLIP", |p| p.flip)] {
        let pairs: Vec<(f64, f64)> = of.iter().map(|p| (p.ms, error(p).unwrap_or(f64::NAN))).collect();
        let front = measure::pareto(&pairs).into_iter().map(|i| pairs[i]).collect();
        let title = format!("Time against {name}");
        let plot = Plot {
            title: &title,
            x: "device time a frame, median [ms]",
            y: name,
            series: curve(error, |p| Some(p.ms)),
            front,
        };
        text += &svg(&plot)?.unwrap_or_default();
    }
    if sampled {
        let plot = Plot {
            title: "Convergence: points against RMSE in the interior",
            x: "points",
            y: "RMSE, interior",
            series: curve(|p| p.interior, |p| p.samples.map(f64::from)),
            front: Vec::new(),
        };
        text += &svg(&plot)?.unwrap_or_default();
    }
    Ok(text)
}

fn table(of: &[&Point]) -> String {
    let front = measure::pareto(&of.iter().map(|p| (p.ms, p.rmse)).collect::<Vec<_>>());
    let mut text = String::from(
        "<table><tr><th>technique</th><th>device [ms]</th><th>quartiles</th><th>frame [ms]</th><th>M points/s</th><th>ceiling</th>\
         <th>RMSE</th><th>PSNR [dB]</th><th>interior</th><th>FLIP</th><th>SSIM</th><th>holes</th><th>spill</th></tr>\n",
    );
    let number = |v: Option<f64>, digits: usize| v.map_or("–".into(), |v| format!("{v:.digits$}"));
    for (i, p) in of.iter().enumerate() {
        let share = |v: Option<f64>| match (v, p.outline) {
            (Some(v), Some(outline)) if outline > 0.0 => format!("{v:.0} ({:.1} %)", 100.0 * v / outline),
            _ => number(v, 0),
        };
        let _ = writeln!(
            text,
            "<tr{}><td>{}</td><td>{:.2}</td><td>{:.2} – {:.2}</td><td>{:.2}</td><td>{:.2}</td><td>{}</td><td>{:.5}</td><td>{}</td>\
             <td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            if front.contains(&i) { " class=\"front\"" } else { "" },
            escape(&p.way),
            p.ms,
            p.quartiles[0],
            p.quartiles[1],
            p.frame_ms,
            p.rate,
            p.ceiling.map_or("–".into(), |c| format!("{c:.2} ({:.0} %)", 100.0 * p.rate / c)),
            p.rmse,
            if p.rmse > 0.0 { format!("{:.2}", -20.0 * p.rmse.log10()) } else { "equal".into() },
            number(p.interior, 5),
            number(p.flip, 5),
            number(p.ssim, 5),
            share(p.holes),
            share(p.spill),
        );
    }
    text + "</table>\n<p class=\"note\">Green: nothing else here is both faster and nearer to the truth.</p>\n"
}

/// The truth and every way, from the first view.
fn pictures(of: &[&Point], args: &SweepArgs, out: &Path) -> Result<String> {
    let mut text = String::new();
    let first = &of[0].first;
    let truth = surfel::exr::FloatPicture::read(out.join(&first.truth_file))?;
    let bytes = surfel::readback::encode(&truth.rgba, args.background);
    let truth = image::RgbaImage::from_raw(truth.width, truth.height, bytes).context("as many bytes as pixels")?;
    text += &figure(&truth, "truth")?;
    for p in of {
        let path = out.join(&p.first.picture);
        let picture = image::open(&path).with_context(|| path.display().to_string())?.to_rgba8();
        text += &figure(&picture, &format!("{}, {:.2} ms, RMSE {:.5}", p.way, p.ms, p.rmse))?;
    }
    Ok(text + "\n")
}

/// Every case of the stress suite, against the f64 reference.
fn stressed(cases: &[Stress]) -> String {
    let failed = cases.iter().filter(|c| !c.outcome.passed()).count();
    let mut text = format!(
        "<h2>Numerical stress</h2>\n<p class=\"note\">{} cases against the f64 reference, {failed} failed. Error: the \
         largest of a channel at a pixel that is no tie, 1 = full range. Ties: pixels within rounding of a decision, and \
         those of them that are off by more than the bound.</p>\n<table><tr><th>case</th><th>error</th><th>bound</th>\
         <th>twin</th><th>pixels</th><th>ties</th><th>off</th><th>verdict</th><th>where the bound comes from</th></tr>\n",
        cases.len()
    );
    for Stress { name, group, why, outcome: o } in cases {
        let verdict = if o.passed() { "passed".into() } else { o.faults.join("; ") };
        let twin = o.worst_twin.map_or("–".into(), |t| format!("{t:.1e}"));
        let _ = writeln!(
            text,
            "<tr><td>{}: {}</td><td>{:.1e}</td><td>{:.1e}</td><td>{twin}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>\
             <td style=\"text-align:left;white-space:normal\">{}</td></tr>",
            escape(group),
            escape(name),
            o.worst,
            o.bound,
            o.pixels,
            o.ties,
            o.off_ties,
            escape(&verdict),
            escape(why),
        );
    }
    text + "</table>\n"
}

fn figure(picture: &image::RgbaImage, caption: &str) -> Result<String> {
    let (width, height) = picture.dimensions();
    let scale = (THUMBNAIL as f64 / width.max(height) as f64).min(1.0);
    let side = |v: u32| ((v as f64 * scale).round() as u32).max(1);
    let small = image::imageops::resize(picture, side(width), side(height), FilterType::CatmullRom);
    let mut png = Vec::new();
    small.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)?;
    let data = base64::engine::general_purpose::STANDARD.encode(png);
    let caption = escape(caption);
    Ok(format!(
        "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>\n"
    ))
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
