//! Every technique with the layers on, then the canaries: for other people's CI, in the shipped binary.
//!
//! A technique passes when the layers stay silent until the device is gone, the statistics add up, a second frame gives
//! the same bytes, and the picture covers what geometry says that it must. A canary passes when it is reported.

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::Instant;

use ash::vk;
use glam::{DMat4, DVec3, Vec3, dvec3};

use super::canary::{self, Canary};
use super::device::{self, Standalone};
use super::offscreen::{Offscreen, Shot};
use super::validation::{Layers, Message};
use crate::error::Result;
use crate::host::Instance;
use crate::load::PointCloud;
use crate::select::{DepthConvention, View};
use crate::structure::Flat;
use crate::structure::groups::{Groups, Relax};
use crate::style::{BackFaces, EyeDome, Shading, Style};
use crate::technique::{Blend, PRESETS, Technique};

/// What is tested, and with which checks.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// The checks.
    pub layers: Layers,
    /// Part of the device's name; otherwise the best.
    pub device: Option<String>,
}

/// How a case ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// As it must.
    Passed,
    /// Why not, in one line.
    Failed(String),
}

/// One thing that was tried.
#[derive(Debug, Clone)]
pub struct Case {
    /// What, unique in a report.
    pub name: String,
    /// `techniques` or `canaries`.
    pub group: &'static str,
    /// How it ended.
    pub outcome: Outcome,
    /// Time that it took \[s\].
    pub seconds: f64,
    /// What the layers said: nothing for a technique that passed, the planted fault for a canary.
    pub messages: Vec<Message>,
}

impl Case {
    /// Whether it ended as it must.
    pub fn passed(&self) -> bool {
        self.outcome == Outcome::Passed
    }
}

/// Everything that was tried, in order.
#[derive(Debug, Clone)]
pub struct Report {
    /// Name and driver of the device.
    pub device: String,
    /// The cases.
    pub cases: Vec<Case>,
}

/// Runs everything; `progress` hears of each case as it ends.
///
/// Fails where no device can be opened, or where a check that was asked for is not on: that is no case that failed, it
/// is no test at all.
pub fn run(options: &Options, mut progress: impl FnMut(&Case)) -> Result<Report> {
    let settings = device::Options { device: options.device.clone(), layers: options.layers, ..Default::default() };
    let standalone = Standalone::new(&settings)?;
    let lacking = standalone.lacking(options.layers);
    if !lacking.is_empty() {
        return Err(crate::Error::Unsupported(format!(
            "checks that the layers do not switch on: {} (for hazards between submits set VK_LAYER_ENABLES, see {})",
            lacking.join(", "),
            "vk_layer_settings.txt",
        )));
    }
    let name = format!("{}, {}", standalone.info.name, standalone.info.driver);
    drop(standalone);
    let mut cases = Vec::new();
    let mut done = |case: Case| {
        progress(&case);
        cases.push(case);
    };
    for (name, technique) in PRESETS {
        for scene in SCENES {
            for extent in SIZES {
                let [w, h] = extent;
                done(timed(format!("{name} {} {w}x{h}", scene.name), "techniques", || {
                    show(&settings, *technique, scene, extent)
                }));
            }
        }
    }
    for canary in canary::ALL.iter().filter(|c| c.runs_with(options.layers)) {
        done(timed(canary.name.to_owned(), "canaries", || plant(&settings, canary)));
    }
    Ok(Report { device: name, cases })
}

fn timed(name: String, group: &'static str, case: impl FnOnce() -> Result<(Outcome, Vec<Message>)>) -> Case {
    let start = Instant::now();
    let (outcome, messages) = case().unwrap_or_else(|e| (Outcome::Failed(e.to_string()), Vec::new()));
    Case { name, group, outcome, seconds: start.elapsed().as_secs_f64(), messages }
}

