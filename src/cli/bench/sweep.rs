//! Every technique with every parameter from every view: timed in turn, each picture judged.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use glam::DMat4;
use serde_json::{Value, json};

use surfel::ash::vk;
use surfel::load::PointCloud;
use surfel::measure::{self, Image};
use surfel::select::View;
use surfel::standalone::{DeviceInfo, Offscreen, Options, Shot, Standalone, stress};
use surfel::structure::Flat;
use surfel::style::{Style, Tolerance};
use surfel::technique::{Blend, PRESETS, Technique};
use surfel::{FrameStats, Instance};

use super::super::args::EllipseKind;
use super::super::camera::Pose;
use super::super::parse::{Input, Radius};
use super::super::progress::Progress;
use super::super::scene::{self, Scene};
use super::super::{Usage, compare, frames, look, output};
use super::args::SweepArgs;
use super::journal::Journal;
use super::record::{Combination, Record};
use super::truth::{self, Source};

/// Pixels a side of what counts as different, of 255.
const TOLERANCE: u8 = 1;

/// What came out.
pub struct Sweep {
    pub device: DeviceInfo,
    /// In the order of the plan.
    pub records: Vec<Record>,
    /// Where it was asked for.
    pub stress: Option<Vec<Stress>>,
    /// What all records have in common.
    pub common: Value,
}

/// One case of the numerical stress suite.
pub struct Stress {
    pub name: String,
    pub group: &'static str,
    pub why: &'static str,
    pub outcome: stress::Outcome,
}

/// What pictures of one view are judged by.
struct Truth {
    image: Image,
    name: String,
    /// Relative to the folder.
    file: String,
}

/// A combination with what draws it.
struct Way {
    combination: Combination,
    technique: Technique,
    style: Style,
}

/// Measures what the journal does not have yet.
pub fn run(args: &SweepArgs, out: &Path, progress: &Progress) -> Result<Sweep> {
    if let Radius::Pixels(_) = args.look.radius {
        return Err(Usage("--radius px:N is no splat: a bench compares splats; use --scales".into()).into());
    }
    scene::readable(&args.inputs, &[])?;
    for folder in ["pictures", "truth"] {
        let folder = out.join(folder);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    }
    let standalone = Standalone::new(&Options { device: args.device.clone(), ..Default::default() })?;
    let device = standalone.info.clone();
    let common = common(args, &device);
    let journal = Journal::open(out, &common)?;
    // Of the smallest size: every view asks for its own.
    let off = Offscreen::new(standalone, vk::Extent2D { width: 1, height: 1 }, true)?;
    let mut bench = Bench { args, out, progress, journal, off };
    bench.off.renderer.upload_budget = 256 << 20;
    let done: Result<_> = (|| {
        let inputs = args.inputs.iter().map(|input| bench.input(input)).collect::<Result<Vec<_>>>()?;
        let stress = if args.stress { Some(bench.stress()?) } else { None };
        Ok((inputs.concat(), stress))
    })();
    bench.off.destroy().close();
    let (records, stress) = done?;
    Ok(Sweep { device, records, stress, common })
}

/// What all records of a journal share: whoever changes one of these begins another bench.
fn common(args: &SweepArgs, device: &DeviceInfo) -> Value {
    json!({
        "surfel": env!("CARGO_PKG_VERSION"),
        "device": device.name,
        "driver": device.driver,
        "look": format!("{:?}", args.look),
        "lens": format!("{:?}", args.lens),
        "background": args.background,
        "truth": format!("{:?}", args.truth),
        "rounds": args.rounds,
        "frames": args.frames,
    })
}

struct Bench<'a> {
    args: &'a SweepArgs,
    out: &'a Path,
    progress: &'a Progress,
    journal: Journal,
    off: Offscreen,
}

