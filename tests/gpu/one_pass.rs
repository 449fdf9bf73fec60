//! `fuzzy` and `groups` beyond what every technique is tested for: each way to be drawn, each rule, and what is refused.

use std::sync::Arc;

use glam::{DMat4, DVec3, dvec3};
use surfel::load::synthetic;
use surfel::readback::Picture;
use surfel::reference::{self, MARGIN_F32};
use surfel::select::{DepthConvention, DrawList, View};
use surfel::standalone::stress::{STEEPEST, TARGET};
use surfel::standalone::{Offscreen, Options, Shot};
use surfel::stats::OrderedAccess;
use surfel::structure::groups::{Groups, Relax};
use surfel::structure::{Arrangement, Flat};
use surfel::style::{Front, Shading, Style, SumPrecision, Tolerance, Voronoi};
use surfel::technique::{Blend, Primitive, Technique};
use surfel::{Error, FrameStats, Instance, Interlock};

use crate::vulkan;

const SIZE: [u32; 2] = [160, 120];

fn technique(blend: Blend) -> Technique {
    Technique { blend, ..Technique::TWO_PASS }
}

fn unlit() -> Style {
    Style { shading: Shading::None, ..Style::default() }
}

/// A torus whose inside is seen through its hole, in colours of its own: half of it lies behind the other half.
fn torus(factor: f32) -> Flat {
    let mut cloud = synthetic::scene("torus", 4000, 1).expect("a torus");
    let normals = cloud.normals.as_ref().expect("normals");
    cloud.colors = Some(normals.iter().map(|n| n.to_array().map(|v| (127.5 + 127.0 * v) as u8)).collect());
    cloud.closed = false;
    let mut flat = Flat::new(&cloud);
    flat.groups = Some(Groups::color(&flat, &Relax { factor, ..Relax::default() }).expect("groups"));
    flat
}

/// From so near that some splats are cast in eye space, others not.
fn view() -> View {
    let lens = View::perspective(0.9, SIZE[0] as f64 / SIZE[1] as f64, 0.01);
    View::look_at(dvec3(0.9, 0.6, 1.1), DVec3::ZERO, DVec3::Y, lens, DepthConvention::Reversed)
}

fn draw(
    off: &mut Offscreen,
    flat: &Arc<Flat>,
    technique: Technique,
    style: &Style,
) -> Result<(Picture, FrameStats), Error> {
    let cloud = off.renderer.add(Arc::clone(flat))?;
    let instances = [Instance { cloud, transform: DMat4::IDENTITY }];
    let drawn = off.draw(&Shot { view: &view(), instances: &instances, technique, style, count: true });
    off.renderer.remove(cloud);
    let (stats, _) = drawn?;
    Ok((off.read()?, stats))
}

/// Within the bound of the earlier suite wherever rounding decides nothing; ties that are off are less than one in a
/// hundred, beside the lines where splats of a group meet.
fn check(name: &str, picture: &Picture, flat: &Flat, technique: Technique, style: &Style) {
    let expected = reference::render(
        &reference::Scene {
            instances: &[reference::Instance::points(flat, DMat4::IDENTITY)],
            list: &DrawList::all([flat.len() as u32]),
            view: &view(),
            width: SIZE[0],
            height: SIZE[1],
            technique,
            style,
            host_depth: None,
        },
        MARGIN_F32,
    );
    let mut off = 0;
    let mut ties = 0;
    let mut covered = 0;
    for (i, want) in expected.rgba.iter().enumerate() {
        let error = (0..4).map(|k| (want[k] - f64::from(picture.rgba[i][k])).abs()).fold(0.0, f64::max);
        let bound = TARGET * (expected.sensitivity[i] / STEEPEST).max(1.0);
        assert!(error < bound || expected.ties[i], "{name}, pixel {i}: {:?} is not {want:?}", picture.rgba[i]);
        off += (error >= bound) as usize;
        ties += expected.ties[i] as usize;
        covered += (want[3] > 0.0) as usize;
    }
    println!("{name}: {off} of {ties} ties are off, {covered} pixels");
    assert!(off * 100 < covered, "{name}: {off} ties are off");
    // With cuts at the nearest depth, splats of one plane are decided by rounding alone: nearly all of their pixels are ties.
    assert!(ties * 10 < covered || style.voronoi == Voronoi::Off, "{name}: {ties} ties prove little");
    assert!(covered > expected.rgba.len() / 4, "{name}: {covered} pixels show anything");
}

