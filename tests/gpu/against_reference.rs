//! Every blend, primitive, ellipse and light against the f64 reference, from views of every kind: counts exactly, pixels
//! within a derived bound.
//!
//! Where the bound comes from: `surfel::standalone::stress`. Fragments are displaced by up to δ = 1.8·10⁻⁵ px (a projected
//! centre is good to 3·10⁻⁶ px in a picture of this size, `Camera::lens`; axes and normals round by some 8·2⁻²⁴ of
//! an offset of up to 30 px), and 5.55 δ bounds colour and coverage of a pixel with footprints of 1 px and more; others are
//! more sensitive by a factor that the reference knows. Light adds what it makes of the mean normal: 2 for the lamp at the
//! eye, 3.4 more for the highlight. Discs and squares have no weights: only light is rounded, some 10⁻⁶ of a colour up to
//! 1.25.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, Vec3, dvec3};
use surfel::load::{PointCloud, synthetic};
use surfel::readback::Picture;
use surfel::reference::{self, MARGIN_F32};
use surfel::select::{DepthConvention, View, cut};
use surfel::standalone::{Offscreen, Options, Shot, stress};
use surfel::structure::groups::{Groups, Relax};
use surfel::structure::{Cloud, Flat};
use surfel::style::{BackFaces, Ellipse, EyeDome, Footprint, Shading, Style, Tolerance};
use surfel::technique::{Blend, PRESETS, Technique};
use surfel::{FrameStats, Instance};

use crate::vulkan;

pub const SIZE: [u32; 2] = [200, 140];
pub const WEIGHTED: f64 = stress::TARGET;
pub const UNWEIGHTED: f64 = 1e-5;

/// Far from the origin: what f32 alone could not hold.
const ORIGIN: DVec3 = DVec3::new(5e5, 4e6, 100.0);

fn random(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 40) as f32 / (1u32 << 24) as f32
}

/// A closed sphere of 3000 evenly spread splats in random colours.
fn sphere() -> PointCloud {
    let mut cloud = synthetic::scene("sphere", 3000, 1).expect("a scene of this name");
    let mut state = 7;
    cloud.colors = Some((0..cloud.len()).map(|_| [0; 3].map(|_: u8| (random(&mut state) * 255.0) as u8)).collect());
    cloud.origin = ORIGIN;
    cloud.closed = true;
    cloud
}

/// 400 disks of all sizes and directions in a cube, a tenth without a normal.
fn soup() -> PointCloud {
    let mut state = 9;
    let mut vector = |i: usize| match i % 10 {
        9 => Vec3::ZERO,
        _ => Vec3::from_array([0; 3].map(|_: u8| 2.0 * random(&mut state) - 1.0)),
    };
    let positions = (0..400).map(|_| vector(0)).collect();
    let normals = Some((0..400).map(&mut vector).collect());
    let radii = Some((0..400).map(|_| 0.3 * random(&mut state)).collect());
    let colors = Some((0..400).map(|_| [0; 3].map(|_: u8| (random(&mut state) * 255.0) as u8)).collect());
    PointCloud { origin: ORIGIN, positions, normals, radii, colors, ..PointCloud::default() }
}

fn views() -> Vec<(&'static str, View)> {
    let aspect = SIZE[0] as f64 / SIZE[1] as f64;
    let lens = View::perspective(0.8, aspect, 0.01);
    let look = |from: DVec3, to: DVec3, lens| {
        View::look_at(ORIGIN + from, ORIGIN + to, DVec3::Y, lens, DepthConvention::Reversed)
    };
    let outside = dvec3(0.3, 0.5, 3.0);
    let mut shifted = lens;
    (shifted.z_axis.x, shifted.z_axis.y) = (0.2, -0.1);
    let mut standard = look(outside, DVec3::ZERO, lens);
    (standard.projection.z_axis.z, standard.projection.w_axis.z) = (-1.0, -0.01);
    standard.depth = DepthConvention::Standard;
    let mirror = DMat4::from_scale(dvec3(1.0, 1.0, -1.0));
    let mut left = look(outside, DVec3::ZERO, lens);
    (left.view, left.projection) = (mirror * left.view, left.projection * mirror);
    let flipped = DMat4::from_scale(dvec3(1.0, -1.0, 1.0)) * lens;
    vec![
        ("outside", look(outside, DVec3::ZERO, lens)),
        ("near", look(dvec3(0.0, 0.3, 1.2), DVec3::ZERO, lens)),
        ("inside", look(dvec3(0.1, 0.2, 0.2), dvec3(1.0, 0.5, 0.1), lens)),
        ("far", look(20.0 * outside, DVec3::ZERO, View::perspective(0.05, aspect, 1.0))),
        ("asymmetric", look(outside, DVec3::ZERO, shifted)),
        ("orthographic", look(outside, DVec3::ZERO, View::orthographic(2.5, aspect, 0.1, 10.0))),
        ("standard", standard),
        ("left-handed", left),
        ("flipped", look(outside, DVec3::ZERO, flipped)),
    ]
}

