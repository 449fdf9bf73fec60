//! Ways of the camera: where it is in each frame, a function of the model's extent and the frame's number alone.

use std::f64::consts::TAU;
use std::path::Path as FilePath;

use anyhow::{Context, Result, bail};
use glam::{DQuat, DVec3};
use serde_json::Value;

use surfel::select::{DepthConvention, View};

use super::super::camera;
use super::super::scene_file::{Object, vector};
use super::extent::Extent;

/// Where the camera is, and a place that it looks at [world].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    pub eye: DVec3,
    pub target: DVec3,
}

/// A way.
#[derive(Debug, Clone, PartialEq)]
pub enum Path {
    /// A full turn about `up` through `centre`, from `centre + arm` on.
    Orbit { centre: DVec3, arm: DVec3, up: DVec3 },
    /// From `target + back * far` to `target + back * near` and away again, distances in proportion: the surface grows evenly.
    Approach { target: DVec3, back: DVec3, far: f64, near: f64 },
    /// Through these, at least one, in equal times.
    Keys(Vec<Key>),
}

/// Stations of a street, between which its height is interpolated.
const STATIONS: usize = 33;
/// Height over the ground, in lengths of the street: of a mile it is 8 m.
const EYE_LEVEL: f64 = 0.005;

impl Path {
    /// Round the model, at two radii, from azimuth 0 on, 25 degrees up; or as `start` says.
    pub fn orbit(extent: &Extent, start: Option<Key>) -> Path {
        let up = extent.axes[2];
        match start {
            Some(Key { eye, target }) => Path::Orbit { centre: target, arm: eye - target, up },
            None => {
                let (back, _) = camera::orbit_axes(up, 0.0, 25.0);
                Path::Orbit { centre: extent.centre, arm: back * (2.0 * extent.radius()), up }
            }
        }
    }

    /// From four radii, azimuth 30, 35 degrees up, to twice the size of the patch that is met there.
    pub fn approach(extent: &Extent, start: Option<Key>) -> Path {
        let (target, back, far, ball) = match start {
            Some(Key { eye, target }) => {
                let away = |at: DVec3| (at - target).length();
                let nearest = extent.leaves.iter().min_by(|a, b| away(a.centre).total_cmp(&away(b.centre)));
                (target, (eye - target).normalize(), (eye - target).length(), nearest.map_or(0.0, |l| l.ball))
            }
            None => {
                let (back, _) = camera::orbit_axes(extent.axes[2], 30.0, 35.0);
                let leaf = extent.surface(back);
                (leaf.centre, back, 4.0 * extent.radius(), leaf.ball)
            }
        };
        // A model of one point has a patch without size.
        Path::Approach { target, back, far, near: (2.0 * ball).clamp(1e-4 * far, far) }
    }

    /// Through the middle, along the longer horizontal side, over the ground that the leaves near each station have; or straight from
    /// `start`'s eye to its target.
    pub fn street(extent: &Extent, start: Option<Key>) -> Path {
        if let Some(Key { eye, target }) = start {
            let along = target - eye;
            return Path::Keys(vec![Key { eye, target }, Key { eye: target, target: target + along }]);
        }
        let [along, _, up] = extent.axes;
        let length = 2.0 * extent.half[0];
        let station = |i: usize| {
            // Not from end to end: beyond the last sample there is nothing to see.
            let share = 0.9 * (i as f64 / (STATIONS - 1) as f64 - 0.5);
            let place = extent.centre + along * (share * length);
            let ground = extent.ground(place, length / STATIONS as f64);
            let eye = place + up * (ground + EYE_LEVEL * length - place.dot(up));
            Key { eye, target: eye + along * length }
        };
        Path::Keys((0..STATIONS).map(station).collect())
    }

