//! `surfel info`: what is in a scan, as it was read, with nothing estimated.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use glam::DVec3;
use serde_json::{Value, json};

use surfel::load::{Bounds, PointCloud};

use super::args::InfoArgs;
use super::parse::Input;
use super::progress::Progress;
use super::report::grouped;
use super::{Outcome, input, layered, scene_file};

/// Reads and tells.
pub fn run(args: &InfoArgs) -> Result<Outcome> {
    if let Input::File(path) = &args.input
        && scene_file::is_scene(&args.input)
    {
        return scene(path, args.json);
    }
    if layered::is_model(&args.input) {
        return layered::info(args);
    }
    if args.verify {
        return Err(layered::no_model());
    }
    let cloud = input::read(&args.input, &Progress::new(args.json))?;
    let name = name(&args.input);
    let bounds = Bounds::of(&cloud);
    let text = match args.json {
        true => format!("{:#}\n", as_json(&name, &cloud, bounds)),
        false => as_text(&name, &cloud, bounds),
    };
    super::print(&text)?;
    Ok(Outcome::Done)
}

/// What a scene file draws, with nothing read but itself.
fn scene(path: &Path, as_json: bool) -> Result<Outcome> {
    let scene = scene_file::read(path)?;
    let file = path.display().to_string();
    let all = scene.instances.len();
    let times = |cloud: usize| scene.instances.iter().filter(|p| p.cloud == cloud).count();
    let inputs = scene.names.iter().zip(&scene.inputs).enumerate();
    let inputs: Vec<_> = inputs.map(|(i, (id, input))| (id, name(input), times(i))).collect();
    let text = if as_json {
        let inputs: Vec<Value> =
            inputs.iter().map(|(id, input, n)| json!({"name": id, "input": input, "instances": n})).collect();
        format!("{:#}\n", json!({"file": file, "format": "scene", "inputs": inputs, "instances": all}))
    } else {
        let rows = inputs.iter().map(|(id, input, n)| format!("  {id:<12} {input}, {} times\n", grouped(*n as u64)));
        format!("{file}\n  {:<12} scene\n  {:<12} {}\n", "format", "instances", grouped(all as u64))
            + &rows.collect::<String>()
    };
    super::print(&text)?;
    Ok(Outcome::Done)
}

/// As it is written on the command line.
fn name(input: &Input) -> String {
    match input {
        Input::File(path) => path.display().to_string(),
        Input::Remote(address) => address.clone(),
        Input::Scene { name, points, seed } => format!("scene:{name}:{points}:{seed}"),
    }
}

/// Name of each attribute and whether it is there.
fn attributes(cloud: &PointCloud) -> [(&'static str, bool); 6] {
    [
        ("normals", cloud.normals.is_some()),
        ("radii", cloud.radii.is_some()),
        ("colors", cloud.colors.is_some()),
        ("opacity", cloud.opacity.is_some()),
        ("intensity", cloud.intensity.is_some()),
        ("classes", cloud.classes.is_some()),
    ]
}

fn triangles(cloud: &PointCloud) -> usize {
    cloud.mesh.as_ref().map_or(0, |m| m.triangles.len())
}

fn as_json(name: &str, cloud: &PointCloud, bounds: Option<Bounds>) -> Value {
    let vector = |v: DVec3| json!(v.to_array());
    let counts = |list: &[(String, u64)]| -> Value {
        list.iter().map(|(reason, count)| json!({"reason": reason, "count": count})).collect()
    };
    let there: Value = attributes(cloud).into_iter().map(|(n, b)| (n.to_owned(), json!(b))).collect();
    json!({
        "file": name,
        "format": cloud.report.format,
        "points_in_file": cloud.report.points_in_file,
        "points": cloud.len(),
        "triangles": triangles(cloud),
        "attributes": there,
        "origin": vector(cloud.origin),
        "up": cloud.up.map(|u| vector(u.as_dvec3())),
        "viewpoint": cloud.viewpoint.map(vector),
        "angular_step": cloud.angular_step,
        "box": bounds.map(|b| json!({"min": vector(b.min), "max": vector(b.max)})),
        "robust_box": bounds.map(|b| json!({"min": vector(b.robust_min), "max": vector(b.robust_max)})),
        "sphere": bounds.map(|b| json!({"center": vector(b.center), "radius": b.radius})),
        "dropped": counts(&cloud.report.dropped),
        "repaired": counts(&cloud.report.repaired),
        "assumed": cloud.report.assumed,
    })
}

fn as_text(name: &str, cloud: &PointCloud, bounds: Option<Bounds>) -> String {
    let mut text = format!("{name}\n");
    let mut row = |name: &str, value: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {name:<12} {value}");
    };
    let vector = |v: DVec3| format!("{:.6} {:.6} {:.6}", v.x, v.y, v.z);
    row("format", cloud.report.format.clone());
    row("points", format!("{} of {} in the file", grouped(cloud.len() as u64), grouped(cloud.report.points_in_file)));
    if triangles(cloud) > 0 {
        row("triangles", grouped(triangles(cloud) as u64));
    }
    let there: Vec<&str> = attributes(cloud).iter().filter(|(_, b)| *b).map(|(n, _)| *n).collect();
    row("attributes", if there.is_empty() { "positions only".into() } else { there.join(", ") });
    if let Some(up) = cloud.up {
        row("up", format!("{} {} {}", up.x, up.y, up.z));
    }
    if let Some(viewpoint) = cloud.viewpoint {
        row("scanner at", vector(viewpoint));
    }
    if let Some(step) = cloud.angular_step {
        row("angular step", format!("{:.4} degrees", step.to_degrees()));
    }
    if let Some(b) = bounds {
        row("box", format!("{} to {}", vector(b.min), vector(b.max)));
        row("robust box", format!("{} to {} (0.1 to 99.9 %)", vector(b.robust_min), vector(b.robust_max)));
        row("sphere", format!("{}, radius {:.6}", vector(b.center), b.radius));
    }
    for (reason, n) in &cloud.report.dropped {
        row("left out", format!("{}: {reason}", grouped(*n)));
    }
    for (reason, n) in &cloud.report.repaired {
        row("repaired", format!("{}: {reason}", grouped(*n)));
    }
    for line in &cloud.report.assumed {
        row("assumed", line.clone());
    }
    text
}