fn styles() -> Vec<(&'static str, Style)> {
    let plain = Style { shading: Shading::None, ..Style::default() };
    vec![
        ("plain", plain),
        ("approximate", Style { ellipse: Ellipse::Approximate, back_faces: BackFaces::Draw, ..plain }),
        ("phong", Style { shading: Shading::PHONG, back_faces: BackFaces::Cull, ..plain }),
        (
            "headlight",
            Style {
                shading: Shading::HEADLIGHT,
                tolerance: Tolerance { absolute: 0.1, relative: 0.0 },
                low_pass: 2.0,
                radius_scale: 0.5,
                ..plain
            },
        ),
    ]
}

/// What is compared, and how far it may be off.
pub struct Case<'a> {
    pub name: String,
    pub size: [u32; 2],
    pub instances: &'a [(Cloud, Instance)],
    pub view: &'a View,
    pub technique: Technique,
    pub style: &'a Style,
    pub bound: f64,
    /// Pixels that may be off further, all of them ties.
    pub ties: usize,
}

impl<'a> Case<'a> {
    /// Splats of a structure, of all levels, in a picture of [`SIZE`]: there is about twice as much that could be a tie as in
    /// a flat cloud, where one level is drawn; for discs that cut each other see `every_view_and_style`.
    pub fn levels(
        name: String,
        instances: &'a [(Cloud, Instance)],
        view: &'a View,
        technique: Technique,
        style: &'a Style,
    ) -> Case<'a> {
        let (bound, ties) = if technique.blend == Blend::Opaque { (UNWEIGHTED, 4 * FEW) } else { (WEIGHTED, 2 * FEW) };
        Case { name, size: SIZE, instances, view, technique, style, bound, ties }
    }

    /// Weighted splats as points, in a picture of [`SIZE`].
    fn two_pass(name: String, instances: &'a [(Cloud, Instance)], view: &'a View, style: &'a Style) -> Case<'a> {
        let technique = Technique::TWO_PASS;
        Case { name, size: SIZE, instances, view, technique, style, bound: WEIGHTED, ties: FEW }
    }
}

