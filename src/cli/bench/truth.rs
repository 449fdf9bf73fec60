//! What pictures are judged by: made once a view and size, kept as a float picture beside the results.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, bail};

use surfel::exr::FloatPicture;
use surfel::measure::Image;
use surfel::reference::{SAMPLES, Surface, supersampled};
use surfel::select::View;
use surfel::structure::{Cloud, Flat};
use surfel::style::Style;
use surfel::technique::Technique;

use super::super::reference::{self, SUPERSAMPLES};
use super::super::{output, placed, scene};
use super::args::TruthKind;

/// What truth is made from.
pub enum Source {
    Mesh(Vec<Surface>),
    Points(Vec<Arc<Flat>>),
}

impl Source {
    /// The kind that is asked for, or the better one that the scene has.
    pub fn new(kind: TruthKind, scene: &scene::Scene, flats: &[Arc<Flat>]) -> Result<Source> {
        if kind != TruthKind::Supersampled {
            let surfaces: Option<Vec<Surface>> = scene.clouds.iter().map(Surface::new).collect();
            match surfaces {
                Some(surfaces) => return Ok(Source::Mesh(surfaces)),
                None if kind == TruthKind::Mesh => bail!("--truth mesh: the input has no faces"),
                None => {}
            }
        }
        Ok(Source::Points(flats.to_vec()))
    }

    /// In words, for the report.
    pub fn name(&self) -> String {
        match self {
            Source::Mesh(_) => format!("ray cast of the faces, {SAMPLES} x {SAMPLES} samples a pixel"),
            Source::Points(_) => {
                format!("two-pass in f64 of all points, {SUPERSAMPLES} x {SUPERSAMPLES} samples a pixel")
            }
        }
    }

    /// The picture, from the file if it is there.
    pub fn picture(&self, file: &Path, view: &View, [width, height]: [u32; 2], style: &Style) -> Result<FloatPicture> {
        // Named after all that it depends on. What is missing or cannot be read any more is made anew.
        if let Ok(kept) = FloatPicture::read(file)
            && [kept.width, kept.height] == [width, height]
            && kept.depth.is_some()
        {
            return Ok(kept);
        }
        let picture = match self {
            Source::Mesh(surfaces) => {
                let all = placed::as_read(surfaces.len());
                reference::mesh(surfaces, &all, view, [width, height], style, SAMPLES)
            }
            Source::Points(flats) => {
                let clouds: Vec<Cloud> = flats.iter().map(|flat| Arc::clone(flat).into()).collect();
                let all = reference::on(&clouds, &placed::as_read(flats.len()));
                reference::splats(&all, view, [width, height], Technique::TWO_PASS, style, |scene| {
                    supersampled(scene, SUPERSAMPLES)
                })
            }
        };
        let float = output::from_reference(&picture, view);
        // Whole or not at all; an EXR has no background.
        output::picture(file, &float, [0; 4])?;
        Ok(float)
    }
}

/// For comparing, over a background.
pub fn image(picture: &FloatPicture, background: [u8; 4]) -> Image {
    let [r, g, b, _] = background;
    Image::from_float(picture, [r, g, b])
}

/// Where the truth of a view is kept, relative to the folder. `state` names all that it depends on beside view and size.
pub fn file(state: &str, view: &str, [width, height]: [u32; 2]) -> String {
    format!("truth/{:016x}-{view}-{width}x{height}.exr", super::hash(state))
}
