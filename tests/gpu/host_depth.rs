//! The engine's geometry cuts through the splats: against the f64 reference, which is given the same depth buffer.

use glam::{DVec3, dvec3};
use surfel::reference::{self, MARGIN_F32};
use surfel::select::{DepthConvention, DrawList, View};
use surfel::standalone::stress::{STEEPEST, TARGET};
use surfel::style::Style;
use surfel::technique::{Blend, PRESETS};

use crate::host_engine::Engine;
use crate::host_scene::sphere;
use crate::host_target::{Depth, FAR_COLOR, FAR_Z, Kind, NEAR_COLOR, NEAR_Z, PLAIN, depth_of};
use crate::host_targets::{scene, show};

/// So near that the geometry on the left, at 0.5, leaves a cap of the sphere in front of it.
fn close(depth: DepthConvention) -> View {
    let mut projection = View::perspective(70f64.to_radians(), 4.0 / 3.0, 0.1);
    if depth == DepthConvention::Standard {
        (projection.z_axis.z, projection.w_axis.z) = (-1.0, -0.1);
    }
    View::look_at(dvec3(0.1, 0.2, 1.4), DVec3::ZERO, DVec3::Y, projection, depth)
}

#[test]
fn geometry_cuts_through_splats() {
    Engine::with(|engine| {
        let [w, h] = PLAIN.extent;
        for (name, technique) in PRESETS {
            for convention in [DepthConvention::Reversed, DepthConvention::Standard] {
                let view = close(convention);
                let kind = Kind { depth: Depth::Lent, convention, geometry: true, ..PLAIN };
                let under = |x: u32, y: u32| match (x < w / 2, y < h / 2) {
                    (true, _) => (NEAR_COLOR, depth_of(&view, NEAR_Z) as f32),
                    (false, false) => (FAR_COLOR, depth_of(&view, FAR_Z) as f32),
                    (false, true) => ([0.0; 4], convention.far() as f32),
                };
                let host: Vec<f32> = (0..w * h).map(|i| under(i % w, i / w).1).collect();
                let (flat, style) = (sphere(1500), Style::default());
                show(engine, kind, &[view], *technique, |target, cloud| {
                    let instances = scene(cloud).map(|i| reference::Instance::points(&flat, i.transform));
                    let expected = reference::render(
                        &reference::Scene {
                            instances: &instances,
                            list: &DrawList::all([1500, 1500]),
                            view: &view,
                            width: w,
                            height: h,
                            technique: *technique,
                            style: &style,
                            host_depth: Some(&host),
                        },
                        MARGIN_F32,
                    );
                    let (mut cut, mut off) = (0, 0);
                    for (i, want) in expected.rgba.iter().enumerate() {
                        let (x, y) = (i as u32 % w, i as u32 / w);
                        let got = target.pixel(0, x, y);
                        let (color, _) = under(x, y);
                        // The lamp at the eye: three times what a colour moves by, as in against_reference.rs.
                        let weighted = 3.0 * TARGET * (expected.sensitivity[i] / STEEPEST).max(1.0);
                        let bound = if technique.blend == Blend::Opaque { 1e-5 } else { weighted };
                        let error = |k: usize| (want[k] + (1.0 - want[3]) * color[k] as f64 - got[k] as f64).abs();
                        let error = (0..4).map(error).fold(0.0, f64::max);
                        assert!(
                            error < bound || expected.ties[i],
                            "{name}, {convention:?}, {x} {y}: {got:?}, {want:?}"
                        );
                        off += (error >= bound) as u32;
                        cut += (x < w / 2 && want[3] > 0.0) as u32;
                    }
                    // One in a thousand: the cut is a line of ties of some 60 pixels, each within rounding once in 10³.
                    assert!(off <= 3, "{name}, {convention:?}: {off} ties are off");
                    let left = w * h / 2;
                    assert!(
                        cut > left / 20 && cut < left * 19 / 20,
                        "{name}: {cut} of {left} pixels lie before the cut"
                    );
                });
            }
        }
    });
}