pub fn check(off: &mut Offscreen, case: &Case) -> FrameStats {
    let name = &case.name;
    let instances: Vec<Instance> = case.instances.iter().map(|(_, i)| *i).collect();
    let shot =
        Shot { view: case.view, instances: &instances, technique: case.technique, style: case.style, count: true };
    let (stats, _) = off.draw(&shot).expect("a frame");
    let picture = off.read().expect("a picture");
    vulkan::hash(name, &picture);

    let scene: Vec<reference::Instance> =
        case.instances.iter().map(|(c, i)| reference::Instance::of(c, i.transform)).collect();
    let placed: Vec<_> = case.instances.iter().map(|(cloud, i)| (cloud, i.transform)).collect();
    let list = cut::drawn(&placed, case.view, case.size, case.style);
    let expected = reference::render(
        &reference::Scene {
            instances: &scene,
            list: &list,
            view: case.view,
            width: case.size[0],
            height: case.size[1],
            technique: case.technique,
            style: case.style,
            host_depth: None,
        },
        MARGIN_F32,
    );

    let culled = stats.culled.expect("counted");
    let drawn = stats.points_drawn.expect("counted");
    assert_eq!(stats.points_submitted, drawn + culled.total(), "{name}: the account");
    let counts = &expected.counts;
    assert_eq!(
        (drawn, culled.frustum, culled.cone, culled.invalid),
        (counts.drawn, counts.culled_frustum, counts.culled_cone, counts.culled_invalid),
        "{name}: drawn, outside, facing away, invalid"
    );
    assert_eq!((culled.interval, culled.occluded), (stats.points_submitted - list.submitted(), 0), "{name}");

    let gain = match case.style.shading {
        _ if case.bound == UNWEIGHTED => 1.0,
        Shading::None => 1.0,
        Shading::Headlight { .. } => 3.0,
        _ => 6.4,
    };
    let shown = |rgba: Vec<[f32; 4]>| Picture { rgba, depth: None, ..picture }.encode([0, 0, 0, 255]);
    let bytes = shown(picture.rgba.clone());
    let want_bytes = shown(expected.rgba.iter().map(|p| p.map(|v| v as f32)).collect());
    let (mut off_ties, mut worst) = (0, 0.0f64);
    for (i, want) in expected.rgba.iter().enumerate() {
        let got = picture.rgba[i].map(f64::from);
        let error = (0..4).map(|k| (want[k] - got[k]).abs()).fold(0.0, f64::max);
        if !expected.ties[i] {
            worst = worst.max(error);
        }
        if error > case.bound * gain * (expected.sensitivity[i] / stress::STEEPEST).max(1.0) {
            let at = (i as u32 % case.size[0], i as u32 / case.size[0]);
            assert!(expected.ties[i], "{name}, pixel {at:?}: {got:?} is not {want:?}");
            off_ties += 1;
        }
        // What ships: one step of 255 where light is within 3·10⁻⁴, which is less than a step in the dark.
        if !expected.ties[i] && case.bound * gain * expected.sensitivity[i] < 3e-4 * stress::STEEPEST {
            let step = (4 * i..4 * i + 4).map(|k| bytes[k].abs_diff(want_bytes[k])).max();
            assert!(step <= Some(1) || case.bound > 3e-4, "{name}, pixel {i}: {step:?} steps of 255");
        }
        let depth = case.view.right_handed().linear_depth(picture.depth.as_ref().expect("depth")[i] as f64);
        let front = expected.depth[i];
        // Position by δ = 10⁻⁴ px on a slope of at most 8, in the host's depth of 24 bits: some 10⁻⁵; standard depth
        // keeps 2⁻²⁴ of 1 − near/z, that is z/near times as much.
        let bound = if case.view.depth == DepthConvention::Standard { 1e-4 } else { 2e-5 };
        assert!(
            expected.ties[i] || (front.is_infinite() && want[3] == 0.0) || (depth / front - 1.0).abs() < bound,
            "{name}, pixel {i}: depth {depth} is not {front}"
        );
    }
    println!("{name}: worst {worst:.1e}, {off_ties} ties off");
    assert!(off_ties <= case.ties, "{name}: {off_ties} ties are off, {} may be", case.ties);
    let covered = expected.rgba.iter().filter(|p| p[3] > 0.0).count();
    // A sphere seen from inside has only faces that look away.
    let all_away = case.style.back_faces == BackFaces::Cull && counts.drawn == 0;
    assert!(covered > expected.rgba.len() / 14 || all_away, "{name}: only {covered} pixels show anything");
    stats
}

fn add(off: &mut Offscreen, cloud: &PointCloud) -> (Cloud, Instance) {
    let flat = Arc::new(grouped(Flat::new(cloud)));
    let id = off.renderer.add(Arc::clone(&flat)).expect("a cloud");
    (flat.into(), Instance { cloud: id, transform: DMat4::IDENTITY })
}

/// With groups that overlap themselves a little: what decides between them is tested too.
fn grouped(mut flat: Flat) -> Flat {
    flat.groups = Some(Groups::color(&flat, &Relax { factor: 0.6, ..Relax::default() }).expect("groups"));
    flat
}

/// Less than one in ten thousand.
pub const FEW: usize = (SIZE[0] * SIZE[1] / 10_000) as usize;

