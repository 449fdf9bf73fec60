//! Inputs made ready to be drawn: read, joined where they are alike, completed, painted.

use std::path::Path;

use anyhow::{Context, Result, bail};

use glam::DVec3;
use surfel::load::attributes::{self, RadiusRule};
use surfel::load::{Bounds, PointCloud};
use surfel::select::View;
use surfel::structure::Flat;

use super::args::{ColorBy, LensArgs, LookArgs, Shade, ViewArgs};
use super::camera::{Lens, Pose, Subject};
use super::input::Ball;
use super::look::Has;
use super::parse::{Input, Radius};
use super::progress::Progress;
use super::{camera, color, input, look};

/// Clouds with all that a picture needs, and what was found out on the way.
pub struct Scene {
    /// Normals and radii are there; colours show what was asked for.
    pub clouds: Vec<PointCloud>,
    /// Of all clouds.
    pub bounds: Bounds,
    /// A sample of the splats, for framing.
    pub balls: Vec<Ball>,
    /// Where the scanner stood, if it is known.
    pub viewpoint: Option<DVec3>,
    /// The light that was chosen.
    pub shade: Shade,
    /// Unit vector.
    pub up: DVec3,
    /// Whether the user chose it.
    pub up_given: bool,
    /// What colours show.
    by: ColorBy,
    /// Points in the files.
    pub points_input: u64,
    /// One sentence for each thing that was assumed, dropped or repaired.
    pub assumed: Vec<String>,
}

impl Scene {
    /// Reads and completes everything.
    pub fn load(inputs: &[Input], lens: &LensArgs, look: &LookArgs, progress: &Progress) -> Result<Scene> {
        let read: Vec<PointCloud> = inputs.iter().map(|i| input::read(i, progress)).collect::<Result<_>>()?;
        Scene::complete(read, lens, look, progress)
    }

    /// Completes clouds that are in memory.
    pub fn complete(read: Vec<PointCloud>, lens: &LensArgs, look: &LookArgs, progress: &Progress) -> Result<Scene> {
        let mut clouds = input::join(read)?;
        let points_input = clouds.iter().map(|c| c.report.points_in_file).sum();
        let has = Has::of(&clouds);
        let (shade, shade_said) = look::shade(look, has);
        let (by, color_said) = look::color(look, has);
        let (up, up_given, up_said) = look::up(lens, &clouds);
        let Some(bounds) = input::bounds(&clouds) else { bail!("there is no point in the input") };
        for cloud in &mut clouds {
            complete(cloud, look.radius, shade, by, &bounds, progress);
        }
        let mut assumed = input::sentences(&clouds);
        assumed.extend([up_said, color_said, shade_said].into_iter().flatten());
        assumed.extend(color::paint(&mut clouds, by, up, &bounds)?);
        let balls = input::balls(&clouds, &bounds);
        let viewpoint = clouds.iter().find_map(|c| c.viewpoint);
        Ok(Scene { clouds, bounds, balls, viewpoint, shade, up, up_given, by, points_input, assumed })
    }

    /// The view that is asked for; what was assumed to make it is noted.
    pub fn view(&mut self, pose: Pose, fov: Option<f64>, [width, height]: [u32; 2]) -> View {
        let subject = Subject { bounds: self.bounds, balls: &self.balls, viewpoint: self.viewpoint };
        let lens = Lens {
            up: self.up,
            up_given: self.up_given,
            fov: fov.map(f64::to_radians),
            aspect: width as f64 / height as f64,
        };
        let (view, said) = camera::view(pose, &subject, &lens);
        self.assumed.extend(said);
        view
    }

    /// Completes a cloud that was made from this scene's, as those were.
    pub fn finish(&self, cloud: &mut PointCloud, look: &LookArgs, progress: &Progress) {
        complete(cloud, look.radius, self.shade, self.by, &self.bounds, progress);
    }

    /// What a renderer takes. One at a time: a cloud's arrays are given back as soon as they are packed.
    pub fn pack(self) -> Vec<Flat> {
        self.clouds.into_iter().map(|cloud| Flat::new(&cloud)).collect()
    }
}

/// The pose that the options ask for, refused where no file could make it right.
pub fn pose(args: &ViewArgs) -> Result<Pose, super::Usage> {
    let pose = match (args.orbit, args.eye, args.target) {
        _ if args.view.is_some() => args.view.map_or(Pose::Default, Pose::Named),
        (Some(orbit), ..) => Pose::Orbit(orbit),
        (_, Some(eye), Some(target)) => Pose::LookAt { eye, target },
        _ => Pose::Default,
    };
    camera::check(pose, args.lens.up)?;
    Ok(pose)
}

/// A name that is not there, or that an output would overwrite, is told before anything long begins.
pub fn readable(inputs: &[Input], outputs: &[&Path]) -> Result<()> {
    for input in inputs {
        if let Input::File(path) = input {
            std::fs::metadata(path).with_context(|| path.display().to_string())?;
            if outputs.iter().any(|o| super::output::same(path, o)) {
                bail!("{}: is an input, and would be overwritten", path.display());
            }
        }
    }
    Ok(())
}

/// Normals and radii, unless nothing in the picture depends on them.
fn complete(cloud: &mut PointCloud, radius: Radius, shade: Shade, by: ColorBy, bounds: &Bounds, progress: &Progress) {
    let rule = match radius {
        Radius::Auto => RadiusRule::Auto,
        Radius::Scale(scale) => RadiusRule::Scale(scale),
        Radius::Value(value) => RadiusRule::Value(value),
        Radius::Pixels(_) => {
            // The size on the screen is given; the radius only says which points are splats at all.
            let any = (1e-3 * bounds.radius) as f32;
            cloud.radii = Some(vec![if any > 0.0 && any.is_finite() { any } else { 1.0 }; cloud.len()]);
            if matches!(shade, Shade::None | Shade::Edl) && by != ColorBy::Normal {
                cloud.normals = None;
                return;
            }
            RadiusRule::Auto
        }
    };
    let step = progress.step("normals and radii", 1000);
    let told = |share| step.share(share);
    attributes::complete(cloud, &attributes::Options { radius: rule, progress: Some(&told), ..Default::default() });
}
