//! Every technique with every parameter from every view: timed in turn, each picture judged.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use glam::DMat4;
use serde_json::{Value, json};

use surfel::ash::vk;
use surfel::load::{Mesh, PointCloud};
use surfel::measure::{self, Image};
use surfel::select::View;
use surfel::standalone::{DeviceInfo, Offscreen, Options, Shot, Standalone, stress};
use surfel::structure::groups::Relax;
use surfel::structure::{Arrangement, Cloud, Flat, Groups};
use surfel::style::Style;
use surfel::technique::Structure;
use surfel::{FrameStats, Instance};

use super::super::parse::{Input, Radius};
use super::super::progress::Progress;
use super::super::scene::{self, A_SAMPLE, Scene};
use super::super::{Usage, compare, frames, look, memory, output, structure};
use super::args::SweepArgs;
use super::ceiling::{self, Ceiling};
use super::journal::Journal;
use super::plan::{self, Form, Way};
use super::record::{Combination, Record};
use super::truth::{self, Source};

/// Counted as different: more than this, of 255.
const TOLERANCE: u8 = 1;

/// Bytes of memory that a pixel takes at its peak, on a device that is the processor: between pictures of 1024 × 1024 and
/// 2048 × 2048 px 318 more a pixel.
const A_PIXEL: u64 = 320;

/// What came out.
pub struct Sweep {
    pub device: DeviceInfo,
    /// In the order of the plan.
    pub records: Vec<Record>,
    /// What the device could do for them at best.
    pub ceilings: Vec<Ceiling>,
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

/// Measures what the journal does not have yet.
pub fn run(args: &SweepArgs, out: &Path, progress: &Progress) -> Result<Sweep> {
    if let Radius::Pixels(_) = args.look.radius {
        return Err(Usage("--radius px:N is no splat: a bench compares splats; use --scales".into()).into());
    }
    if args.background[3] != 255 {
        return Err(Usage("--background of a bench is opaque: RRGGBB".into()).into());
    }
    plan::distinct(&args.inputs)?;
    scene::readable(&args.inputs, &[])?;
    fits(args)?;
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
    let mut bench = Bench { args, out, progress, journal, off, leveled: Vec::new(), meshes: Vec::new() };
    bench.off.renderer.upload_budget = 256 << 20;
    let done: Result<_> = (|| {
        let inputs = args.inputs.iter().map(|input| bench.input(input)).collect::<Result<Vec<_>>>()?;
        let records = inputs.concat();
        let ceilings = ceiling::measure(bench.off.standalone(), &records, args.rounds, progress)?;
        let stress = if args.stress { Some(bench.stress()?) } else { None };
        Ok((records, ceilings, stress))
    })();
    bench.off.destroy().close();
    let (records, ceilings, stress) = done?;
    Ok(Sweep { device, records, ceilings, stress, common })
}

/// The largest picture and the largest number of samples, before anything is loaded.
fn fits(args: &SweepArgs) -> Result<()> {
    for &[width, height] in &args.sizes {
        let pixels = width as u64 * height as u64;
        memory::ensure(&format!("a bench at {width}x{height}"), pixels.saturating_mul(A_PIXEL))?;
    }
    args.samples.iter().try_for_each(|&n| memory::ensure(&format!("--samples {n}"), n as u64 * A_SAMPLE))
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

/// One input, loaded.
struct Subject {
    scene: Scene,
    source: Source,
    style: Style,
    /// Changes with the input.
    state: String,
}

/// What is drawn of it, by the form in which the device has it.
struct Drawn {
    form: Form,
    clouds: Vec<Cloud>,
    instances: Vec<Instance>,
}

/// The clouds with groups of one c, or without.
struct Grouped {
    factor: Option<f32>,
    flats: Vec<Arc<Flat>>,
}

/// Clouds in a structure, and what it was built of.
struct Leveled {
    form: Form,
    of: Vec<Arc<Flat>>,
    clouds: Vec<Cloud>,
}

struct Bench<'a> {
    args: &'a SweepArgs,
    out: &'a Path,
    progress: &'a Progress,
    journal: Journal,
    off: Offscreen,
    leveled: Vec<Leveled>,
    /// Faces of the clouds that are being measured, where they are drawn as they were read.
    meshes: Vec<Option<Mesh>>,
}

impl Bench<'_> {
    /// All records of one input, measured now or before.
    fn input(&mut self, input: &Input) -> Result<Vec<Record>> {
        let name = plan::name(input);
        let state = plan::state(input)?;
        let plan = plan::plan(self.args, &name, &state);
        if plan.iter().any(|c| self.finished(c).is_none()) {
            let scene = Scene::load(std::slice::from_ref(input), &self.args.lens, &self.args.look, self.progress)?;
            self.measure(scene, &plan, format!("{name} {state}")).with_context(|| name.clone())?;
        }
        Ok(plan.iter().filter_map(|c| self.finished(c).cloned()).collect())
    }

