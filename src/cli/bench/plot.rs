//! Plots as SVG text.

use std::ops::Range;

use anyhow::{Result, anyhow};
use plotters::prelude::*;

/// Of the plot, and of the names beside it \[px\].
const WIDTH: u32 = 620;
const LEGEND: u32 = 330;
/// At least; as high as the names ask for.
const HEIGHT: u32 = 420;

/// Where the first name stands, and from name to name \[px\].
const TOP: u32 = 45;
const LINE: u32 = 18;

/// Values of one kind.
pub struct Series {
    pub name: String,
    pub points: Vec<(f64, f64)>,
    /// Joined by a line.
    pub line: bool,
}

/// A plot with logarithmic axes.
pub struct Plot<'a> {
    pub title: &'a str,
    pub x: &'a str,
    pub y: &'a str,
    pub series: Vec<Series>,
    /// Drawn as a line of steps: from each point the next is faster or better only by giving up the other.
    pub front: Vec<(f64, f64)>,
}

/// Okabe and Ito 2008: told apart with any colour vision.
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(60, 60, 60),
];

/// The plot; `None` where nothing is above zero in both axes.
pub fn svg(plot: &Plot) -> Result<Option<String>> {
    let shown = |p: &&(f64, f64)| p.0 > 0.0 && p.1 > 0.0 && p.0.is_finite() && p.1.is_finite();
    let all: Vec<(f64, f64)> = plot.series.iter().flat_map(|s| &s.points).filter(shown).copied().collect();
    if all.is_empty() {
        return Ok(None);
    }
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let (low, high) = all.iter().map(pick).fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        // A fifth of an octave at least, that equal values make an axis too.
        let room = (high / low).powf(0.12).max(1.15);
        low / room..high * room
    };
    let mut text = String::new();
    {
        let wrong = |e: &dyn std::fmt::Display| anyhow!("plot: {e}");
        let height = HEIGHT.max(TOP + LINE * plot.series.len() as u32);
        let root = SVGBackend::with_string(&mut text, (WIDTH + LEGEND, height)).into_drawing_area();
        root.fill(&WHITE).map_err(|e| wrong(&e))?;
        let (area, legend) = root.split_horizontally(WIDTH);
        let (x, y) = (range(|p| p.0), range(|p| p.1));
        let (x_ticks, y_ticks) = (ticks(&x), ticks(&y));
        let mut chart = ChartBuilder::on(&area)
            .caption(plot.title, ("sans-serif", 17))
            .margin(10)
            .x_label_area_size(40)
            .y_label_area_size(70)
            .build_cartesian_2d(x.log_scale().with_key_points(x_ticks), y.log_scale().with_key_points(y_ticks))
            .map_err(|e| wrong(&e))?;
        chart
            .configure_mesh()
            .x_desc(plot.x)
            .y_desc(plot.y)
            .x_label_formatter(&|v| short(*v))
            .y_label_formatter(&|v| short(*v))
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(225, 225, 225))
            .draw()
            .map_err(|e| wrong(&e))?;
        let mut steps: Vec<(f64, f64)> = Vec::new();
        for p in plot.front.iter().filter(shown) {
            if let Some(&(_, y)) = steps.last() {
                steps.push((p.0, y));
            }
            steps.push(*p);
        }
        chart.draw_series(LineSeries::new(steps, RGBColor(150, 150, 150).stroke_width(2))).map_err(|e| wrong(&e))?;
        for (i, series) in plot.series.iter().enumerate() {
            let color = COLORS[i % COLORS.len()];
            let points: Vec<(f64, f64)> = series.points.iter().filter(shown).copied().collect();
            if series.line {
                chart.draw_series(LineSeries::new(points.clone(), color.stroke_width(2))).map_err(|e| wrong(&e))?;
            }
            // Beyond the colours the shapes differ: full, then hollow.
            let fill = if (i / COLORS.len()).is_multiple_of(2) { color.filled() } else { color.stroke_width(2) };
            chart.draw_series(points.iter().map(|p| Circle::new(*p, 5, fill))).map_err(|e| wrong(&e))?;
            let y = (TOP + LINE * i as u32) as i32;
            legend.draw(&Circle::new((12, y), 5, fill)).map_err(|e| wrong(&e))?;
            let name = Text::new(series.name.as_str(), (24, y - 6), ("sans-serif", 13).into_font());
            legend.draw(&name).map_err(|e| wrong(&e))?;
        }
        root.present().map_err(|e| wrong(&e))?;
    }
    Ok(Some(text))
}

