//! Where the picture is taken from: orbits, explicit eyes, and a default view that frames what there is.

use clap::ValueEnum;
use glam::DVec3;

use surfel::load::Bounds;
use surfel::select::{DepthConvention, View};

use super::Usage;
use super::input::Ball;
use super::parse::Orbit;

/// What the user said about the viewpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pose {
    /// Nothing.
    Default,
    /// About the centre of the bounding sphere.
    Orbit(Orbit),
    /// From this azimuth and elevation \[degrees\], as near as everything fits.
    Framed { azimuth: f64, elevation: f64 },
    /// Between two points [world].
    LookAt { eye: DVec3, target: DVec3 },
    /// One of those that scans are measured from.
    Named(Named),
}

/// Views that mean the same for every scan, all along the default view's azimuth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Named {
    /// The bounding sphere is half as wide as the picture's smaller side.
    Distance,
    /// On a face of the robust box, looking level through its centre.
    Border,
    /// At the centre of the robust box, looking level.
    Centre,
}

/// What is to be seen.
pub struct Subject<'a> {
    /// Of all clouds.
    pub bounds: Bounds,
    /// A sample of the splats, for framing.
    pub balls: &'a [Ball],
    /// Where the scanner stood, if it is known.
    pub viewpoint: Option<DVec3>,
}

/// How it is seen.
#[derive(Debug, Clone, Copy)]
pub struct Lens {
    /// Unit vector.
    pub up: DVec3,
    /// Whether the user chose `up`; else another may be taken where it lies along the view.
    pub up_given: bool,
    /// Vertical angle \[rad\], if the user chose it.
    pub fov: Option<f64>,
    /// Width / height.
    pub aspect: f64,
}

/// Share of the picture that the default view leaves free on each side.
const MARGIN: f64 = 0.04;

/// Vertical angle of view \[rad\] from outside, and from inside, where there is more around.
const FOV: f64 = 45.0 / 180.0 * std::f64::consts::PI;
const FOV_INSIDE: f64 = 70.0 / 180.0 * std::f64::consts::PI;

/// Where the viewer stands unless told \[degrees\].
const AZIMUTH: f64 = 30.0;

/// Direction in which azimuth 0 looks: −Z where y is up, +Y where z is up, and the same turned over where the opposite is.
pub fn forward(up: DVec3) -> DVec3 {
    let size = up.abs();
    let look = if size.z >= size.x && size.z >= size.y {
        DVec3::Y * up.z.signum()
    } else if size.y >= size.x {
        DVec3::NEG_Z * up.y.signum()
    } else {
        DVec3::NEG_Z
    };
    (look - up * look.dot(up)).normalize()
}

/// Unit vectors towards the viewer and up in the picture. The second never vanishes, not even at the poles.
pub fn orbit_axes(up: DVec3, azimuth: f64, elevation: f64) -> (DVec3, DVec3) {
    let (sin_a, cos_a) = azimuth.to_radians().sin_cos();
    let (sin_e, cos_e) = elevation.to_radians().sin_cos();
    let out = -forward(up);
    let out = out * cos_a + up.cross(out) * sin_a;
    (out * cos_e + up * sin_e, up * cos_e - out * sin_e)
}

/// Refuses what no file can make right, before anything is read.
pub fn check(pose: Pose, up: Option<DVec3>) -> Result<(), Usage> {
    let Pose::LookAt { eye, target } = pose else { return Ok(()) };
    let towards = target - eye;
    // As exact as the coordinates are: 1e-12 of them.
    if towards.length() <= 1e-12 * eye.length().max(target.length()) {
        return Err(Usage("--eye and --target are the same place".into()));
    }
    if !towards.length_squared().is_normal() {
        return Err(Usage("--eye and --target are too near or too far for 64-bit floats".into()));
    }
    match up {
        Some(up) if up.cross(towards.normalize()).length() < 1e-6 => {
            Err(Usage("--up lies along the view from --eye to --target".into()))
        }
        _ => Ok(()),
    }
}

