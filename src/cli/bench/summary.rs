//! Records of one way from all views, as one point in the plane of time and error.

use std::fmt::Write as _;

use surfel::measure::{self, Summary};

use super::ceiling::{self, Ceiling};
use super::record::Record;

/// One way to draw one input at one size, over all its views.
pub struct Point {
    /// What is drawn, and how large.
    pub scene: String,
    /// How.
    pub way: String,
    /// Mean over the views of the median time \[ms\].
    pub ms: f64,
    /// The same for the quartiles.
    pub quartiles: [f64; 2],
    /// Mean over the views of the median time of a whole frame \[ms\].
    pub frame_ms: f64,
    /// Points submitted a second \[millions\].
    pub rate: f64,
    /// What the device could do at best with as many points of that size, over the same views \[millions a second\]; `None`
    /// where that is not known for each of them.
    pub ceiling: Option<f64>,
    /// Root of the mean over the views of the squared RMSE.
    pub rmse: f64,
    /// The same over pixels whose neighbourhood is covered in both; `None` where no view has one.
    pub interior: Option<f64>,
    /// Mean over the views.
    pub flip: Option<f64>,
    pub ssim: Option<f64>,
    /// Sums over the views \[px\].
    pub holes: Option<f64>,
    pub spill: Option<f64>,
    pub outline: Option<f64>,
    /// Points that the faces were sampled at.
    pub samples: Option<u32>,
    /// The way without the number of samples.
    pub curve: String,
    /// The first view's, for pictures.
    pub first: Record,
}

/// Points in the order of their first records. Records without times are left out.
pub fn points(records: &[Record], ceilings: &[Ceiling]) -> Vec<Point> {
    let mut groups: Vec<(String, String, Vec<&Record>)> = Vec::new();
    for record in records {
        let c = &record.combination;
        let scene = format!("{}, {} x {} px", c.input, c.size[0], c.size[1]);
        let way = c.way();
        match groups.iter_mut().find(|(s, w, _)| (s, w) == (&scene, &way)) {
            Some((.., group)) => group.push(record),
            None => groups.push((scene, way, vec![record])),
        }
    }
    groups.into_iter().filter_map(|(scene, way, group)| point(scene, way, &group, ceilings)).collect()
}

fn point(scene: String, way: String, group: &[&Record], ceilings: &[Ceiling]) -> Option<Point> {
    let times: Vec<Summary> = group.iter().filter_map(|r| r.time()).collect();
    let n = times.len() as f64;
    let mean = |f: fn(&Summary) -> f64| times.iter().map(f).sum::<f64>() / n;
    let frames: Vec<Summary> = group.iter().filter_map(|r| Summary::of(&r.frame_ms)).collect();
    let errors = |key: &str| group.iter().filter_map(|r| r.error(key)).collect::<Vec<f64>>();
    let some = |v: Vec<f64>, f: fn(&[f64]) -> f64| (!v.is_empty()).then(|| f(&v));
    let average: fn(&[f64]) -> f64 = |v| v.iter().sum::<f64>() / v.len() as f64;
    let square: fn(&[f64]) -> f64 = |v| (v.iter().map(|x| x * x).sum::<f64>() / v.len() as f64).sqrt();
    let sum: fn(&[f64]) -> f64 = |v| v.iter().sum();
    let first = (*group.first()?).clone();
    let ms = (n > 0.0).then(|| mean(|s| s.median))?;
    let submitted = group.iter().map(|r| r.points_submitted as f64).sum::<f64>();
    // Times are added, not rates, here as in `rate`: their quotient is a share of the device's time.
    let at_best: Option<f64> = group.iter().map(|r| Some(r.points_submitted as f64 / ceiling::of(r, ceilings)?)).sum();
    let mut plain = first.combination.clone();
    let samples = plain.samples.take();
    Some(Point {
        scene,
        way,
        ms,
        quartiles: [mean(|s| s.lower), mean(|s| s.upper)],
        frame_ms: frames.iter().map(|s| s.median).sum::<f64>() / frames.len() as f64,
        rate: submitted / group.len() as f64 / ms * 1e-3,
        ceiling: at_best.map(|seconds| submitted / seconds * 1e-6),
        rmse: some(errors("rmse"), square)?,
        interior: some(errors("rmse_interior"), square),
        flip: some(errors("flip"), average),
        ssim: some(errors("ssim"), average),
        holes: some(errors("holes"), sum),
        spill: some(errors("spill"), sum),
        outline: some(errors("outline"), sum),
        samples,
        curve: plain.way(),
        first,
    })
}