fn plant(settings: &device::Options, canary: &Canary) -> Result<(Outcome, Vec<Message>)> {
    let messages = canary.run(settings)?;
    let outcome = match canary.is_reported(&messages) {
        true => Outcome::Passed,
        false => Outcome::Failed(format!("the layers did not report {}", canary.expected)),
    };
    Ok((outcome, messages))
}

/// Sizes of the picture \[px\]: ordinary, narrow, and smaller than a footprint.
const SIZES: [[u32; 2]; 3] = [[96, 72], [33, 80], [1, 1]];

/// A sphere of splats, and what is special about it.
struct Scene {
    name: &'static str,
    origin: DVec3,
    attributes: bool,
    style: fn() -> Style,
}

const SCENES: &[Scene] = &[
    Scene { name: "sphere", origin: DVec3::ZERO, attributes: true, style: Style::default },
    // Millions of units from the origin, as surveys are; nothing known but positions and radii.
    Scene { name: "bare far away", origin: dvec3(6.0e6, -4.0e6, 500.0), attributes: false, style: dome },
    Scene { name: "phong", origin: DVec3::ZERO, attributes: true, style: phong },
];

fn dome() -> Style {
    Style { eye_dome: Some(EyeDome::default()), shading: Shading::None, ..Style::default() }
}

fn phong() -> Style {
    Style { shading: Shading::PHONG, ..Style::default() }
}

const POINTS: usize = 3000;

/// Points of the unit sphere along a spiral, evenly spread. Covering radii: the spiral's largest gap is 0.9 of the spacing
/// √(4π/n), and hard discs are drawn with r / √2.
fn sphere(origin: DVec3, attributes: bool) -> PointCloud {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let directions: Vec<Vec3> = (0..POINTS)
        .map(|i| {
            let y = 1.0 - 2.0 * (i as f64 + 0.5) / POINTS as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let ring = (1.0 - y * y).sqrt();
            dvec3(ring * cos, y, ring * sin).as_vec3()
        })
        .collect();
    let color = |v: f32| (127.5 + 127.0 * v) as u8;
    let colors = directions.iter().map(|d| [color(d.x), color(d.y), color(d.z)]).collect();
    PointCloud {
        origin,
        radii: Some(vec![radius() as f32; POINTS]),
        colors: attributes.then_some(colors),
        normals: attributes.then(|| directions.clone()),
        positions: directions,
        closed: attributes,
        ..PointCloud::default()
    }
}

fn radius() -> f64 {
    1.6 * (4.0 * std::f64::consts::PI / POINTS as f64).sqrt()
}

const FOV: f64 = 50.0;
const DISTANCE: f64 = 3.2;

/// Bounds on the covered share of a picture of the sphere from [`DISTANCE`].
///
/// A sphere of radius ρ about the point looked at appears as a disc of radius f ρ / √(D² − ρ²) pixels. Whatever lies
/// within 1 − r is covered, since a disk about the nearest centre is in the way, and nothing beyond 1 + r can be, but for
/// one pixel of low-pass and one of rounding.
fn coverage([width, height]: [u32; 2]) -> (f64, f64) {
    let (w, h) = (width as f64, height as f64);
    let f = 0.5 * h / (0.5 * FOV.to_radians()).tan();
    let share = |rho: f64, more: f64| {
        let radius = f * rho / (DISTANCE * DISTANCE - rho * rho).sqrt() + more;
        // Pixel centres inside the disc, as many as there are.
        let inside = |x: u32, y: u32| {
            let (dx, dy) = (x as f64 + 0.5 - 0.5 * w, y as f64 + 0.5 - 0.5 * h);
            radius > 0.0 && dx * dx + dy * dy <= radius * radius
        };
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(|&(x, y)| inside(x, y)).count() as f64
            / (w * h)
    };
    (share(1.0 - radius(), -1.0), share(1.0 + radius(), 2.0))
}

