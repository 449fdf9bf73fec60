//! Scene files: inputs that are drawn many times, each where it is put. What they look like is in `docs/FORMAT.md`.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use glam::{DMat4, DQuat, DVec3};
use serde_json::{Map, Value};

use super::parse::{self, Input};

/// A scene file's content.
#[derive(Debug, PartialEq)]
pub struct SceneFile {
    /// What is read: each once, whatever its names; not what is never drawn.
    pub inputs: Vec<Input>,
    /// A name of each input, for those who read messages.
    pub names: Vec<String>,
    /// What is drawn, in order.
    pub instances: Vec<Placed>,
}

/// A cloud where it is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Index of the input, later of the cloud.
    pub cloud: usize,
    /// World from the cloud's own: a scale, then a rotation, then a translation.
    pub transform: DMat4,
}

/// Most instances: each takes part in every frame on the processor.
pub const MAX_INSTANCES: usize = 1_000_000;

/// Largest coordinate: squares and sums of some stay finite.
const MAX_COORDINATE: f64 = 1e30;

/// Whether an input is a scene file, which its name decides.
pub fn is_scene(input: &Input) -> bool {
    matches!(input, Input::File(path) if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")))
}

/// Reads it. Errors name the file and the place in it, such as `scene.json: instances[2].scale`.
pub fn read(path: &Path) -> Result<SceneFile> {
    let file = path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(|| file.clone())?;
    parse(&text, path.parent().unwrap_or(Path::new(""))).with_context(|| file)
}

/// `folder` is what paths are relative to.
fn parse(text: &str, folder: &Path) -> Result<SceneFile> {
    let value: Value = serde_json::from_str(text)?;
    let top = Object::new("", &value, &["inputs", "instances"])?;
    let inputs = top.need("inputs", "an object of names and inputs")?;
    let named = inputs.as_object().filter(|o| !o.is_empty()).context("inputs: an object with at least one input")?;
    let read = |(name, v): (&String, &Value)| Ok((name.clone(), input(&format!("inputs.{name}"), v, folder)?));
    let named: Vec<(String, Input)> = named.iter().map(read).collect::<Result<_>>()?;
    let list = top.need("instances", "a list of instances")?;
    let list = list.as_array().filter(|l| !l.is_empty()).context("instances: a list with at least one instance")?;
    let mut scene = SceneFile { inputs: Vec::new(), names: Vec::new(), instances: Vec::new() };
    for (i, v) in list.iter().enumerate() {
        instance(&format!("instances[{i}]"), v, &named, &mut scene)?;
    }
    Ok(scene)
}

fn input(at: &str, v: &Value, folder: &Path) -> Result<Input> {
    let text = v.as_str().filter(|t| !t.is_empty()).with_context(|| format!("{at}: a path, or scene:NAME"))?;
    match parse::input(text.into()).map_err(|e| anyhow!("{at}: {e}"))? {
        Input::File(path) => {
            let input = Input::File(folder.join(path));
            if is_scene(&input) {
                bail!("{at}: {text} is a scene file, and there are no scenes in scenes");
            }
            Ok(input)
        }
        made => Ok(made),
    }
}

/// One entry of the list, with all that its grid repeats.
fn instance(at: &str, v: &Value, named: &[(String, Input)], scene: &mut SceneFile) -> Result<()> {
    let o = Object::new(at, v, &["of", "translate", "rotate", "scale", "grid"])?;
    let of = o.need("of", "the name of an input")?;
    let known = of.as_str().and_then(|name| named.iter().find(|(n, _)| n == name));
    let Some((name, input)) = known else { bail!("{at}.of: there is no input {of}") };
    let cloud = scene.inputs.iter().position(|i| i == input).unwrap_or_else(|| {
        scene.inputs.push(input.clone());
        scene.names.push(name.clone());
        scene.inputs.len() - 1
    });
    let translate = o.get("translate").map_or(Ok(DVec3::ZERO), |(at, v)| vector(&at, v))?;
    let rotate = o.get("rotate").map_or(Ok(DQuat::IDENTITY), |(at, v)| rotation(&at, v))?;
    let scale = match o.get("scale") {
        None => 1.0,
        Some((at, v)) => {
            let s = number(&at, v)?;
            if s <= 0.0 {
                bail!("{at}: must be more than 0");
            }
            if s < 1.0 / MAX_COORDINATE {
                bail!("{at}: must be at least {:e}", 1.0 / MAX_COORDINATE);
            }
            s
        }
    };
    let (count, step) = o.get("grid").map_or(Ok(([1; 3], DVec3::ZERO)), |(at, v)| grid(&at, v))?;
    let more = count.iter().fold(1u64, |all, &n| all.saturating_mul(n));
    if more.saturating_add(scene.instances.len() as u64) > MAX_INSTANCES as u64 {
        bail!("{at}: more than {MAX_INSTANCES} instances in all");
    }
    let [nx, ny, nz] = count;
    for (z, y, x) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (z, y, x)))) {
        let place = translate + step * DVec3::new(x as f64, y as f64, z as f64);
        let transform = DMat4::from_scale_rotation_translation(DVec3::splat(scale), rotate, place);
        scene.instances.push(Placed { cloud, transform });
    }
    Ok(())
}