fn without(names: &[&str]) -> Options {
    Options { without: names.iter().map(|n| n.to_string()).collect(), ..vulkan::options() }
}

const ORDER: &str = "rasterizationOrderColorAttachmentAccess";
const TURNS: &str = "fragmentShaderPixelInterlock";

#[test]
fn fuzzy_is_the_replay_in_every_order() {
    vulkan::draw(SIZE, true, |off| {
        let flat = torus(0.6);
        let away = view();
        let mut pictures = Vec::new();
        for (order, how) in Arrangement::ALL {
            let flat = Arc::new(flat.arranged(*how, |p| -away.view.transform_point3(p).z));
            for (front, rule) in Front::ALL {
                let style = Style { front: *rule, ..unlit() };
                for primitive in [Primitive::Point, Primitive::Quad] {
                    let technique = Technique { primitive, ..technique(Blend::Fuzzy) };
                    let (picture, stats) = draw(off, &flat, technique, &style).expect("a picture");
                    check(&format!("{order}, {front}, {primitive}"), &picture, &flat, technique, &style);
                    assert_eq!((stats.blend, stats.ordered), (Blend::Fuzzy, Some(OrderedAccess::RasterizationOrder)));
                    let hash = vulkan::digest(&picture);
                    vulkan::hash(&format!("one-pass {order} {front} {primitive}"), &picture);
                    pictures.push(hash);
                }
            }
        }
        pictures.sort();
        pictures.dedup();
        assert!(pictures.len() > Arrangement::ALL.len(), "the order makes a difference");
    });
}

#[test]
fn every_way_of_fuzzy_draws_the_same() {
    let flat = Arc::new(torus(0.6));
    let shaded = Style { shading: Shading::PHONG, ..Style::default() };
    let mut hashes = Vec::new();
    for interlock in [false, true] {
        let mut options = if interlock { without(&[ORDER]) } else { vulkan::options() };
        options.implicit_interlock = interlock;
        vulkan::draw_with(&options, SIZE, true, |off| {
            let wanted = if interlock { OrderedAccess::Interlock } else { OrderedAccess::RasterizationOrder };
            assert_eq!(off.standalone().enabled.interlock != Interlock::Absent, interlock);
            for style in [unlit(), shaded, Style { front: Front::First, ..unlit() }] {
                let (picture, stats) = draw(off, &flat, technique(Blend::Fuzzy), &style).expect("a picture");
                assert_eq!((stats.blend, stats.ordered), (Blend::Fuzzy, Some(wanted)));
                hashes.push((interlock, vulkan::digest(&picture)));
            }
            // Storage images have one format.
            let half = Style { sums: SumPrecision::Half, ..unlit() };
            let (_, stats) = draw(off, &flat, technique(Blend::Fuzzy), &half).expect("a picture");
            assert_eq!(stats.sums, if interlock { SumPrecision::Single } else { SumPrecision::Half });
        });
    }
    let (attachments, storage): (Vec<_>, Vec<_>) = hashes.into_iter().partition(|(interlock, _)| !interlock);
    assert!(attachments.iter().map(|h| h.1).eq(storage.iter().map(|h| h.1)), "bit by bit: one rule, one order");
}

#[test]
fn without_order_or_layers_two_passes_are_drawn_and_said() {
    let flat = Arc::new(torus(0.6));
    let mut two_pass = None;
    vulkan::draw_with(&without(&[ORDER, TURNS, "shaderOutputLayer"]), SIZE, true, |off| {
        for blend in [Blend::TwoPass, Blend::Fuzzy, Blend::Groups] {
            let (picture, stats) = draw(off, &flat, technique(blend), &unlit()).expect("a picture");
            assert_eq!((stats.blend, stats.ordered, stats.layers), (Blend::TwoPass, None, 0));
            assert_eq!(stats.skipped.iter().any(|s| s.stage == blend.name()), blend != Blend::TwoPass);
            let hash = vulkan::digest(&picture);
            assert_eq!(hash, *two_pass.get_or_insert(hash), "{blend}");
        }
    });
}