fn show(
    settings: &device::Options,
    technique: Technique,
    scene: &Scene,
    [width, height]: [u32; 2],
) -> Result<(Outcome, Vec<Message>)> {
    let standalone = Standalone::new(settings)?;
    let mut offscreen = Offscreen::new(standalone, vk::Extent2D { width, height }, true)?;
    let looked = look(&mut offscreen, technique, scene, [width, height]);
    let messages = offscreen.destroy().close();
    let outcome = match looked {
        Ok(()) if messages.is_empty() => Outcome::Passed,
        Ok(()) => Outcome::Failed(format!("{} validation messages", messages.len())),
        Err(why) => Outcome::Failed(why),
    };
    Ok((outcome, messages))
}

/// Looks from outside, and from within, where every pixel must be covered.
fn look(offscreen: &mut Offscreen, technique: Technique, scene: &Scene, size: [u32; 2]) -> Result<(), String> {
    let text = |e: crate::Error| e.to_string();
    let mut flat = Flat::new(&sphere(scene.origin, scene.attributes));
    if technique.blend == Blend::Groups {
        flat.groups = Some(Groups::color(&flat, &Relax::default()).map_err(text)?);
    }
    let cloud = offscreen.renderer.add(Arc::new(flat)).map_err(text)?;
    let instances = [Instance { cloud, transform: DMat4::IDENTITY }];
    let aspect = size[0] as f64 / size[1] as f64;
    let projection = View::perspective(FOV.to_radians(), aspect, 0.05);
    let views = [("outside", dvec3(0.0, 0.0, DISTANCE), coverage(size)), ("inside", dvec3(0.0, 0.0, 0.3), (1.0, 1.0))];
    for (name, eye, (least, most)) in views {
        let (eye, target) = (scene.origin + eye, scene.origin);
        let view = View::look_at(eye, target, DVec3::Y, projection, DepthConvention::Reversed);
        let style = Style { back_faces: BackFaces::Draw, ..(scene.style)() };
        let shot = Shot { view: &view, instances: &instances, technique, style: &style, count: true };
        let (stats, _) = offscreen.draw(&shot).map_err(text)?;
        let picture = offscreen.read().map_err(text)?;
        let covered = picture.coverage();
        if !(least..=most).contains(&covered) {
            return Err(format!("{name}: {covered:.4} of the picture is covered, not {least:.4} to {most:.4}"));
        }
        if let Some(bad) = picture.rgba.iter().flatten().find(|v| !(0.0..=1.5).contains(*v)) {
            return Err(format!("{name}: a pixel of {bad}"));
        }
        let all = stats.points_drawn.unwrap_or_default() + stats.culled.unwrap_or_default().total();
        if stats.points_submitted != POINTS as u64 || all != stats.points_submitted {
            return Err(format!("{name}: {} points submitted and {all} accounted for", stats.points_submitted));
        }
        let (again, _) = offscreen.draw(&shot).map_err(text)?;
        if again.pipelines_built != 0 {
            return Err(format!("{name}: {} pipelines built in the second frame", again.pipelines_built));
        }
        if offscreen.read().map_err(text)? != picture {
            return Err(format!("{name}: the second frame differs from the first"));
        }
    }
    Ok(())
}

impl Report {
    /// Whether every case passed, and there were some.
    pub fn passed(&self) -> bool {
        !self.cases.is_empty() && self.cases.iter().all(Case::passed)
    }

    /// How many failed.
    pub fn failures(&self) -> usize {
        self.cases.iter().filter(|c| !c.passed()).count()
    }

