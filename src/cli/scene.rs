//! Inputs made ready to be drawn: read, joined where they are alike, completed, painted.

use std::path::Path;

use anyhow::{Context, Result, bail};

use glam::DVec3;
use surfel::load::attributes::{self, RadiusRule};
use surfel::load::{self, Bounds, Mesh, PointCloud};
use surfel::select::View;
use surfel::structure::{Arrangement, Flat};

use super::args::{ColorBy, LensArgs, LookArgs, Shade, ViewArgs};
use super::camera::{Lens, Pose, Subject};
use super::input::Ball;
use super::look::Has;
use super::parse::{Input, Radius};
use super::progress::Progress;
use super::scene_file::{self, Placed};
use super::{Usage, camera, color, input, look, placed};

/// Bytes of memory that a sample of the faces takes at its peak, on a device that is the processor: in `bench`, between 100 k and
/// 2 M samples, 287 more a sample.
pub const A_SAMPLE: u64 = 290;

/// What is to be read, and where it is drawn.
pub struct Source {
    pub inputs: Vec<Input>,
    /// By a scene file; else every input is where it is, and joined with those that are like it.
    placed: Option<Vec<Placed>>,
}

impl Source {
    /// What the inputs are: themselves, or what the only one says if that is a scene file. What is not there, or would be
    /// overwritten, is told before anything long begins.
    pub fn new(inputs: &[Input], storage: Arrangement, outputs: &[&Path]) -> Result<Source> {
        readable(inputs, outputs)?;
        if !inputs.iter().any(scene_file::is_scene) {
            return Ok(Source { inputs: inputs.to_vec(), placed: None });
        }
        let [Input::File(path)] = inputs else {
            return Err(Usage("a scene file (.json) is the only input: it names the others".into()).into());
        };
        if matches!(storage, Arrangement::FrontToBack | Arrangement::BackToFront) {
            return Err(
                Usage(format!("--storage {storage} is of one view, and a scene's clouds have many places")).into()
            );
        }
        let scene = scene_file::read(path)?;
        for (name, input) in scene.names.iter().zip(&scene.inputs) {
            let place = || format!("{}: inputs.{name}", path.display());
            readable(std::slice::from_ref(input), outputs).with_context(place)?;
        }
        Ok(Source { inputs: scene.inputs, placed: Some(scene.instances) })
    }

    /// Each input, in order.
    pub fn read(&self, progress: &Progress) -> Result<Vec<PointCloud>> {
        self.inputs.iter().map(|i| input::read(i, progress)).collect()
    }
}

/// Clouds with all that a picture needs, and what was found out on the way.
pub struct Scene {
    /// Normals and radii are there; colours show what was asked for.
    pub clouds: Vec<PointCloud>,
    /// What is drawn, in order.
    pub instances: Vec<Placed>,
    /// Of all instances.
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
        let source = Source { inputs: inputs.to_vec(), placed: None };
        Scene::complete(source.read(progress)?, source, lens, look, progress)
    }

    /// Completes what was read of the source.
    pub fn complete(
        read: Vec<PointCloud>,
        source: Source,
        lens: &LensArgs,
        look: &LookArgs,
        progress: &Progress,
    ) -> Result<Scene> {
        // What is drawn in different places shares no seam.
        let mut clouds = if source.placed.is_some() { input::handled(read)? } else { input::join(read)? };
        if look.scanner.is_some() {
            clouds.iter_mut().for_each(|cloud| cloud.viewpoint = look.scanner);
        }
        if look.radius == Radius::Angular(None) && clouds.iter().any(|c| c.angular_step.is_none()) {
            let why = "--radius angle:auto: the input does not tell the scanner's angular step (--radius angle:DEG)";
            return Err(Usage(why.into()).into());
        }
        if matches!(look.radius, Radius::Angular(_)) && clouds.iter().any(|c| c.viewpoint.is_none()) {
            bail!("--radius angle:DEG: where the scanner stood is not known (--scanner x,y,z)");
        }
        let points_input = clouds.iter().map(|c| c.report.points_in_file).sum();
        let has = Has::of(&clouds);
        let (shade, shade_said) = look::shade(look, has);
        let (by, color_said) = look::color(look, has);
        let (up, up_given, up_said) = look::up(lens, &clouds);
        let Some(bounds) = input::bounds(&clouds) else { bail!("there is no point in the input") };
        if source.placed.is_some() && clouds.iter().any(PointCloud::is_empty) {
            bail!("there is no point in an input of the scene");
        }
        for cloud in &mut clouds {
            complete(cloud, look.radius, shade, by, &bounds, progress);
        }
        let mut assumed = input::sentences(&clouds);
        assumed.extend([up_said, color_said, shade_said].into_iter().flatten());
        assumed.extend(color::paint(&mut clouds, by, up, &bounds)?);
        if source.placed.is_some() && by == ColorBy::Height {
            assumed.push("heights are those in the inputs' own coordinates, the same for every instance".into());
        }
        let instances = source.placed.unwrap_or_else(|| placed::as_read(clouds.len()));
        // As read, every point counts for the bounds; a forest is too many.
        let moved = placed::moved(&instances, clouds.len());
        let bounds = if moved { placed::bounds(&clouds, &instances) } else { bounds };
        placed::countable(&clouds, &instances)?;
        let balls = match moved {
            true => placed::balls(&clouds, &instances, &bounds),
            false => input::balls(&clouds, &bounds),
        };
        // Of many scanners none is the viewer.
        let viewpoint = match instances.as_slice() {
            [one] => clouds[one.cloud].viewpoint.map(|v| one.transform.transform_point3(v)),
            _ if moved => None,
            _ => clouds.iter().find_map(|c| c.viewpoint),
        };
        Ok(Scene { clouds, instances, bounds, balls, viewpoint, shade, up, up_given, by, points_input, assumed })
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

    /// So many points on the faces of the only cloud, completed as that was.
    pub fn sampled(&self, points: u32, look: &LookArgs, progress: &Progress) -> Result<PointCloud> {
        let _step = progress.step(format!("{points} samples"), 1);
        let [cloud] = self.clouds.as_slice() else { bail!("--samples: more than one cloud in the input") };
        if cloud.mesh.as_ref().is_none_or(|m| m.triangles.is_empty()) {
            bail!("--samples: the input has no faces");
        }
        let mut sampled = load::sample_mesh(cloud, points as usize, 1);
        self.finish(&mut sampled, look, progress);
        Ok(sampled)
    }

    /// A cloud of what this scene's stands for, completed and coloured as that was.
    pub fn show(&self, cloud: PointCloud, look: &LookArgs, progress: &Progress) -> Result<PointCloud> {
        let mut clouds = [cloud];
        self.finish(&mut clouds[0], look, progress);
        color::paint(&mut clouds, self.by, self.up, &self.bounds)?;
        let [cloud] = clouds;
        Ok(cloud)
    }

    /// What a renderer takes, and the faces. One at a time: a cloud's arrays are given back as soon as they are packed.
    pub fn pack(self) -> Vec<(Flat, Option<Mesh>)> {
        self.clouds.into_iter().map(|cloud| (Flat::new(&cloud), cloud.mesh)).collect()
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
        Radius::Angular(step) => match step.or(cloud.angular_step) {
            Some(step) => RadiusRule::Angular(step),
            None => RadiusRule::Auto,
        },
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