    /// The record of a combination, where nothing of it is missing: the report shows its pictures.
    fn finished(&self, combination: &Combination) -> Option<&Record> {
        let there = |r: &&Record| [&r.picture, &r.truth_file].iter().all(|file| self.out.join(file).is_file());
        self.journal.get(&combination.key()).filter(there)
    }

    fn measure(&mut self, scene: Scene, plan: &[Combination], state: String) -> Result<()> {
        let style = look::surface(&self.args.look, scene.shade);
        let original: Vec<Arc<Flat>> = scene.clouds.iter().map(|c| Arc::new(Flat::new(c))).collect();
        let source = Source::new(self.args.truth, &scene, &original)?;
        let mut subject = Subject { scene, source, style, state };
        for samples in plan::samples(self.args) {
            if plan.iter().all(|c| c.samples != samples || self.finished(c).is_some()) {
                continue;
            }
            let as_read = |cloud: &PointCloud| cloud.mesh.clone().filter(|_| samples.is_none());
            self.meshes = subject.scene.clouds.iter().map(as_read).collect();
            let flats = match samples {
                None => original.clone(),
                Some(n) => self.sampled(&subject.scene, n)?,
            };
            let grouped = self.group(flats, plan)?;
            for &size in &self.args.sizes {
                let missing = |c: &&Combination| c.samples == samples && c.size == size && self.finished(c).is_none();
                let pending: Vec<&Combination> = plan.iter().filter(missing).collect();
                if !pending.is_empty() {
                    self.size(size, &mut subject, &grouped, &pending)?;
                }
            }
        }
        Ok(())
    }

    /// The clouds with the groups of every c that is asked for, and without.
    fn group(&self, flats: Vec<Arc<Flat>>, plan: &[Combination]) -> Result<Vec<Grouped>> {
        let mut grouped = vec![Grouped { factor: None, flats: flats.clone() }];
        for factor in plan.iter().filter_map(|c| c.factor) {
            if grouped.iter().any(|g| g.factor == Some(factor)) {
                continue;
            }
            let _step = self.progress.step(format!("groups with c = {factor}"), 1);
            let relax = Relax { factor, ..Relax::default() };
            let group = |flat: &Arc<Flat>| {
                Ok(Arc::new(Flat { groups: Some(Groups::color(flat, &relax)?), ..Flat::clone(flat) }))
            };
            grouped.push(Grouped { factor: Some(factor), flats: flats.iter().map(group).collect::<Result<_>>()? });
        }
        Ok(grouped)
    }

    /// Gives the device the clouds in every form that these ways need.
    fn add(&mut self, grouped: &[Grouped], ways: &[Way], view: &View) -> Result<Vec<Drawn>> {
        let mut all: Vec<Drawn> = Vec::new();
        for form in ways.iter().map(|way| way.form) {
            if all.iter().any(|drawn| drawn.form == form) {
                continue;
            }
            if form.structure != Structure::Flat {
                // Built once for all views and sizes.
                let clouds = self.leveled(grouped, form)?;
                let instances = self.instances(&clouds)?;
                all.push(Drawn { form, clouds, instances });
                continue;
            }
            let flats = &grouped.iter().find(|g| g.factor == form.factor).context("groups of every c")?.flats;
            let arrange = |flat: &Arc<Flat>| match form.storage {
                Arrangement::AsRead => Arc::clone(flat),
                how => Arc::new(structure::arrange(Flat::clone(flat), how, view, self.progress)),
            };
            let packing = self.args.levels.packing;
            let clouds: Vec<Cloud> = flats.iter().map(|flat| Cloud::from(arrange(flat)).packed(packing)).collect();
            let instances = self.instances(&clouds)?;
            all.push(Drawn { form, clouds, instances });
        }
        Ok(all)
    }

    fn instances(&mut self, clouds: &[Cloud]) -> Result<Vec<Instance>> {
        let add =
            |cloud: &Cloud| Ok(Instance { cloud: self.off.renderer.add(cloud.clone())?, transform: DMat4::IDENTITY });
        clouds.iter().map(add).collect()
    }

    /// The clouds in a structure with levels, made once for all views.
    fn leveled(&mut self, grouped: &[Grouped], form: Form) -> Result<Vec<Cloud>> {
        let plain = &grouped[0].flats;
        let same = |kept: &&Leveled| {
            kept.form == form
                && kept.of.len() == plain.len()
                && kept.of.iter().zip(plain).all(|(a, b)| Arc::ptr_eq(a, b))
        };
        if let Some(kept) = self.leveled.iter().find(same) {
            return Ok(kept.clouds.clone());
        }
        let relax = form.factor.map(|factor| Relax { factor, ..Relax::default() });
        let build = |(flat, mesh): (&Arc<Flat>, &Option<Mesh>)| {
            let of = (&**flat, mesh.as_ref());
            let built = structure::level(of, form.structure, &self.args.levels, relax.as_ref(), self.progress);
            built.map(|(cloud, _)| cloud)
        };
        let clouds: Vec<Cloud> = plain.iter().zip(&self.meshes).map(build).collect::<Result<_>>()?;
        // Those of another input, or sampled otherwise, are not drawn again.
        self.leveled.retain(|kept| kept.of.iter().zip(plain).all(|(a, b)| Arc::ptr_eq(a, b)));
        self.leveled.push(Leveled { form, of: plain.clone(), clouds: clouds.clone() });
        Ok(clouds)
    }