    /// The report as JUnit XML, which CI systems read.
    pub fn junit(&self) -> String {
        let seconds = |cases: &[&Case]| cases.iter().map(|c| c.seconds).sum::<f64>();
        let all: Vec<_> = self.cases.iter().collect();
        let mut xml = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
        // Writing to a string cannot fail.
        let _ = writeln!(
            xml,
            "<testsuites name=\"surfel selftest\" tests=\"{}\" failures=\"{}\" time=\"{:.3}\">",
            all.len(),
            self.failures(),
            seconds(&all)
        );
        let mut groups: Vec<&str> = Vec::new();
        for case in &self.cases {
            if !groups.contains(&case.group) {
                groups.push(case.group);
            }
        }
        for group in groups {
            let cases: Vec<_> = self.cases.iter().filter(|c| c.group == group).collect();
            let failures = cases.iter().filter(|c| !c.passed()).count();
            let _ = writeln!(
                xml,
                "  <testsuite name=\"{}\" tests=\"{}\" failures=\"{failures}\" time=\"{:.3}\">\n    <properties><property \
                 name=\"device\" value=\"{}\"/></properties>",
                escape(group),
                cases.len(),
                seconds(&cases),
                escape(&self.device)
            );
            for case in cases {
                let _ = write!(
                    xml,
                    "    <testcase classname=\"surfel.{}\" name=\"{}\" time=\"{:.3}\"",
                    escape(group),
                    escape(&case.name),
                    case.seconds
                );
                match &case.outcome {
                    Outcome::Passed => xml.push_str("/>\n"),
                    Outcome::Failed(why) => {
                        let said: Vec<_> = case.messages.iter().map(|m| format!("{}: {}", m.id, m.text)).collect();
                        let _ = writeln!(
                            xml,
                            ">\n      <failure message=\"{}\">{}</failure>\n    </testcase>",
                            escape(why),
                            escape(&said.join("\n"))
                        );
                    }
                }
            }
            xml.push_str("  </testsuite>\n");
        }
        xml.push_str("</testsuites>\n");
        xml
    }
}

/// Text as XML 1.0 takes it, in attributes and elements; control characters, which it has no way to write, become `?`.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&apos;"),
            '\n' => out.push_str("&#10;"),
            '\t' => out.push_str("&#9;"),
            '\r' => out.push_str("&#13;"),
            '\u{0}'..='\u{1f}' | '\u{fffe}' | '\u{ffff}' => out.push('?'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_report_is_written_and_escaped() {
        let case = |name: &str, group, outcome| Case {
            name: name.into(),
            group,
            outcome,
            seconds: 0.25,
            messages: vec![Message { id: "VUID-1".into(), text: "a < b\u{1}".into() }],
        };
        let report = Report {
            device: "R&D \"one\"".into(),
            cases: vec![
                case("good", "techniques", Outcome::Passed),
                case("it's <bad>", "canaries", Outcome::Failed("why & how".into())),
            ],
        };
        assert!(!report.passed() && report.failures() == 1);
        let xml = report.junit();
        for part in [
            "<testsuites name=\"surfel selftest\" tests=\"2\" failures=\"1\" time=\"0.500\">",
            "<testsuite name=\"techniques\" tests=\"1\" failures=\"0\" time=\"0.250\">",
            "value=\"R&amp;D &quot;one&quot;\"/>",
            "<testcase classname=\"surfel.techniques\" name=\"good\" time=\"0.250\"/>",
            "name=\"it&apos;s &lt;bad&gt;\"",
            "<failure message=\"why &amp; how\">VUID-1: a &lt; b?</failure>",
        ] {
            assert!(xml.contains(part), "{part} is missing in {xml}");
        }
        assert_eq!(xml.matches("<testcase").count(), 2);
        assert!(!Report { device: String::new(), cases: vec![] }.passed(), "nothing tried is nothing passed");
    }

    #[test]
    fn coverage_bounds_are_bounds() {
        for size in SIZES {
            let (least, most) = coverage(size);
            assert!((0.0..=1.0).contains(&least) && least <= most && most <= 1.0, "{size:?}: {least} {most}");
        }
        let (least, most) = coverage([96, 72]);
        assert!(least > 0.2 && most < 0.7, "they say something: {least} {most}");
    }
}
