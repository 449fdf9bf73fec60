//! What the picture looks like where the user leaves it open: chosen by what the scan has.

use glam::DVec3;

use surfel::load::PointCloud;
use surfel::style::{BackFaces, EyeDome, Footprint, Shading, Style, Tolerance};
use surfel::technique::{Blend, Technique};

use super::Usage;
use super::args::{ColorBy, Cull, LensArgs, LookArgs, Shade, TechniqueArgs};
use super::parse::Radius;

/// What the scan had of its own before anything was estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Has {
    /// Normals, or faces that give them.
    pub normals: bool,
    /// Colours.
    pub colors: bool,
    /// Return strengths that differ.
    pub intensity: bool,
    /// The file said that z is up.
    pub z_up: bool,
}

impl Has {
    /// Of all clouds together: most points decide about normals, one is enough for the rest.
    pub fn of(clouds: &[PointCloud]) -> Has {
        let all: usize = clouds.iter().map(PointCloud::len).sum();
        let faced = |c: &&PointCloud| c.normals.is_some() || c.mesh.as_ref().is_some_and(|m| !m.triangles.is_empty());
        let with: usize = clouds.iter().filter(faced).map(PointCloud::len).sum();
        let varies = |list: &Vec<f32>| list.iter().any(|v| *v != list[0]);
        Has {
            normals: 2 * with > all,
            colors: clouds.iter().any(|c| c.colors.is_some()),
            intensity: clouds.iter().filter_map(|c| c.intensity.as_ref()).any(varies),
            z_up: clouds.iter().any(|c| c.up.is_some_and(|u| u.z > 0.9)),
        }
    }
}

/// The blend that is meant. Pixels are for opaque points only.
pub fn technique(args: &TechniqueArgs, look: &LookArgs) -> Result<Technique, Usage> {
    let blend = match (look.radius, args.blend) {
        (Radius::Pixels(_), None | Some(Blend::Opaque)) => Blend::Opaque,
        (Radius::Pixels(_), Some(blend)) => {
            return Err(Usage(format!("--radius px:N is for --blend opaque: {blend} blends splats")));
        }
        (_, blend) => blend.unwrap_or(Technique::default().blend),
    };
    Ok(Technique {
        structure: args.structure,
        selection: args.selection,
        primitive: args.primitive,
        blend,
        ..Technique::default()
    })
}

/// The light, and a sentence if it was chosen here.
pub fn shade(args: &LookArgs, has: Has) -> (Shade, Option<String>) {
    match args.shade {
        Some(shade) => (shade, None),
        None if has.normals => {
            (Shade::Headlight, Some("light: headlight, since the input has normals or faces".into()))
        }
        None => (Shade::Edl, Some("light: eye-dome (edl), since the input's normals are only estimated".into())),
    }
}

/// What colours show, and a sentence if it was chosen here.
pub fn color(args: &LookArgs, has: Has) -> (ColorBy, Option<String>) {
    let (by, why) = match args.color {
        Some(by) => return (by, None),
        None if has.colors => return (ColorBy::Rgb, None),
        None if has.intensity && !has.normals => {
            (ColorBy::Intensity, "colour: intensity, since the input has no colours")
        }
        None if has.z_up && !has.normals => (ColorBy::Height, "colour: height, since the input has no colours"),
        None => return (ColorBy::Rgb, None),
    };
    (by, Some(why.into()))
}

/// Which way is up, whether the user said so, and a sentence if he did not.
pub fn up(args: &LensArgs, clouds: &[PointCloud]) -> (DVec3, bool, Option<String>) {
    if let Some(up) = args.up {
        return (up, true, None);
    }
    let told = clouds.iter().find_map(|c| c.up).map(|u| u.as_dvec3()).filter(|u| u.length_squared() > 0.0);
    let name = |u: DVec3| {
        let axes = [(DVec3::X, "x"), (DVec3::Y, "y"), (DVec3::Z, "z")];
        let named = axes.iter().flat_map(|&(a, n)| [(a, n.to_string()), (-a, format!("-{n}"))]).find(|(a, _)| *a == u);
        named.map_or_else(|| format!("{},{},{}", u.x, u.y, u.z), |(_, n)| n)
    };
    match told {
        Some(up) => (up.normalize(), false, Some(format!("{} is up, as the format has it", name(up.normalize())))),
        None => (DVec3::Y, false, Some("y is up, since the format does not say (--up z for the other habit)".into())),
    }
}

/// The style that the options ask for.
pub fn style(technique: &TechniqueArgs, look: &LookArgs, shade: Shade) -> Style {
    let TechniqueArgs { ellipse, sums, front, voronoi, interval, .. } = *technique;
    let threshold = technique.threshold.map_or(Style::default().threshold, |px| px as f32);
    Style { threshold, interval, ellipse, sums, front, voronoi, ..surface(look, shade) }
}

