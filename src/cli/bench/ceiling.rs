//! What the device does at best with as many points of that size: the ceiling beside every technique's rate.

use anyhow::Result;
use glam::DVec3;
use serde::Serialize;

use surfel::measure::Summary;
use surfel::select::View;
use surfel::standalone::Standalone;
use surfel::standalone::raw::{self, Case, Color, Passes, Vertices};
use surfel::structure::Cloud;
use surfel::style::Style;
use surfel::technique::{Blend, Primitive, Technique};

use super::super::progress::Progress;
use super::record::{Combination, Record};

/// Points that the root mean squared footprint is taken of, at least, where there are so many.
const FOOTPRINTS: usize = 10_000;

/// More points than these only take longer: the rate no longer changes.
const MOST_POINTS: u32 = 4_000_000;

/// A raw case at one size of picture.
#[derive(Debug, Clone, Serialize)]
pub struct Ceiling {
    /// As `surfel bench raw` names it.
    pub case: String,
    /// \[px\]
    pub size: [u32; 2],
    /// As many as the technique submitted.
    pub points: u64,
    /// Points a second, a value a round.
    pub points_per_second: Vec<f64>,
}

/// The case that does no more than this combination must: squares of the footprints' root mean squared side, with the same passes and
/// attachments. `None` for footprints of which the device's rate is not measured.
fn case(combination: &Combination, footprint: f64) -> Option<Case> {
    let technique = Technique::named(&combination.technique)?;
    let point = technique.primitive == Primitive::Point;
    // What every blend does at least: the layers' fold and the reading of attachments have no case.
    let passes = match technique.blend {
        Blend::Opaque | Blend::Groups => Passes::Opaque,
        Blend::TwoPass => Passes::TwoPass,
        _ => Passes::Color,
    };
    let side = footprint.round();
    (1.0..=raw::LARGEST as f64).contains(&side).then_some(Case {
        axis: "technique",
        primitive: technique.primitive,
        size: side as u32,
        vertices: if point { Vertices::F32x4 } else { Vertices::Pulled },
        passes,
        // Colour, and the surface that light or depth need: the bench's target has depth.
        attachments: 2,
        color: Color::Rgba32f,
        blend: passes != Passes::Opaque,
    })
}

/// Measures what the records need, each case once for a size and number of points.
pub fn measure(standalone: &Standalone, records: &[Record], rounds: u32, progress: &Progress) -> Result<Vec<Ceiling>> {
    let mut wanted: Vec<(raw::Setup, Vec<Case>)> = Vec::new();
    for record in records {
        let extent = record.combination.size;
        let Some(case) = case(&record.combination, record.footprint) else { continue };
        let fits = extent.iter().all(|side| (raw::LARGEST..=65_535).contains(side)) && standalone.enabled.timestamps;
        let points = u32::try_from(record.points_submitted).unwrap_or(0).min(MOST_POINTS);
        if !fits || points == 0 {
            continue;
        }
        let setup = raw::Setup { points, extent, rounds };
        match wanted.iter_mut().find(|(s, _)| *s == setup) {
            Some((_, cases)) if cases.contains(&case) => {}
            Some((_, cases)) => cases.push(case),
            None => wanted.push((setup, vec![case])),
        }
    }
    let mut ceilings = Vec::new();
    for (setup, cases) in wanted {
        let step = progress.step("ceilings", 1);
        for measured in raw::measure(standalone, &cases, &setup, |done, total| step.set(done, total))? {
            ceilings.push(Ceiling {
                case: measured.case.to_string(),
                size: setup.extent,
                points: setup.points as u64,
                points_per_second: measured.points_per_second(),
            });
        }
    }
    Ok(ceilings)
}

/// Of the case that is this record's ceiling.
pub fn name(record: &Record) -> Option<String> {
    Some(case(&record.combination, record.footprint)?.to_string())
}

/// Points a second that the device could do for this record, median.
pub fn of(record: &Record, ceilings: &[Ceiling]) -> Option<f64> {
    let name = name(record)?;
    let points = record.points_submitted.min(MOST_POINTS as u64);
    let size = record.combination.size;
    let ceiling = ceilings.iter().find(|c| c.case == name && c.size == size && c.points == points)?;
    Summary::of(&ceiling.points_per_second).map(|s| s.median)
}

/// Root of the mean squared side of the squares round the disks whose centres are in the picture \[px\]; 0 for none.
pub fn footprint(clouds: &[Cloud], view: &View, [_, height]: [u32; 2], style: &Style) -> f64 {
    let focal = view.focal(height as f64);
    let clip = view.projection * view.view;
    let (mut sum, mut n) = (0.0, 0);
    for flat in clouds.iter().map(Cloud::flat) {
        for i in (0..flat.len() as u32).step_by((flat.len() / FOOTPRINTS).max(1)) {
            let [x, y, z, r] = flat.point(i);
            let p = flat.origin + DVec3::new(x as f64, y as f64, z as f64);
            let c = clip * p.extend(1.0);
            let depth = -view.right_handed().view.transform_point3(p).z;
            if c.w > 0.0 && c.x.abs() <= c.w && c.y.abs() <= c.w && depth >= view.near() {
                let radius =
                    r as f64 * style.radius_scale as f64 * focal / if view.is_perspective() { depth } else { 1.0 };
                sum += (2.0 * radius.max(style.low_pass as f64)).powi(2);
                n += 1;
            }
        }
    }
    if n > 0 { (sum / n as f64).sqrt() } else { 0.0 }
}