    /// The key frames of a file.
    pub fn read(path: &FilePath) -> Result<Path> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).with_context(|| file.clone())?;
        parse(&text).with_context(|| file)
    }

    /// Where the camera is in one of `frames` frames. What ends where it began does so in the frame after the last: laps follow
    /// each other without a jump.
    pub fn key(&self, frame: u32, frames: u32) -> Key {
        let turn = frame as f64 / frames as f64;
        match self {
            Path::Orbit { centre, arm, up } => {
                Key { eye: *centre + DQuat::from_axis_angle(*up, TAU * turn) * *arm, target: *centre }
            }
            Path::Approach { target, back, far, near } => {
                let way = 0.5 - 0.5 * (TAU * turn).cos();
                Key { eye: *target + *back * (far * (near / far).powf(way)), target: *target }
            }
            Path::Keys(keys) => {
                let share = if frames > 1 { frame as f64 / (frames - 1) as f64 } else { 0.0 };
                let at = share * (keys.len() - 1) as f64;
                Key { eye: smooth(keys, at, |k| k.eye), target: smooth(keys, at, |k| k.target) }
            }
        }
    }
}

/// A curve through all keys, that of number i at i: uniform cubics with the tangents of Catmull and Rom (1974); beyond the ends the
/// first and last differences go on, so two keys make a line at even speed.
fn smooth(keys: &[Key], at: f64, of: impl Fn(&Key) -> DVec3) -> DVec3 {
    let last = keys.len() as isize - 1;
    let point = |i: isize| -> DVec3 {
        let key = |i: isize| of(&keys[i.clamp(0, last) as usize]);
        match i {
            _ if i < 0 => 2.0 * key(0) - key(-i),
            _ if i > last => 2.0 * key(last) - key(2 * last - i),
            _ => key(i),
        }
    };
    let i = (at.floor() as isize).min((last - 1).max(0));
    let t = at - i as f64;
    let [a, b, c, d] = [i - 1, i, i + 1, i + 2].map(point);
    let (from, to) = (0.5 * (c - a), 0.5 * (d - b));
    let (t2, t3) = (t * t, t * t * t);
    b * (2.0 * t3 - 3.0 * t2 + 1.0) + from * (t3 - 2.0 * t2 + t) + c * (3.0 * t2 - 2.0 * t3) + to * (t3 - t2)
}

/// `{"keys": [{"eye": [x, y, z], "target": [x, y, z]}, …]}`.
fn parse(text: &str) -> Result<Path> {
    let value: Value = serde_json::from_str(text)?;
    let top = Object::new("", &value, &["keys"])?;
    let list = top.need("keys", "a list of places")?.as_array().filter(|l| !l.is_empty());
    let list = list.context("keys: a list of at least one place")?;
    let key = |(i, v): (usize, &Value)| {
        let at = format!("keys[{i}]");
        let o = Object::new(&at, v, &["eye", "target"])?;
        let place = |name: &str| vector(&format!("{at}.{name}"), o.need(name, "a place [x, y, z]")?);
        let key = Key { eye: place("eye")?, target: place("target")? };
        if !(key.target - key.eye).length_squared().is_normal() {
            bail!("{at}: eye and target are the same place, or nearly");
        }
        Ok(key)
    };
    Ok(Path::Keys(list.iter().enumerate().map(key).collect::<Result<_>>()?))
}

/// The lens of a fly-through, one for all frames.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    /// Vertical angle [rad].
    pub fov: f64,
    /// Width / height.
    pub aspect: f64,
    /// Distance of the near plane [world].
    pub near: f64,
    /// Unit.
    pub up: DVec3,
}

impl Camera {
    /// Near enough that no splat is cut that matters, as for single pictures; the same in every frame.
    pub fn new(extent: &Extent, fov: f64, aspect: f64) -> Camera {
        let radius = extent.radius();
        let near = (1e-3 * radius).min(0.5 * extent.spacing).clamp(1e-7 * radius, radius);
        Camera { fov, aspect, near, up: extent.axes[2] }
    }

    /// The view from a key. Where it looks along up the horizon's direction is up in the picture; where it looks nowhere,
    /// ahead.
    pub fn view(&self, key: Key) -> View {
        let ahead = camera::forward(self.up);
        let back = (key.eye - key.target).try_normalize().unwrap_or(-ahead);
        let up = if self.up.cross(back).length() < 1e-6 { ahead } else { self.up };
        let projection = View::perspective(self.fov, self.aspect, self.near);
        View::facing(key.eye, back, up, projection, DepthConvention::Reversed)
    }
}

#[cfg(test)]
#[path = "path_tests.rs"]
mod tests;
