//! Cases drawn from a seed: what nobody thought of.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, Vec3, dvec3};

use super::{Case, TARGET, Take, scenes};
use crate::load::PointCloud;
use crate::select::{DepthConvention, View};
use crate::style::{BackFaces, Ellipse, Footprint, Shading, Style, Tolerance};
use crate::technique::{Blend, PRESETS, Technique};

/// Draws with names.
struct Dice(u64);

impl Dice {
    fn unit(&mut self) -> f64 {
        scenes::random(&mut self.0) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Evenly spread over the octaves.
    fn scale(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }

    fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[((self.unit() * of.len() as f64) as usize).min(of.len() - 1)]
    }

    fn vector(&mut self) -> DVec3 {
        dvec3(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0))
    }
}

/// Scene, place, view, style and technique of this seed.
pub fn random(seed: u64) -> Case {
    let mut dice = Dice(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(1));
    // The first draws of neighbouring seeds are alike.
    for _ in 0..8 {
        dice.unit();
    }
    let technique = dice.one(PRESETS).1;
    let size = [dice.between(20.0, 180.0) as u32, dice.between(20.0, 140.0) as u32];
    let unit = dice.scale(1e-3, 1e3);
    let transform = DMat4::from_scale_rotation_translation(
        DVec3::splat(unit),
        DQuat::from_euler(
            glam::EulerRot::XYZ,
            dice.between(-3.0, 3.0),
            dice.between(-1.5, 1.5),
            dice.between(-3.0, 3.0),
        ),
        dice.scale(1e-3, 1e6) * dice.vector(),
    );
    let cloud = cloud(&mut dice);
    let at = transform.transform_point3(cloud.origin);
    let view = view(&mut dice, at, unit, size);
    let (style, gain) = style(&mut dice, technique, unit);
    let name = format!("seed {seed}: {} points, {:?}, {:?}", cloud.len(), style.footprint, style.shading);
    let case = Case::new("random", name, Take { cloud: Arc::new(cloud), transform, view, style, technique });
    let pixels = (size[0] * size[1]) as usize;
    // One in ten thousand; where discs and squares end and cut each other, as in tests/gpu/against_reference.rs.
    let few = match (technique.blend, style.footprint) {
        (_, Footprint::Pixels(_)) => pixels / 64,
        (Blend::Opaque, _) => 4 * pixels / 10_000,
        _ => pixels / 10_000,
    };
    let bound = if technique.blend == Blend::Opaque { 1e-5 } else { gain * TARGET };
    case.size(size[0], size[1])
        .covered(0)
        .ties(few.max(2))
        .bound(bound, "1e-4; lit: times what light makes of a normal")
}

/// Disks of all sizes and directions in a cube of side 2 about the origin.
fn cloud(dice: &mut Dice) -> PointCloud {
    let n = dice.scale(10.0, 800.0) as usize;
    let largest = dice.scale(1e-2, 1.0);
    let flat = dice.one(&[1.0, 1.0, 0.05]);
    let positions = (0..n).map(|_| (dice.vector() * dvec3(1.0, 1.0, flat)).as_vec3()).collect();
    let bare = dice.one(&[0.0, 0.1, 1.0]);
    let mut normal = || if dice.unit() < bare { Vec3::ZERO } else { dice.vector().as_vec3() };
    let normals = Some((0..n).map(|_| normal()).collect());
    let radii = Some((0..n).map(|_| (largest * dice.unit()) as f32).collect());
    let origin = dice.scale(1e-3, 1e6) * dice.vector();
    PointCloud { positions, normals, radii, colors: Some(scenes::random_colors(n)), origin, ..PointCloud::default() }
}

/// From within the cloud up to thirty of its radii away, through any lens.
fn view(dice: &mut Dice, at: DVec3, unit: f64, [width, height]: [u32; 2]) -> View {
    let aspect = width as f64 / height as f64;
    let back = dice.vector().try_normalize().unwrap_or(DVec3::Z);
    let up = back.any_orthonormal_vector();
    let distance = dice.scale(0.1, 30.0);
    let near = dice.scale(1e-3, 1.0) * distance * unit;
    let mut projection = match dice.one(&[true, true, false]) {
        true => View::perspective((3.0 / distance).clamp(0.05, 2.0) * dice.between(0.5, 1.2), aspect, near),
        false => View::orthographic(dice.between(0.5, 3.0) * unit, aspect, near, near + 40.0 * unit),
    };
    if projection.w_axis.w == 0.0 {
        (projection.z_axis.x, projection.z_axis.y) = (dice.between(-0.3, 0.3), dice.between(-0.3, 0.3));
    }
    let depth = if projection.w_axis.w == 0.0 && dice.unit() < 0.3 {
        (projection.z_axis.z, projection.w_axis.z) = (-1.0, -near);
        DepthConvention::Standard
    } else {
        DepthConvention::Reversed
    };
    View::facing(at + distance * unit * back, back, up, projection, depth)
}

/// A style, and what light makes of a displaced normal: the mean moves by up to 2 where a colour moves by 1.
fn style(dice: &mut Dice, technique: Technique, unit: f64) -> (Style, f64) {
    let (shading, gain) = dice.one(&[
        (Shading::None, 1.0),
        (Shading::HEADLIGHT, 3.0),
        // And a highlight of a quarter: cos³² has a slope of 3.4, and mirroring doubles the normal's turn.
        (Shading::PHONG, 3.0 + 0.25 * 3.4 * 2.0 * 2.0),
    ]);
    let footprint = match technique.blend {
        Blend::Opaque => dice.one(&[Footprint::Splat, Footprint::Splat, Footprint::Pixels(3.0)]),
        _ => Footprint::Splat,
    };
    let style = Style {
        footprint,
        ellipse: dice.one(&[Ellipse::Exact, Ellipse::Exact, Ellipse::Approximate]),
        tolerance: dice.one(&[
            Tolerance { absolute: 0.0, relative: 1.0 },
            Tolerance { absolute: 0.0, relative: 0.3 },
            Tolerance { absolute: (0.1 * unit) as f32, relative: 0.0 },
        ]),
        radius_scale: dice.scale(0.3, 2.0) as f32,
        low_pass: dice.one(&[1.0, 0.7, 2.0]),
        back_faces: dice.one(&[BackFaces::Draw, BackFaces::Cull]),
        shading,
        ..Style::default()
    };
    (style, gain)
}
