//! Every kind of target that an engine may have, against the plain one: a single-sampled float target of one view.
//!
//! The splat passes do the same arithmetic whatever the target is (the near plane comes out of both conventions' matrices
//! exactly, see `camera`), so every pixel must be what the plain picture gives when it is blended over the engine's own
//! geometry, up to the rounding of the target's format, which is the whole bound.

use glam::{DMat4, dvec3};
use surfel::ash::vk;
use surfel::readback::Picture;
use surfel::select::{DepthConvention, View};
use surfel::style::Style;
use surfel::technique::Technique;
use surfel::{CloudId, Instance, Renderer};

use crate::host_engine::Engine;
use crate::host_scene::{Lens, camera, sphere};
use crate::host_target::{
    DEPTH_FORMAT, Depth, FAR_COLOR, FAR_Z, Frame, Kind, NEAR_COLOR, NEAR_Z, PLAIN, Target, depth_of,
};

/// Two spheres, one behind the other and to the side: a transform with rotation, scale and translation.
pub fn scene(cloud: CloudId) -> [Instance; 2] {
    let beside = DMat4::from_translation(dvec3(0.9, 0.4, -1.5))
        * DMat4::from_rotation_x(0.7)
        * DMat4::from_scale(dvec3(0.5, 0.5, 0.5));
    [Instance { cloud, transform: DMat4::IDENTITY }, Instance { cloud, transform: beside }]
}

/// One frame of a kind of target, with a renderer of its own.
pub fn show(engine: &Engine, kind: Kind, views: &[View], technique: Technique, look: impl FnOnce(&Target, CloudId)) {
    let target = Target::new(engine, kind);
    // SAFETY: the handles belong together and outlive the renderer; so does the render pass.
    let mut renderer = unsafe { Renderer::new(engine.host(), target.formats()) }.expect("a renderer");
    let cloud = renderer.add(sphere(1500)).expect("a cloud");
    let frame = engine.completed() + 1;
    let cmd = engine.command_buffer();
    engine.begin(cmd);
    let (instances, style) = (scene(cloud), Style::default());
    target.record(
        engine,
        cmd,
        &mut renderer,
        &Frame { id: frame, views, instances: &instances, technique, style: &style },
    );
    engine.submit(cmd, frame);
    engine.wait(frame);
    let stats = renderer.retire(engine.completed()).expect("statistics");
    let (drawn, culled) = (stats[0].points_drawn.unwrap(), stats[0].culled.unwrap());
    assert_eq!(stats[0].points_submitted, 2 * 1500 * views.len() as u64);
    assert_eq!(stats[0].points_submitted, drawn + culled.total(), "{:?}", stats[0]);
    look(&target, cloud);
    // SAFETY: the only frame is complete.
    unsafe { renderer.destroy() };
    target.destroy(engine);
}

/// The same views one by one on the plain target.
fn plain(engine: &Engine, views: &[View], technique: Technique) -> Vec<Vec<[f32; 4]>> {
    let mut pictures = Vec::new();
    for view in views {
        show(engine, PLAIN, std::slice::from_ref(view), technique, |t, _| pictures.push(t.picture(0)));
    }
    for picture in &pictures {
        let covered = picture.iter().filter(|p| p[3] > 0.0).count();
        // The unit sphere at distance 3.5 with f = 24 / tan 25° = 51.5 px: a disc of 15 px radius, 730 of 3072 pixels,
        // and a smaller one that it partly hides or that is partly outside.
        assert!((500..1700).contains(&covered), "a sphere is seen: {covered}");
    }
    pictures
}