/// Some five to ten round numbers in a range above zero: multiples of a step within a decade, else 1, 2 and 5 times powers
/// of ten, or these powers alone.
fn ticks(range: &Range<f64>) -> Vec<f64> {
    let (low, high) = (range.start, range.end);
    let decades = (high / low).log10();
    if decades < 1.0 {
        let rough = (high - low) / 6.0;
        let power = 10f64.powi(rough.log10().floor() as i32);
        let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough).unwrap_or(rough);
        return ((low / step).ceil() as i64..=(high / step).floor() as i64).map(|k| k as f64 * step).collect();
    }
    let mantissas: &[f64] = if decades < 4.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let all = powers.flat_map(|p| mantissas.iter().map(move |m| m * 10f64.powi(p)));
    all.filter(|t| range.contains(t)).collect()
}

/// Three digits, and an exponent only where it is shorter.
fn short(v: f64) -> String {
    if (1e-3..1e7).contains(&v) {
        let digits = (2 - v.log10().floor() as i32).max(0) as usize;
        let text = format!("{v:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{v:.1e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_is_drawn() {
        let series = |points: &[(f64, f64)]| Series { name: "a & b".into(), points: points.to_vec(), line: false };
        let plot = |series| Plot { title: "t", x: "ms", y: "RMSE", series, front: vec![(1.0, 0.5), (2.0, 0.25)] };
        let text = svg(&plot(vec![series(&[(1.0, 0.5), (2.0, 0.25), (3.0, 0.0)])])).unwrap().unwrap();
        // Two points and one mark in the legend; zero has no logarithm.
        assert_eq!(text.matches("<circle").count(), 3);
        assert!(text.contains("a &amp; b") && text.contains("RMSE"));
        // However many there are, the last name is within the picture.
        let many = svg(&plot((0..40).map(|_| series(&[(1.0, 0.5)])).collect())).unwrap().unwrap();
        let number = |text: &str, key: &str| -> f64 {
            let value = &text[text.find(key).unwrap() + key.len()..];
            value[..value.find('"').unwrap()].parse().unwrap()
        };
        let last = number(&many[many.rfind("<circle").unwrap()..], "cy=\"");
        assert!(last > 420.0 && last < number(&many, "height=\""), "{last}");
        assert!(svg(&plot(vec![series(&[(0.0, 1.0)])])).unwrap().is_none());
        assert!(svg(&plot(vec![series(&[(5.0, 1.0)])])).unwrap().is_some(), "a single point has an axis too");
    }

    #[test]
    fn ticks_are_round_and_enough() {
        assert_eq!(ticks(&(85.0..290.0)), [100.0, 150.0, 200.0, 250.0]);
        assert_eq!(ticks(&(0.8..60.0)), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0]);
        assert_eq!(ticks(&(2e-6..3.0)).len(), 6);
        for i in 0..200 {
            let low = 1.37f64.powi(i - 100);
            for ratio in [1.3, 2.0, 9.0, 11.0, 1e3, 1e5] {
                let n = ticks(&(low..low * ratio)).len();
                assert!((2..=12).contains(&n), "{low} {ratio}: {n}");
            }
        }
    }

    #[test]
    fn numbers_on_axes() {
        assert_eq!([0.05, 12.0, 250.0, 12345.0, 1e-5].map(short), ["0.05", "12", "250", "12345", "1.0e-5"]);
    }
}
