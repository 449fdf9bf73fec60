//! What is measured: every value of every list with every other.

use std::fs;

use anyhow::{Context, Result};

use surfel::style::{Style, Tolerance};
use surfel::technique::{Blend, PRESETS, Technique};

use super::super::args::EllipseKind;
use super::super::camera::Pose;
use super::super::parse::Input;
use super::args::SweepArgs;
use super::record::Combination;

/// A combination with what draws it.
pub struct Way {
    pub combination: Combination,
    pub technique: Technique,
    pub style: Style,
}

/// What an input is called in results.
pub fn name(input: &Input) -> String {
    match input {
        Input::File(path) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        Input::Scene { name, points, seed } => format!("scene:{name}:{points}:{seed}"),
    }
}

/// What changes with an input's content.
pub fn state(input: &Input) -> Result<String> {
    let Input::File(path) = input else { return Ok("made".into()) };
    let about = fs::metadata(path).with_context(|| path.display().to_string())?;
    let time = about.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
    Ok(format!("{} bytes, time {}", about.len(), time.map_or(0, |t| t.as_secs())))
}

pub fn samples(args: &SweepArgs) -> Vec<Option<u32>> {
    match args.samples.is_empty() {
        true => vec![None],
        false => args.samples.iter().copied().map(Some).collect(),
    }
}

/// From all sides, in turn a little, well and steeply from above.
pub fn pose(number: u32, views: u32) -> Pose {
    let azimuth = 30.0 + 360.0 * number as f64 / views as f64;
    Pose::Framed { azimuth, elevation: [15.0, 35.0, 60.0][number as usize % 3] }
}

/// Every combination for one input, each once.
pub fn plan(args: &SweepArgs, input: &str, state: &str) -> Vec<Combination> {
    let techniques: Vec<&str> = PRESETS
        .iter()
        .filter(|(_, t)| args.techniques.is_empty() || args.techniques.contains(t))
        .map(|(name, _)| *name)
        .collect();
    let tolerances = if args.tolerances.is_empty() { vec![args.look.tolerance] } else { args.tolerances.clone() };
    let mut plan: Vec<Combination> = Vec::new();
    for &size in &args.sizes {
        for samples in samples(args) {
            for view in 0..args.views {
                for technique in &techniques {
                    for ellipse in &args.ellipses {
                        for &scale in &args.scales {
                            for &tolerance in &tolerances {
                                // `opaque` has no tolerance.
                                let opaque = Technique::named(technique).is_some_and(|t| t.blend == Blend::Opaque);
                                let tolerance = if opaque { 1.0 } else { tolerance };
                                let combination = Combination {
                                    input: input.to_owned(),
                                    input_state: state.to_owned(),
                                    samples,
                                    technique: (*technique).to_owned(),
                                    ellipse: match ellipse {
                                        EllipseKind::Exact => "exact".to_owned(),
                                        EllipseKind::Approximate => "approximate".to_owned(),
                                    },
                                    scale,
                                    tolerance,
                                    sums: "single".to_owned(),
                                    view: [view, args.views],
                                    size,
                                };
                                if !plan.contains(&combination) {
                                    plan.push(combination);
                                }
                            }
                        }
                    }
                }
            }
        }
    }
    plan
}

pub fn way(combination: &Combination, style: &Style) -> Result<Way> {
    let technique = Technique::named(&combination.technique).context("a preset of another version")?;
    let ellipse = if combination.ellipse == "exact" { EllipseKind::Exact } else { EllipseKind::Approximate };
    let style = Style {
        ellipse: ellipse.into(),
        radius_scale: combination.scale as f32,
        tolerance: Tolerance { absolute: 0.0, relative: combination.tolerance as f32 },
        ..*style
    };
    Ok(Way { combination: combination.clone(), technique, style })
}
