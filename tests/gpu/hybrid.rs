//! Triangles and points in one picture, as the reference has them, by every blend.
//!
//! Rasterisers snap corners to 1/256 px: a pixel centre so near to a side may belong to either of its faces, which is a tie. The
//! interpolated values are those of the unsnapped triangle, but for 1/256 of their change from pixel to pixel where a device
//! takes the snapped one: colours here change by at most 0.03 a pixel.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, dvec3};
use surfel::Instance;
use surfel::select::{DepthConvention, View};
use surfel::structure::groups::{Groups, Relax};
use surfel::structure::nodes::ErrorRule;
use surfel::structure::{Cloud, Flat, Hybrid, sequential};
use surfel::style::{BackFaces, Shading, Style};
use surfel::technique::{Blend, Primitive, Selection, Technique};

use crate::against_reference::{Case, FEW, SIZE, WEIGHTED, check};
use crate::hybrid_common::torus;
use crate::vulkan;

/// Pixels that snapping may put to the wrong side of an outline. Elsewhere the face beside has the same values there.
///
/// A corner moves by up to 1/512 px along each axis, any way as likely; a side then moves by 1/1024 px on average, less where it is
/// slanted or between its corners, and sweeps so many pixels a px of its length. The outlines of both tori together are nowhere longer than
/// twice around the picture, 1360 px: 1.3 pixels a picture, and more than nine in one of 7·10⁵ (Poisson's distribution).
const SIDES: usize = 9;

/// Those, and what splats may be off.
const TIES: usize = SIDES + FEW;

pub fn hybrid(rule: ErrorRule, closed: bool) -> Cloud {
    let mut cloud = torus(48, 20);
    cloud.closed = closed;
    let options = sequential::Options { rule, blocks: 300, ..Default::default() };
    let mut hybrid = Hybrid::build(&Flat::new(&cloud), cloud.mesh.as_ref().expect("faces"), &options);
    let relax = Relax { factor: 0.5, limit: 24, ..Relax::default() };
    hybrid.tree.flat.groups = Some(Groups::color(&hybrid.tree.flat, &relax).expect("groups"));
    Arc::new(hybrid).into()
}

fn views() -> Vec<(&'static str, View, f32)> {
    let aspect = SIZE[0] as f64 / SIZE[1] as f64;
    let lens = View::perspective(0.9, aspect, 0.01);
    let look = |eye: DVec3, target: DVec3, lens| View::look_at(eye, target, DVec3::Z, lens, DepthConvention::Reversed);
    let place = dvec3(0.8, -2.0, 1.2);
    let flipped = DMat4::from_scale(dvec3(1.0, -1.0, 1.0)) * lens;
    let mirror = DMat4::from_scale(dvec3(1.0, 1.0, -1.0));
    let mut left = look(place, DVec3::ZERO, lens);
    (left.view, left.projection) = (mirror * left.view, left.projection * mirror);
    vec![
        ("triangles", look(place, DVec3::ZERO, lens), 1.0),
        ("both", look(place, DVec3::ZERO, lens), 12.0),
        ("points", look(1.8 * place, DVec3::ZERO, lens), 14.0),
        ("near", look(dvec3(1.1, -0.2, 0.6), dvec3(0.8, 0.5, 0.0), lens), 9.0),
        ("within", look(dvec3(1.0, 0.0, 0.1), dvec3(0.6, 0.8, 0.0), lens), 5.0),
        ("orthographic", look(place, DVec3::ZERO, View::orthographic(2.6, aspect, 0.1, 9.0)), 10.0),
        ("flipped", look(place, DVec3::ZERO, flipped), 12.0),
        ("left-handed", left, 12.0),
    ]
}

#[test]
fn triangles_and_points_are_the_reference_s_with_every_blend() {
    vulkan::draw(SIZE, true, |off| {
        let (mut triangles, mut both, mut points) = (0, 0, 0);
        for (rule, closed) in [(ErrorRule::Geometric, true), (ErrorRule::Split, false)] {
            let cloud = hybrid(rule, closed);
            let id = off.renderer.add(cloud.clone()).expect("a cloud");
            let turned = DMat4::from_scale_rotation_translation(
                DVec3::splat(0.5),
                DQuat::from_rotation_x(1.2),
                dvec3(0.4, 0.3, 0.2),
            );
            let instance = |transform| (cloud.clone(), Instance { cloud: id, transform });
            let instances = [instance(DMat4::IDENTITY), instance(turned)];
            for (name, view, threshold) in views() {
                for (blend, primitive, selection) in [
                    (Blend::TwoPass, Primitive::Point, Selection::Compute),
                    (Blend::Fuzzy, Primitive::Point, Selection::Vertex),
                    (Blend::Groups, Primitive::Quad, Selection::Compute),
                    (Blend::Opaque, Primitive::Point, Selection::Vertex),
                ] {
                    let style = Style { threshold, shading: Shading::None, ..Style::default() };
                    let technique = Technique { primitive, selection, blend, ..Technique::TWO_PASS };
                    let case = Case {
                        name: format!("{rule}, {name}, {blend}"),
                        size: SIZE,
                        instances: &instances,
                        view: &view,
                        technique,
                        style: &style,
                        bound: WEIGHTED,
                        ties: TIES,
                    };
                    let stats = check(off, &case);
                    match (stats.triangles_submitted > 0, stats.points_drawn > Some(0)) {
                        (true, true) => both += 1,
                        (true, false) => triangles += 1,
                        _ => points += 1,
                    }
                }
            }
            off.renderer.remove(id);
        }
        assert!(triangles > 3 && both > 20 && points > 3, "{triangles} {both} {points}");
    });
}

#[test]
fn light_falls_on_both_alike() {
    vulkan::draw(SIZE, true, |off| {
        let cloud = hybrid(ErrorRule::Geometric, true);
        let id = off.renderer.add(cloud.clone()).expect("a cloud");
        let instances = [(cloud.clone(), Instance { cloud: id, transform: DMat4::IDENTITY })];
        let (_, view, threshold) = views().swap_remove(1);
        for (name, shading, back_faces) in [
            ("headlight", Shading::HEADLIGHT, BackFaces::Auto),
            ("phong", Shading::PHONG, BackFaces::Cull),
            ("from behind", Shading::HEADLIGHT, BackFaces::Draw),
        ] {
            for blend in [Blend::TwoPass, Blend::Fuzzy, Blend::Groups] {
                let style = Style { threshold, shading, back_faces, ..Style::default() };
                let technique = Technique { blend, ..Technique::TWO_PASS };
                let name = format!("{name}, {blend}");
                let (instances, view, style) = (&instances, &view, &style);
                check(off, &Case { name, size: SIZE, instances, view, technique, style, bound: WEIGHTED, ties: TIES });
            }
        }
    });
}