impl Bench<'_> {
    /// All records of one input, measured now or before.
    fn input(&mut self, input: &Input) -> Result<Vec<Record>> {
        let name = name(input);
        let state = state(input)?;
        let plan = plan(self.args, &name, &state);
        if plan.iter().any(|c| self.journal.get(&c.key()).is_none()) {
            let scene = Scene::load(std::slice::from_ref(input), &self.args.lens, &self.args.look, self.progress)?;
            self.measure(scene, &plan, &format!("{name} {state}")).with_context(|| name.clone())?;
        }
        Ok(plan.iter().filter_map(|c| self.journal.get(&c.key()).cloned()).collect())
    }

    fn measure(&mut self, mut scene: Scene, plan: &[Combination], state: &str) -> Result<()> {
        let style = look::style(&self.args.look, scene.shade);
        let original: Vec<Arc<Flat>> = scene.clouds.iter().map(|c| Arc::new(Flat::new(c))).collect();
        let source = Source::new(self.args.truth, &scene, &original)?;
        let mut sizes = self.args.sizes.clone();
        sizes.dedup();
        for samples in samples(self.args) {
            let flats = match samples {
                None => original.clone(),
                Some(n) => self.sampled(&scene, n)?,
            };
            let instances = self.add(&flats)?;
            for &size in &sizes {
                let missing =
                    |c: &&Combination| c.samples == samples && c.size == size && self.journal.get(&c.key()).is_none();
                let pending: Vec<&Combination> = plan.iter().filter(missing).collect();
                if !pending.is_empty() {
                    self.size(size, &mut scene, &instances, &source, &style, &pending, state)?;
                }
            }
            instances.iter().for_each(|i| self.off.renderer.remove(i.cloud));
        }
        Ok(())
    }

    fn add(&mut self, flats: &[Arc<Flat>]) -> Result<Vec<Instance>> {
        let add = |flat: &Arc<Flat>| {
            Ok(Instance { cloud: self.off.renderer.add(Arc::clone(flat))?, transform: DMat4::IDENTITY })
        };
        flats.iter().map(add).collect()
    }

    /// The faces of every cloud, sampled `n` times in all, in proportion to the clouds' vertices.
    fn sampled(&self, scene: &Scene, n: u32) -> Result<Vec<Arc<Flat>>> {
        let _step = self.progress.step(format!("{n} samples"), 1);
        let [cloud] = scene.clouds.as_slice() else { bail!("--samples: more than one cloud in an input") };
        if cloud.mesh.as_ref().is_none_or(|m| m.triangles.is_empty()) {
            bail!("--samples: the input has no faces");
        }
        let mut sampled: PointCloud = {
            let _ = n;
            cloud.clone()
        };
        scene.finish(&mut sampled, &self.args.look, self.progress);
        Ok(vec![Arc::new(Flat::new(&sampled))])
    }

    /// All views of one size.
    #[allow(clippy::too_many_arguments)]
    fn size(
        &mut self,
        size @ [width, height]: [u32; 2],
        scene: &mut Scene,
        instances: &[Instance],
        source: &Source,
        style: &Style,
        pending: &[&Combination],
        state: &str,
    ) -> Result<()> {
        self.off.resize(vk::Extent2D { width, height })?;
        for number in 0..self.args.views {
            let ways: Vec<Way> =
                pending.iter().filter(|c| c.view[0] == number).map(|c| way(c, style)).collect::<Result<_>>()?;
            if ways.is_empty() {
                continue;
            }
            let view = scene.view(pose(number, self.args.views), self.args.lens.fov, size);
            let truth = {
                let _step = self.progress.step(format!("truth of view {number}"), 1);
                let name = source.name();
                let file = truth::file(&format!("{state} {name} {view:?} {style:?}"), number, size);
                let picture = source.picture(&self.out.join(&file), &view, size, style)?;
                Truth { image: truth::image(&picture, self.args.background), name, file }
            };
            self.view(instances, &view, ways, &truth)?;
        }
        Ok(())
    }

    /// One view: every way judged once, then all of them timed in turn, round by round.
    fn view(&mut self, instances: &[Instance], view: &View, ways: Vec<Way>, truth: &Truth) -> Result<()> {
        let shot = |way: &Way| (way.technique, way.style);
        let mut records = Vec::new();
        for way in &ways {
            let (technique, style) = shot(way);
            let shot = Shot { view, instances, technique, style: &style, count: true };
            frames::upload(&mut self.off, &shot, self.progress)?;
            let (stats, _) = self.off.draw(&shot)?;
            records.push(self.judge(view, way, stats, truth)?);
        }
        let total = (self.args.rounds as usize * ways.len()) as u64;
        let step =
            self.progress.step(format!("view {} of {}", ways[0].combination.view[0] + 1, self.args.views), total);
        for round in 0..self.args.rounds as usize {
            for (i, (way, record)) in ways.iter().zip(&mut records).enumerate() {
                step.set((round * ways.len() + i) as u64, total);
                let (technique, style) = shot(way);
                let shot = Shot { view, instances, technique, style: &style, count: false };
                self.off.draw(&shot)?;
                for _ in 0..self.args.frames {
                    let (stats, times) = self.off.draw(&shot)?;
                    record.frame_ms.push(times.frame);
                    record.gpu_ms.extend((!stats.passes.is_empty()).then(|| stats.gpu_ms()));
                }
            }
        }
        records.into_iter().try_for_each(|record| self.journal.add(record))
    }

    fn judge(&mut self, view: &View, way: &Way, stats: FrameStats, truth: &Truth) -> Result<Record> {
        let combination = way.combination.clone();
        let picture = output::float(self.off.read()?, view);
        let image = truth::image(&picture, self.args.background);
        let difference =
            measure::compare(&truth.image, &image, TOLERANCE as f64 / 255.0).with_context(|| combination.key())?;
        let file = format!("pictures/{:016x}.png", super::hash(&combination.key()));
        output::picture(&self.out.join(&file), &picture, self.args.background)?;
        Ok(Record {
            points_submitted: stats.points_submitted,
            points_drawn: stats.points_drawn.unwrap_or(0),
            draw_calls: stats.draw_calls,
            device_bytes: stats.device_bytes,
            gpu_ms: Vec::new(),
            frame_ms: Vec::new(),
            errors: compare::value(&difference, TOLERANCE),
            truth: truth.name.clone(),
            truth_file: truth.file.clone(),
            picture: file,
            combination,
        })
    }
}