#[test]
fn groups_of_every_kind_are_the_reference_s() {
    vulkan::draw(SIZE, true, |off| {
        for factor in [0.0, 0.4, 1.0] {
            let flat = Arc::new(torus(factor));
            let groups = flat.groups.as_ref().expect("groups");
            for (name, voronoi) in Voronoi::ALL {
                let style = Style { voronoi: *voronoi, ..unlit() };
                let (picture, stats) = draw(off, &flat, technique(Blend::Groups), &style).expect("a picture");
                check(&format!("c = {factor}, {name}"), &picture, &flat, technique(Blend::Groups), &style);
                assert_eq!((stats.blend, stats.layers), (Blend::Groups, groups.count));
                let skipped = stats.skipped.iter().any(|s| s.stage == "voronoi depth");
                assert_eq!(skipped, *voronoi == Voronoi::Off || !groups.overlapping, "c = {factor}, {name}");
                vulkan::hash(&format!("one-pass groups {factor} {name}"), &picture);
            }
        }
    });
}

#[test]
fn what_cannot_be_drawn_is_refused_and_draws_nothing() {
    vulkan::draw(SIZE, true, |off| {
        let bare = Arc::new(Flat { groups: None, ..torus(1.0) });
        let refused = |off: &mut Offscreen, flat: &Arc<Flat>, blend, style: &Style| match draw(
            off,
            flat,
            technique(blend),
            style,
        ) {
            Err(Error::Unsupported(why)) => why,
            other => panic!("not refused: {:?}", other.map(|(_, stats)| stats)),
        };
        assert!(refused(off, &bare, Blend::Groups, &unlit()).contains("Flat::groups"));
        for (absolute, relative) in
            [(0.0, 0.0), (f32::NAN, 1.0), (0.0, f32::NAN), (-1.0, 1.0), (0.0, -1.0), (0.0, f32::INFINITY)]
        {
            let style = Style { tolerance: Tolerance { absolute, relative }, ..unlit() };
            for blend in [Blend::TwoPass, Blend::Fuzzy, Blend::Groups] {
                assert!(refused(off, &bare, blend, &style).contains("Tolerance"), "{absolute} {relative} {blend}");
            }
            draw(off, &bare, technique(Blend::Opaque), &style).expect("opaque has no tolerance");
        }
        // More layers than any device has. The count alone decides, so the bytes may stay as they are.
        let mut many = torus(1.0);
        many.groups.as_mut().expect("groups").count = 1 << 20;
        let why = refused(off, &Arc::new(many), Blend::Groups, &unlit());
        assert!(why.contains("1048576 groups") && why.contains("layers at most"), "{why}");
        // And after all that it draws.
        let good = Arc::new(torus(0.6));
        let (picture, _) = draw(off, &good, technique(Blend::Groups), &unlit()).expect("a picture");
        assert!(picture.coverage() > 0.25);
    });
}

#[test]
fn layers_that_no_memory_holds_are_an_error() {
    vulkan::draw([4096, 4096], false, |off| {
        let mut flat = torus(1.0);
        flat.groups.as_mut().expect("groups").count = 2048;
        let flat = Arc::new(flat);
        // 28 B a pixel and layer: 0.9 TiB.
        match draw(off, &flat, technique(Blend::Groups), &unlit()) {
            Err(Error::OutOfDeviceMemory { .. }) => {}
            other => panic!("{:?}", other.map(|(_, stats)| stats.device_bytes)),
        }
    });
}

#[test]
fn features_that_are_none_are_named() {
    let options = without(&["warpDrive"]);
    let Err(Error::Unsupported(why)) = surfel::standalone::Standalone::new(&options) else { panic!("it was taken") };
    assert!(why.contains("warpDrive") && why.contains(ORDER) && why.contains("largePoints"), "{why}");
}