    /// The faces, sampled `n` times.
    fn sampled(&self, scene: &Scene, n: u32) -> Result<Vec<Arc<Flat>>> {
        let sampled = scene.sampled(n, &self.args.look, self.progress)?;
        Ok(vec![Arc::new(Flat::new(&sampled))])
    }

    /// All views of one size.
    fn size(
        &mut self,
        size: [u32; 2],
        subject: &mut Subject,
        grouped: &[Grouped],
        pending: &[&Combination],
    ) -> Result<()> {
        self.off.resize(vk::Extent2D { width: size[0], height: size[1] })?;
        for number in 0..self.args.views.len() {
            let of_view = pending.iter().filter(|c| c.view[0] == number);
            let ways: Vec<Way> = of_view.map(|c| plan::way(c, &subject.style)).collect::<Result<_>>()?;
            if ways.is_empty() {
                continue;
            }
            let pose = plan::pose(number, &self.args.views);
            let view = subject.scene.view(pose, self.args.lens.fov, size);
            let truth = self.truth(subject, &view, &ways[0].combination.view(), size)?;
            let drawn = self.add(grouped, &ways, &view)?;
            self.view(&drawn, &view, ways, &truth)?;
            drawn.iter().flat_map(|d| &d.instances).for_each(|i| self.off.renderer.remove(i.cloud));
        }
        Ok(())
    }

    fn truth(&self, subject: &Subject, view: &View, name_of_view: &str, size: [u32; 2]) -> Result<Truth> {
        let _step = self.progress.step(format!("truth of view {name_of_view}"), 1);
        let Subject { source, style, state, .. } = subject;
        let name = source.name();
        // Colours and radii depend on the look beyond the style.
        let look = &self.args.look;
        let version = env!("CARGO_PKG_VERSION");
        let file = truth::file(&format!("{version} {state} {name} {view:?} {style:?} {look:?}"), name_of_view, size);
        let picture = source.picture(&self.out.join(&file), view, size, style)?;
        Ok(Truth { image: truth::image(&picture, self.args.background), name, file })
    }

    /// One view: every way judged once, then all of them timed in turn, round by round.
    fn view(&mut self, drawn: &[Drawn], view: &View, ways: Vec<Way>, truth: &Truth) -> Result<()> {
        let of = |way: &Way| drawn.iter().find(|d| d.form == way.form).expect("added for every way");
        let mut records = Vec::new();
        for way in &ways {
            let instances = of(way).instances.as_slice();
            let shot = Shot { view, instances, technique: way.technique, style: &way.style, count: true };
            frames::upload(&mut self.off, &shot, self.progress)?;
            let (stats, _) = self.off.draw(&shot)?;
            records.push(self.judge(of(way), view, way, stats, truth)?);
        }
        let total = (self.args.rounds as usize * ways.len()) as u64;
        let [number, views] = ways[0].combination.view;
        let which = ways[0].combination.view_name.clone().unwrap_or_else(|| format!("{} of {views}", number + 1));
        let step = self.progress.step(format!("view {which}"), total);
        for round in 0..self.args.rounds as usize {
            for (i, (way, record)) in ways.iter().zip(&mut records).enumerate() {
                step.set((round * ways.len() + i) as u64, total);
                let instances = of(way).instances.as_slice();
                let shot = Shot { view, instances, technique: way.technique, style: &way.style, count: false };
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

    fn judge(&mut self, drawn: &Drawn, view: &View, way: &Way, stats: FrameStats, truth: &Truth) -> Result<Record> {
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
            layers: stats.layers,
            device_bytes: stats.device_bytes,
            bytes_a_point: self.bytes_a_point(drawn),
            culled_interval: stats.culled.map_or(0, |c| c.interval),
            footprint: ceiling::footprint(&drawn.clouds, view, combination.size, &way.style),
            gpu_ms: Vec::new(),
            frame_ms: Vec::new(),
            errors: compare::value(&difference, TOLERANCE),
            truth: truth.name.clone(),
            truth_file: truth.file.clone(),
            picture: file,
            combination,
        })
    }

    fn bytes_a_point(&self, drawn: &Drawn) -> f64 {
        let bytes: u64 = drawn.clouds.iter().map(Cloud::bytes).sum();
        let points: usize = drawn.clouds.iter().map(Cloud::points).sum();
        bytes as f64 / points.max(1) as f64
    }

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