/// The style of the surface alone, whatever draws it.
pub fn surface(args: &LookArgs, shade: Shade) -> Style {
    let strength = args.edl.unwrap_or(if shade == Shade::Edl { 1.0 } else { 0.0 });
    Style {
        footprint: match args.radius {
            Radius::Pixels(size) => Footprint::Pixels(size),
            _ => Footprint::Splat,
        },
        tolerance: Tolerance { absolute: 0.0, relative: args.tolerance as f32 },
        back_faces: match args.cull {
            Cull::Auto => BackFaces::Auto,
            Cull::On => BackFaces::Cull,
            Cull::Off => BackFaces::Draw,
        },
        shading: match shade {
            Shade::None | Shade::Edl => Shading::None,
            Shade::Headlight => Shading::HEADLIGHT,
            Shade::Phong => Shading::PHONG,
        },
        eye_dome: (strength > 0.0).then(|| EyeDome { strength: strength as f32, ..EyeDome::default() }),
        ..Style::default()
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::super::args::{Cli, Command, PictureArgs};
    use super::*;

    fn args(more: &[&str]) -> PictureArgs {
        let line = ["surfel", "render", "a.ply", "-o", "b.png"].iter().chain(more);
        match Cli::try_parse_from(line).unwrap().command {
            Command::Render(args) => args.picture,
            _ => unreachable!("it says render"),
        }
    }

    #[test]
    fn light_and_colour_follow_the_scan() {
        let a = args(&[]);
        let mesh = Has { normals: true, ..Has::default() };
        let lidar = Has { intensity: true, z_up: true, ..Has::default() };
        let bare = Has { z_up: true, ..Has::default() };
        let photo = Has { colors: true, ..lidar };
        assert_eq!(
            [mesh, lidar, bare, photo].map(|h| shade(&a.look, h).0),
            [Shade::Headlight, Shade::Edl, Shade::Edl, Shade::Edl]
        );
        let colors = [mesh, lidar, bare, photo].map(|h| color(&a.look, h).0);
        assert_eq!(colors, [ColorBy::Rgb, ColorBy::Intensity, ColorBy::Height, ColorBy::Rgb]);
        // A mesh looks best as a shape, whatever else its vertices carry.
        assert_eq!(color(&a.look, Has { intensity: true, ..mesh }).0, ColorBy::Rgb);
        let told = args(&["--shade", "phong", "--color", "normal"]);
        assert_eq!(
            (shade(&told.look, lidar), color(&told.look, lidar)),
            ((Shade::Phong, None), (ColorBy::Normal, None))
        );
    }

    #[test]
    fn pixels_are_opaque() {
        let blend = |more: &[&str]| {
            let args = args(more);
            technique(&args.technique, &args.look).map(|t| t.blend)
        };
        assert_eq!(blend(&[]).unwrap(), Technique::default().blend);
        assert_eq!(blend(&["--radius", "px:2"]).unwrap(), Blend::Opaque);
        for weighted in ["two-pass", "fuzzy", "groups"] {
            assert!(blend(&["--radius", "px:2", "--blend", weighted]).is_err(), "{weighted}");
        }
        assert_eq!(surface(&args(&["--radius", "px:2"]).look, Shade::None).footprint, Footprint::Pixels(2.0));
    }

    #[test]
    fn eye_dome_goes_with_any_light() {
        assert_eq!(surface(&args(&[]).look, Shade::Headlight).eye_dome, None);
        assert_eq!(surface(&args(&[]).look, Shade::Edl).eye_dome, Some(EyeDome::default()));
        assert_eq!(surface(&args(&["--edl", "0.5"]).look, Shade::Headlight).eye_dome.map(|e| e.strength), Some(0.5));
        assert_eq!(surface(&args(&["--edl", "0"]).look, Shade::Edl).eye_dome, None);
    }

    #[test]
    fn up_is_told_or_guessed() {
        let mut cloud = PointCloud::default();
        assert_eq!(up(&args(&[]).view.lens, std::slice::from_ref(&cloud)).0, DVec3::Y);
        cloud.up = Some(glam::Vec3::NEG_Y);
        let (axis, given, said) = up(&args(&[]).view.lens, std::slice::from_ref(&cloud));
        assert!(axis == DVec3::NEG_Y && !given && said.unwrap().starts_with("-y is up"));
        assert_eq!(up(&args(&["--up", "-x"]).view.lens, &[cloud]), (DVec3::NEG_X, true, None));
    }
}