/// `{"axis": [x, y, z], "degrees": a}`: right-handed about the axis, of any length but 0.
fn rotation(at: &str, v: &Value) -> Result<DQuat> {
    let o = Object::new(at, v, &["axis", "degrees"])?;
    let axis = vector(&format!("{at}.axis"), o.need("axis", "an axis [x, y, z]")?)?;
    let degrees = number(&format!("{at}.degrees"), o.need("degrees", "an angle")?)?;
    // By the largest component first: squares of tiny numbers vanish.
    let scaled = axis / axis.abs().max_element();
    if !scaled.is_finite() {
        bail!("{at}.axis: must not be of length zero");
    }
    Ok(DQuat::from_axis_angle(scaled.normalize(), (degrees % 360.0).to_radians()))
}

/// `{"count": [nx, ny, nz], "step": [x, y, z]}`.
fn grid(at: &str, v: &Value) -> Result<([u64; 3], DVec3)> {
    let o = Object::new(at, v, &["count", "step"])?;
    let wrong = || format!("{at}.count: three whole numbers of at least 1");
    let count = o.need("count", "three numbers of instances")?.as_array().with_context(wrong)?;
    let count: Vec<u64> =
        count.iter().map(|n| n.as_u64().filter(|n| *n > 0)).collect::<Option<_>>().with_context(wrong)?;
    let count: [u64; 3] = count.try_into().ok().with_context(wrong)?;
    let step = vector(&format!("{at}.step"), o.need("step", "a distance [x, y, z]")?)?;
    Ok((count, step))
}

/// Three numbers.
pub fn vector(at: &str, v: &Value) -> Result<DVec3> {
    let list = v.as_array().filter(|l| l.len() == 3).with_context(|| format!("{at}: three numbers [x, y, z]"))?;
    let mut out = DVec3::ZERO;
    for (i, v) in list.iter().enumerate() {
        out[i] = number(&format!("{at}[{i}]"), v)?;
    }
    Ok(out)
}

fn number(at: &str, v: &Value) -> Result<f64> {
    let n = v.as_f64().filter(|n| n.abs() <= MAX_COORDINATE);
    n.with_context(|| format!("{at}: a number of at most {MAX_COORDINATE:e} either way"))
}

/// An object without unknown keys, and where it is.
pub struct Object<'a> {
    at: String,
    map: &'a Map<String, Value>,
}

impl<'a> Object<'a> {
    pub fn new(at: &str, v: &'a Value, keys: &[&str]) -> Result<Object<'a>> {
        let name = if at.is_empty() { "the file" } else { at };
        let map = v.as_object().with_context(|| format!("{name}: an object with {}", keys.join(", ")))?;
        let object = Object { at: at.to_owned(), map };
        match map.keys().find(|key| !keys.contains(&key.as_str())) {
            Some(key) => bail!("{}: unknown; there are {}", object.place(key), keys.join(", ")),
            None => Ok(object),
        }
    }

    fn place(&self, key: &str) -> String {
        if self.at.is_empty() { key.to_owned() } else { format!("{}.{key}", self.at) }
    }

    fn get(&self, key: &str) -> Option<(String, &'a Value)> {
        Some((self.place(key), self.map.get(key)?))
    }

    pub fn need(&self, key: &str, what: &str) -> Result<&'a Value> {
        self.map.get(key).with_context(|| format!("{}: is missing: {what}", self.place(key)))
    }
}

#[cfg(test)]
#[path = "scene_file_tests.rs"]
mod tests;