impl Bench<'_> {
    /// The whole stress suite, for the report.
    fn stress(&mut self) -> Result<Vec<Stress>> {
        let cases = stress::cases();
        let total = cases.len() as u64;
        let step = self.progress.step("numerical stress", total);
        let run = |(i, case): (usize, stress::Case)| {
            step.set(i as u64, total);
            let outcome = stress::run(&mut self.off, &case).with_context(|| case.name.clone())?;
            Ok(Stress { name: case.name, group: case.group, why: case.why, outcome })
        };
        cases.into_iter().enumerate().map(run).collect()
    }
}

/// What an input is called in results.
fn name(input: &Input) -> String {
    match input {
        Input::File(path) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        Input::Scene { name, points, seed } => format!("scene:{name}:{points}:{seed}"),
    }
}

/// What changes with an input's content.
fn state(input: &Input) -> Result<String> {
    let Input::File(path) = input else { return Ok("made".into()) };
    let about = fs::metadata(path).with_context(|| path.display().to_string())?;
    let time = about.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
    Ok(format!("{} bytes, time {}", about.len(), time.map_or(0, |t| t.as_secs())))
}

fn samples(args: &SweepArgs) -> Vec<Option<u32>> {
    match args.samples.is_empty() {
        true => vec![None],
        false => args.samples.iter().copied().map(Some).collect(),
    }
}

/// From all sides, in turn a little, well and steeply from above.
fn pose(number: u32, views: u32) -> Pose {
    let azimuth = 30.0 + 360.0 * number as f64 / views as f64;
    Pose::Framed { azimuth, elevation: [15.0, 35.0, 60.0][number as usize % 3] }
}

/// Every combination for one input, each once.
fn plan(args: &SweepArgs, input: &str, state: &str) -> Vec<Combination> {
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

fn way(combination: &Combination, style: &Style) -> Result<Way> {
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