fn encode(v: f64) -> f64 {
    if v <= 0.0031308 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

fn decode(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// What is stored when `splats` (premultiplied, linear) come over `under` (linear), and the bound on a stored channel.
fn stored(kind: &Kind, splats: [f32; 4], under: [f32; 4], channel: usize) -> (f64, f64) {
    let byte = |v: f64| (v * 255.0).round() / 255.0;
    let (s, a, u) = (splats[channel] as f64, splats[3] as f64, under[channel] as f64);
    let over = |s: f64, u: f64| (s + (1.0 - a) * u).clamp(0.0, 1.0);
    // A driver may round source and factor to the format before it blends: half a step each, and one for the result;
    // another one for the mean of four samples.
    let bytes = if kind.multisampled() { 2.001 } else { 1.501 } / 255.0;
    match kind.color {
        // 2⁻¹¹ for the nearest, twice that where the driver truncates; values are at most 1 (premultiplied).
        vk::Format::R16G16B16A16_SFLOAT => (over(s, u), 1.0 / 1024.0),
        // Sums and products of a few terms at most 1, rounded to 2⁻²⁴ each.
        vk::Format::R32G32B32A32_SFLOAT => (over(s, u), 1e-6),
        // Half a step of rounding, and half a step for the inexact conversion that the specification allows; alpha is
        // not encoded.
        vk::Format::R8G8B8A8_SRGB if channel < 3 => (encode(over(s, decode(byte(encode(u))))), 1.001 / 255.0),
        // The shader encodes the colour that is not yet multiplied, and the engine blends in encoded values.
        vk::Format::R8G8B8A8_UNORM if channel < 3 && kind.encode_srgb => {
            let straight = if a > 0.0 { s / a } else { 0.0 };
            (over(encode(straight.min(1.0)) * a, byte(u)), bytes)
        }
        _ => (over(s, byte(u)), bytes),
    }
}

/// Every pixel of every view, colour and depth.
fn check(target: &Target, views: &[View], plain: &[Vec<[f32; 4]>]) {
    let kind = &target.kind;
    let [near, far] = kind.rectangles();
    let inside = |r: &vk::Rect2D, x: u32, y: u32| {
        let (x, y) = (x as i32 - r.offset.x, y as i32 - r.offset.y);
        x >= 0 && y >= 0 && x < r.extent.width as i32 && y < r.extent.height as i32
    };
    let [w, h] = kind.size;
    let (mut hidden, mut in_front) = (0, 0);
    for view in 0..kind.views {
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            let (px, py) = (x as i32 - kind.offset[0], y as i32 - kind.offset[1]);
            let in_picture = px >= 0 && py >= 0 && px < kind.extent[0] as i32 && py < kind.extent[1] as i32;
            let mut splats = match in_picture {
                true => plain[view as usize][(py as u32 * kind.extent[0] + px as u32) as usize],
                false => [0.0; 4],
            };
            let (mut under, mut under_depth) = ([0.0; 4], kind.convention.far());
            if kind.geometry && inside(&near, x, y) {
                under = NEAR_COLOR;
                under_depth = depth_of(&views[0], NEAR_Z);
                if kind.depth != Depth::None {
                    hidden += (splats[3] > 0.0) as u32;
                    splats = [0.0; 4];
                }
            } else if kind.geometry && inside(&far, x, y) {
                (under, under_depth) = (FAR_COLOR, depth_of(&views[0], FAR_Z));
                in_front += (splats[3] > 0.0) as u32;
            }
            let found = target.pixel(view, x, y);
            for channel in 0..4 {
                let (wanted, bound) = stored(kind, splats, under, channel);
                let off = (found[channel] as f64 - wanted).abs();
                assert!(
                    off <= bound,
                    "{kind:?}: view {view}, pixel {x},{y}, channel {channel}: {found:?}, not {wanted}"
                );
            }
            if kind.depth == Depth::None || kind.multisampled() {
                continue;
            }
            let depth = target.depth(view, x, y);
            if splats[3] == 0.0 {
                assert_eq!(depth, under_depth as f32, "{kind:?}: depth of the engine at {x},{y} of view {view}");
            } else {
                // In front of the far rectangle, behind the near one: the spheres lie between.
                let z = views[view as usize].linear_depth(depth as f64);
                assert!((1.0..8.0).contains(&z), "{kind:?}: front at {z} at {x},{y} of view {view}");
            }
        }
    }
    if kind.geometry {
        assert!(in_front > 50, "splats hide the engine's geometry in {in_front} pixels");
        assert!(hidden > 50 || kind.depth == Depth::None, "and are hidden in {hidden}");
    }
}

const FORMATS: [(vk::Format, bool); 3] =
    [(vk::Format::R8G8B8A8_SRGB, false), (vk::Format::R8G8B8A8_UNORM, true), (vk::Format::R16G16B16A16_SFLOAT, false)];

/// All of {dynamic, render pass} × {1, 4 samples} × {1, 2 views} × {no depth, tested, lent}; format, depth convention,
/// lens and the picture's place in the target change from case to case, so that each pair of values meets.
#[test]
fn every_kind_of_target_gets_the_same_picture() {
    Engine::with(|engine| {
        let technique = Technique::default();
        let lenses = [Lens::Straight, Lens::Asymmetric, Lens::Flipped];
        let aspect = PLAIN.extent[0] as f64 / PLAIN.extent[1] as f64;
        // Plain pictures by lens; the convention must make no difference.
        let shots: Vec<_> = lenses
            .iter()
            .map(|&lens| {
                plain(engine, &[0, 1].map(|side| camera(side, lens, DepthConvention::Reversed, aspect)), technique)
            })
            .collect();
        let mut case = 0;
        for depth in [Depth::None, Depth::Tested, Depth::Lent] {
            for render_pass in [false, true] {
                for samples in [vk::SampleCountFlags::TYPE_1, vk::SampleCountFlags::TYPE_4] {
                    for views in [1, 2] {
                        let (color, encode_srgb) = FORMATS[case % 3];
                        let lens = (case / 2 + case / 6) % 3;
                        let convention = [DepthConvention::Reversed, DepthConvention::Standard][(case + case / 4) % 2];
                        let (size, offset) = match case % 5 {
                            0 | 3 => ([80, 64], [9, 12]),
                            _ => (PLAIN.size, PLAIN.offset),
                        };
                        let kind = Kind {
                            color,
                            encode_srgb,
                            samples,
                            views,
                            depth,
                            convention,
                            render_pass,
                            size,
                            offset,
                            geometry: true,
                            ..PLAIN
                        };
                        let cameras: Vec<_> =
                            (0..views).map(|side| camera(side, lenses[lens], convention, aspect)).collect();
                        show(engine, kind, &cameras, technique, |t, _| check(t, &cameras, &shots[lens]));
                        case += 1;
                    }
                }
            }
        }
        assert_eq!(case, 24);
    });
}

/// The other blend, sprites and quads, on the target that asks most of it.
#[test]
fn every_technique_composites_into_a_host_with_depth() {
    Engine::with(|engine| {
        for (name, technique) in surfel::technique::PRESETS {
            let kind = Kind { depth: Depth::Lent, geometry: true, views: 2, ..PLAIN };
            let cameras = [0, 1].map(|side| camera(side, Lens::Straight, DepthConvention::Reversed, 4.0 / 3.0));
            let shots = plain(engine, &cameras, *technique);
            for (view, rgba) in shots.iter().enumerate() {
                let [width, height] = PLAIN.extent;
                let picture = Picture { width, height, rgba: rgba.clone(), depth: None };
                crate::vulkan::hash(&format!("host.{name}.view{view}"), &picture);
            }
            println!("{name}");
            show(engine, kind, &cameras, *technique, |t, _| check(t, &cameras, &shots));
        }
    });
}

/// A projection whose y points up gives the picture upside down.
#[test]
fn a_flipped_projection_mirrors_the_picture() {
    Engine::with(|engine| {
        let [straight, flipped] = [Lens::Straight, Lens::Flipped].map(|lens| {
            plain(engine, &[camera(0, lens, DepthConvention::Reversed, 4.0 / 3.0)], Technique::default()).remove(0)
        });
        let [w, h] = PLAIN.extent.map(|v| v as usize);
        let mut off = 0;
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            let (a, b) = (straight[y * w + x], flipped[(h - 1 - y) * w + x]);
            // The arithmetic is mirrored, its rounding is not: 10⁻³ for sums of some thirty splats in f32 at 10⁻⁶ of
            // relative error each, magnified by footprints that pass or miss at their rim (weight 1/16).
            off += (0..4).any(|c| (a[c] - b[c]).abs() > 1e-3) as u32;
        }
        // Ties at rims and tolerances: a splat's rim crosses a pixel centre to within 10⁻⁵ px in one of 10⁴ pixels.
        assert!(off <= 3, "{off} pixels of {} differ", w * h);
        assert!(straight != flipped, "the scene is not symmetric");
    });
}