/// The view, and what was assumed to make it. `check` was passed.
pub fn view(pose: Pose, subject: &Subject, lens: &Lens) -> (View, Vec<String>) {
    let Bounds { center, .. } = subject.bounds;
    let radius = scale(subject);
    let mut said = Vec::new();
    let mut fov = lens.fov.unwrap_or(FOV);
    let (eye, back, up) = match pose {
        Pose::LookAt { eye, target } => {
            let back = (eye - target).normalize();
            let mut up = lens.up;
            if !lens.up_given && up.cross(back).length() < 1e-6 {
                up = forward(up);
                said.push("the view goes along up: the horizon's direction is up in the picture".into());
            }
            (eye, back, up)
        }
        Pose::Orbit(orbit) => {
            let (back, up) = orbit_axes(lens.up, orbit.azimuth, orbit.elevation);
            (center + back * (orbit.distance * radius), back, up)
        }
        Pose::Framed { azimuth, elevation } => {
            let (back, up) = orbit_axes(lens.up, azimuth, elevation);
            (fit(center, subject.balls, radius, back, up, [fov, lens.aspect]), back, up)
        }
        Pose::Named(named) => named_pose(named, subject, lens, fov),
        Pose::Default => default_pose(subject, lens, &mut fov, &mut said),
    };
    let projection = View::perspective(fov, lens.aspect, near(subject, eye));
    (View::facing(eye, back, up, projection, DepthConvention::Reversed), said)
}

/// The bounding radius, or what stands for it where all points are at one place.
fn scale(subject: &Subject) -> f64 {
    let radius = subject.bounds.radius;
    let largest = subject.balls.iter().map(|b| b.1).fold(0.0, f64::max);
    if radius > 0.0 {
        radius
    } else if largest > 0.0 {
        largest
    } else {
        1.0
    }
}

/// With reversed, infinite depth a float's precision does not depend on the near plane, so it lies as near as it can be
/// of use: within a fraction of a splat, that inside views lose nothing, but not so near that one splat before the eye
/// fills the picture from a distance that nobody meant.
fn near(subject: &Subject, eye: DVec3) -> f64 {
    let radius = scale(subject);
    let mut radii: Vec<f64> = subject.balls.iter().map(|b| b.1).filter(|r| *r > 0.0).collect();
    let middle = radii.len() / 2;
    let splat = match radii.is_empty() {
        true => radius,
        false => *radii.select_nth_unstable_by(middle, f64::total_cmp).1,
    };
    // From far away there is nothing near; the distance keeps the ratio of depths within an f32.
    let distance = (eye - subject.bounds.center).length() - radius;
    (1e-3 * radius).min(0.5 * splat).clamp(1e-7 * radius, radius).max(1e-6 * distance)
}

fn default_pose(subject: &Subject, lens: &Lens, fov: &mut f64, said: &mut Vec<String>) -> (DVec3, DVec3, DVec3) {
    let b = &subject.bounds;
    if let Some(eye) = subject.viewpoint.filter(|v| v.cmpgt(b.robust_min).all() && v.cmplt(b.robust_max).all()) {
        let azimuth = deepest(subject.balls, eye, lens.up);
        said.push(format!("the view is the scanner's, which stood inside, along azimuth {azimuth}"));
        *fov = lens.fov.unwrap_or(FOV_INSIDE);
        let (back, up) = orbit_axes(lens.up, azimuth, 0.0);
        return (eye, back, up);
    }
    let elevation = elevation(b, lens.up);
    let (back, up) = orbit_axes(lens.up, AZIMUTH, elevation);
    said.push(format!("view from azimuth {AZIMUTH}, elevation {elevation}, as near as everything fits"));
    (fit(b.center, subject.balls, scale(subject), back, up, [*fov, lens.aspect]), back, up)
}

/// Degrees above the horizon: flat things are looked at from higher up.
fn elevation(b: &Bounds, up: DVec3) -> f64 {
    let size = b.robust_max - b.robust_min;
    let height = size.dot(up.abs());
    let flat = height < 0.3 * (size.length_squared() - height * height).max(0.0).sqrt();
    if flat { 35.0 } else { 15.0 }
}