/// For the terminal: a line a point, those on the front of time and RMSE marked.
pub fn table(records: &[Record], ceilings: &[Ceiling]) -> String {
    let points = points(records, ceilings);
    let mut text = String::new();
    for scene in scenes(&points) {
        let of: Vec<&Point> = points.iter().filter(|p| p.scene == scene).collect();
        let front = measure::pareto(&of.iter().map(|p| (p.ms, p.rmse)).collect::<Vec<_>>());
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{scene}");
        let _ = writeln!(
            text,
            "    {:<40} {:>9} {:>19} {:>10} {:>8} {:>8} {:>8} {:>7} {:>7}",
            "", "ms", "quartiles", "M points/s", "ceiling", "RMSE", "FLIP", "holes", "spill"
        );
        for (i, p) in of.iter().enumerate() {
            let number = |v: Option<f64>, digits: usize| v.map_or("-".into(), |v| format!("{v:.digits$}"));
            let _ = writeln!(
                text,
                "  {} {:<40} {:>9.2} {:>19} {:>10.2} {:>8} {:>8.5} {:>8} {:>7} {:>7}",
                if front.contains(&i) { '*' } else { ' ' },
                p.way,
                p.ms,
                format!("{:.2} to {:.2}", p.quartiles[0], p.quartiles[1]),
                p.rate,
                number(p.ceiling, 2),
                p.rmse,
                number(p.flip, 5),
                number(p.holes, 0),
                number(p.spill, 0),
            );
        }
    }
    if !text.is_empty() {
        text.push_str("* nothing else is both faster and nearer to the truth; ceiling: the device's own rate with squares of that size\n");
    }
    text
}

/// Scenes in order, each once.
pub fn scenes(points: &[Point]) -> Vec<String> {
    let mut scenes: Vec<String> = Vec::new();
    for point in points {
        if !scenes.contains(&point.scene) {
            scenes.push(point.scene.clone());
        }
    }
    scenes
}

#[cfg(test)]
mod tests {
    use super::super::record::tests::record;
    use super::*;

    #[test]
    fn views_are_averaged() {
        let a = record("t", 1.0, 0.3);
        let mut b = record("t", 3.0, 0.4);
        b.combination.view = [1, 2];
        let other = record("u", 5.0, 0.5);
        let points = points(&[a, b, other], &[]);
        assert_eq!(points.len(), 2);
        assert_eq!((points[0].ms, points[0].quartiles), (2.0, [1.5, 3.0]));
        // 10 points in 2 ms on average: 5000 a second.
        assert!((points[0].rate - 0.005).abs() < 1e-15);
        assert!((points[0].rmse - 0.125f64.sqrt()).abs() < 1e-12);
        assert_eq!((points[0].flip, points[0].ceiling), (None, None));
        let mut near = record("t", 3.0, 0.4);
        (near.combination.view, near.footprint) = ([1, 2], 16.0);
        let mut far = record("t", 1.0, 0.3);
        for r in [&mut far, &mut near] {
            r.combination.technique = "flat.two-pass.point".into();
        }
        let at = |r: &Record, rate: f64| Ceiling {
            case: ceiling::name(r).unwrap(),
            size: [64, 48],
            points: 10,
            points_per_second: vec![rate],
        };
        let both = [at(&far, 3e6), at(&near, 1e6)];
        let of = |c: &[Ceiling]| super::points(&[far.clone(), near.clone()], c)[0].ceiling;
        // 20 points, 10 at each rate: 3.3 and 10 µs.
        assert!((of(&both).unwrap() - 1.5).abs() < 1e-12);
        assert_eq!(of(&both[..1]), None);
        let text = table(&[record("t", 1.0, 0.3), record("u", 2.0, 0.4), record("v", 3.0, 0.1)], &[]);
        let marks: Vec<bool> = text.lines().skip(2).map(|l| l.starts_with("  *")).collect();
        assert_eq!(marks, [true, false, true, false], "{text}");
    }
}