/// Depth is the front's in both conventions: the same linear depth, whatever the buffer holds.
#[test]
fn both_depth_conventions_tell_the_same_depth() {
    Engine::with(|engine| {
        let mut fronts: Vec<Vec<f64>> = Vec::new();
        for convention in [DepthConvention::Reversed, DepthConvention::Standard] {
            let kind = Kind { depth: Depth::Tested, convention, ..PLAIN };
            let view = camera(0, Lens::Straight, convention, 4.0 / 3.0);
            show(engine, kind, &[view], Technique::default(), |t, _| {
                let depths = (0..48).flat_map(|y| (0..64).map(move |x| (x, y)));
                fronts.push(depths.map(|(x, y)| view.linear_depth(t.depth(0, x, y) as f64)).collect());
            });
        }
        let mut compared = 0;
        for (a, b) in fronts[0].iter().zip(&fronts[1]) {
            // Near 1, standard depth 1 − 0.1/z is stored to 2⁻²⁵, and z² / 0.1 magnifies that: 160 · 3·10⁻⁸ at z = 4.
            if a.is_finite() && *a < 100.0 {
                assert!((a - b).abs() < 2e-5, "{a} and {b}");
                compared += 1;
            }
        }
        assert!(compared > 500, "{compared}");
    });
}