/// Eye, unit vector towards the viewer, and up in the picture. `fov` is vertical \[rad\].
fn named_pose(named: Named, subject: &Subject, lens: &Lens, fov: f64) -> (DVec3, DVec3, DVec3) {
    let b = &subject.bounds;
    let elevation = if named == Named::Distance { elevation(b, lens.up) } else { 0.0 };
    let (back, up) = orbit_axes(lens.up, AZIMUTH, elevation);
    let distance = match named {
        // The cone that touches the sphere has its tangent on the picture, and its sine in space.
        Named::Distance => scale(subject) / (0.5 * (0.5 * fov).tan() * lens.aspect.min(1.0)).atan().sin(),
        Named::Border => leave(0.5 * (b.robust_max - b.robust_min), back),
        Named::Centre => 0.0,
    };
    (b.center + back * distance, back, up)
}

/// How far from the centre of a box, given by half its size, a ray along a unit vector leaves it.
fn leave(half: DVec3, along: DVec3) -> f64 {
    // What is level only up to rounding leaves no flat box through its top.
    let sides = (0..3).filter(|&i| along[i].abs() > 1e-9).map(|i| half[i] / along[i].abs());
    sides.fold(f64::INFINITY, f64::min)
}

/// The azimuth, in steps of 15 degrees, in which what is seen from `eye` lies farthest away on average: from inside a
/// room, its longest side and not the wall beside the scanner.
fn deepest(balls: &[Ball], eye: DVec3, up: DVec3) -> f64 {
    let mut best = (0.0, f64::NEG_INFINITY);
    for azimuth in (0..24).map(|i| 15.0 * i as f64) {
        let look = -orbit_axes(up, azimuth, 0.0).0;
        let (mut sum, mut n) = (0.0, 0);
        for (p, _) in balls {
            let towards = *p - eye;
            let ahead = towards.dot(look);
            // About what the picture shows: 35 degrees to each side.
            if ahead > 0.8 * towards.length() {
                sum += ahead;
                n += 1;
            }
        }
        // A view of nothing is deep and dull.
        if n * 50 > balls.len() && sum / n as f64 > best.1 {
            best = (azimuth, sum / n as f64);
        }
    }
    best.0
}

/// The nearest eye from which all balls lie within the margins.
///
/// With x to the right and z towards the viewer, a ball lies left of the right side of the picture iff
/// x + z t + r √(1 + t²) ≤ e_x + e_z t, t the tangent of half the angle, and likewise for the other sides: four largest
/// values decide.
fn fit(center: DVec3, balls: &[Ball], radius: f64, back: DVec3, up: DVec3, [fov, aspect]: [f64; 2]) -> DVec3 {
    let right = up.cross(back).normalize();
    let up = back.cross(right);
    let tan = (0.5 * fov).tan() * (1.0 - 2.0 * MARGIN);
    let tan = [tan * aspect, tan];
    let mut most = [[f64::NEG_INFINITY; 2]; 2];
    let mut front = f64::NEG_INFINITY;
    for &(p, r) in balls {
        let p = p - center;
        let z = p.dot(back);
        front = front.max(z + r);
        for (axis, x) in [p.dot(right), p.dot(up)].into_iter().enumerate() {
            let t = tan[axis];
            let reach = z * t + r * (1.0 + t * t).sqrt();
            most[axis][0] = most[axis][0].max(x + reach);
            most[axis][1] = most[axis][1].max(-x + reach);
        }
    }
    if !front.is_finite() {
        return center + back * radius / (tan[0].min(tan[1])).atan().sin();
    }
    let [x, y] = most.map(|[plus, minus]| 0.5 * (plus - minus));
    let depth = |axis: usize| 0.5 * (most[axis][0] + most[axis][1]) / tan[axis];
    let z = depth(0).max(depth(1)).max(front + 1e-2 * radius);
    center + right * x + up * y + back * z
}

#[cfg(test)]
#[path = "camera_tests.rs"]
mod tests;