fn every_view_and_style(options: &Options, presets: &[(&'static str, Technique)]) {
    vulkan::draw_with(options, SIZE, true, |off| {
        for (scene, cloud) in [("sphere", sphere()), ("soup", soup())] {
            let instances = [add(off, &cloud)];
            for (v, view) in &views() {
                for (s, style) in &styles() {
                    for (t, technique) in presets {
                        let opaque = technique.blend == Blend::Opaque;
                        check(
                            off,
                            &Case {
                                name: format!("{scene}, {v}, {s}, {t}"),
                                size: SIZE,
                                instances: &instances,
                                view,
                                technique: *technique,
                                style,
                                bound: if opaque { UNWEIGHTED } else { WEIGHTED },
                                // Neighbouring discs of a smooth surface cut each other in lines, where the nearer is a
                                // matter of rounding: a pixel is 10⁻⁴ px from such a line in one of 10⁴ cases a line,
                                // some four lines a pixel. From 20 times as far depths round 20 times as coarsely.
                                ties: match (opaque, *v) {
                                    (true, "far") => 80 * FEW,
                                    (true, _) => 4 * FEW,
                                    (false, _) => FEW,
                                },
                            },
                        );
                    }
                }
            }
        }
    });
}

#[test]
fn every_technique_view_and_style() {
    every_view_and_style(&vulkan::options(), PRESETS);
}

#[test]
fn quads_stand_in_where_points_cannot_be_large() {
    let options = Options { without: vec!["largePoints".into()], ..vulkan::options() };
    every_view_and_style(&options, &[("flat.two-pass.point", Technique::TWO_PASS), PRESETS[0]]);
}

#[test]
fn clouds_are_placed_turned_and_scaled() {
    vulkan::draw(SIZE, true, |off| {
        let mut instances = vec![add(off, &sphere()), add(off, &soup())];
        // About the scene's origin, far from the world's.
        let about = |m: DMat4| DMat4::from_translation(ORIGIN) * m * DMat4::from_translation(-ORIGIN);
        instances[0].1.transform = about(DMat4::from_scale_rotation_translation(
            DVec3::splat(0.7),
            DQuat::from_rotation_x(0.6) * DQuat::from_rotation_y(1.1),
            dvec3(-0.6, 0.2, 0.0),
        ));
        let mut twin = instances[1].clone();
        instances[1].1.transform = about(DMat4::from_translation(dvec3(0.8, 0.0, 0.0)));
        twin.1.transform = about(DMat4::from_scale(DVec3::splat(0.3)));
        instances.push(twin);
        for (v, view) in &views() {
            let style = Style { shading: Shading::HEADLIGHT, ..Style::default() };
            let name = format!("placed, {v}");
            check(off, &Case::two_pass(name, &instances, view, &style));
        }
    });
}

#[test]
fn squares_of_a_given_size() {
    vulkan::draw(SIZE, true, |off| {
        let instances = [add(off, &sphere())];
        for (t, technique) in PRESETS.iter().filter(|(_, t)| t.blend == Blend::Opaque) {
            let style = Style { footprint: Footprint::Pixels(3.0), shading: Shading::None, ..Style::default() };
            let view = &views()[0].1;
            // A square's border passes within 1/256 px of a pixel's centre (where the rasteriser snaps) in one of 64
            // cases a side: the reference marks those.
            let ties = (SIZE[0] * SIZE[1] / 64) as usize;
            let name = format!("squares, {t}");
            check(
                off,
                &Case {
                    technique: *technique,
                    bound: UNWEIGHTED,
                    ties,
                    ..Case::two_pass(name, &instances, view, &style)
                },
            );
        }
    });
}

#[test]
fn squares_wider_than_the_largest_point_are_quads() {
    // 300 px in a picture that does not clip them to less than the 255 px of lavapipe's points.
    vulkan::draw([400, 400], false, |off| {
        let instances = [add(off, &sphere()).1];
        let view = &views()[0].1;
        let style = Style { footprint: Footprint::Pixels(300.0), shading: Shading::None, ..Style::default() };
        let mut pictures = Vec::new();
        for name in ["flat.opaque.point", "flat.opaque.quad"] {
            let technique = Technique::named(name).expect("a preset");
            off.draw(&Shot { view, instances: &instances, technique, style: &style, count: false }).expect("a frame");
            pictures.push(off.read().expect("a picture"));
        }
        // A sphere of some 250 px, grown by 150 on each side, is wider than the picture.
        assert!(pictures[0].coverage() > 0.99, "{}", pictures[0].coverage());
        assert!(pictures[0] == pictures[1], "points and quads differ");
    });
}

#[test]
fn eye_dome_lighting() {
    vulkan::draw(SIZE, true, |off| {
        let instances = [add(off, &soup())];
        for (v, view) in views().iter().filter(|(v, _)| *v != "left-handed") {
            let style = Style { eye_dome: Some(EyeDome::default()), shading: Shading::None, ..Style::default() };
            // exp(−100 s), s a mean of logarithms of depths, each good to 2·10⁻⁵: 3·10⁻³ of the colour more.
            let bound = WEIGHTED + 3e-3;
            let name = format!("eye-dome, {v}");
            check(off, &Case { bound, ..Case::two_pass(name, &instances, view, &style) });
        }
    });
}

#[test]
fn a_point_of_any_kind_does_no_harm() {
    vulkan::draw(SIZE, true, |off| {
        let mut cloud = soup();
        let radii = cloud.radii.as_mut().expect("radii");
        for (i, r) in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-20, 50.0].into_iter().enumerate() {
            radii[i] = r;
        }
        cloud.positions[6] = Vec3::splat(f32::NAN);
        cloud.positions[7] = Vec3::new(f32::INFINITY, 0.0, 0.0);
        let instances = [add(off, &cloud)];
        for v in [0, 2] {
            let (name, view) = &views()[v];
            let style = Style { shading: Shading::None, ..Style::default() };
            let name = format!("odd points, {name}");
            check(off, &Case::two_pass(name, &instances, view, &style));
        }
    });
}

#[test]
fn the_reference_would_notice() {
    // The whole comparison is worth nothing if it passes for the wrong picture: another radius by 2 % must fail.
    let wrong = std::panic::catch_unwind(|| {
        vulkan::draw(SIZE, true, |off| {
            let (_, instance) = add(off, &sphere());
            let mut other = sphere();
            other.radii.as_mut().expect("radii").iter_mut().for_each(|r| *r *= 1.02);
            let instances = [(Cloud::from(Flat::new(&other)), instance)];
            let view = &views()[0].1;
            let style = Style { shading: Shading::None, ..Style::default() };
            let name = "wrong on purpose".into();
            check(off, &Case::two_pass(name, &instances, view, &style));
        });
    });
    let said = wrong.expect_err("the comparison must fail");
    let said = said.downcast_ref::<String>().expect("a message");
    assert!(said.contains("wrong on purpose, pixel") && said.contains("is not"), "{said}");
}

#[test]
fn a_cloud_of_several_chunks() {
    // A chunk has 2²² points: the sheet of the last ones, in the second, lies in front of all others.
    const FIRST: usize = 1 << 22;
    vulkan::draw([48, 32], true, |off| {
        let n = FIRST + 3000;
        let mut state = 5;
        let mut place = |i: usize| {
            let (x, y) = (2.0 * random(&mut state) - 1.0, 2.0 * random(&mut state) - 1.0);
            Vec3::new(x, y, if i < FIRST { 0.0 } else { 0.5 })
        };
        let cloud = PointCloud {
            origin: ORIGIN,
            positions: (0..n).map(&mut place).collect(),
            radii: Some((0..n).map(|i| if i < FIRST { 0.002 } else { 0.01 }).collect()),
            colors: Some((0..n).map(|i| [255, 128, if i < FIRST { 0 } else { 200 }]).collect()),
            ..PointCloud::default()
        };
        let instances = [add(off, &cloud)];
        let size = [48, 32];
        let lens = View::perspective(0.8, 1.5, 0.01);
        let view = View::look_at(ORIGIN + 3.0 * DVec3::Z, ORIGIN, DVec3::Y, lens, DepthConvention::Reversed);
        let style = Style { shading: Shading::None, ..Style::default() };
        // Some 3000 splats of the far sheet meet in a pixel: two sums of n terms, rounded by n 2⁻²⁴ each.
        let bound = WEIGHTED + 2.0 * 4000.0 / (1u32 << 24) as f64;
        let case = Case::two_pass("two chunks".into(), &instances, &view, &style);
        check(off, &Case { size, bound, ties: 2, ..case });
    });
}