/// What cannot be drawn to is refused when the renderer is made, with the reason.
#[test]
fn impossible_targets_are_refused() {
    Engine::with(|engine| {
        let good = surfel::TargetFormats {
            color: vk::Format::R8G8B8A8_UNORM,
            depth: Some(DEPTH_FORMAT),
            samples: vk::SampleCountFlags::TYPE_1,
            view_mask: 0,
            pass: surfel::PassKind::Dynamic,
            encode_srgb: false,
        };
        let bad = [
            (surfel::TargetFormats { color: vk::Format::R8G8B8A8_UINT, ..good }, "R8G8B8A8_UINT"),
            (surfel::TargetFormats { depth: Some(vk::Format::R8G8B8A8_UNORM), ..good }, "depth target"),
            (surfel::TargetFormats { samples: vk::SampleCountFlags::TYPE_64, ..good }, "TYPE_64"),
            (surfel::TargetFormats { samples: vk::SampleCountFlags::empty(), ..good }, "samples"),
            (surfel::TargetFormats { view_mask: 0b101, ..good }, "view mask 0b101"),
            (surfel::TargetFormats { view_mask: 0b11111, ..good }, "view mask 0b11111"),
        ];
        for (formats, reason) in bad {
            // SAFETY: the handles belong together.
            let refused = unsafe { Renderer::new(engine.host(), formats) };
            let Err(surfel::Error::Unsupported(why)) = refused else { panic!("{formats:?} was not refused") };
            assert!(why.contains(reason), "{why}");
        }
        // SAFETY: as above; nothing was recorded.
        unsafe { Renderer::new(engine.host(), good).expect("a renderer").destroy() };
    });
}
