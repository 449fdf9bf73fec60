//! Packed points on the device: they are decoded to the very floats that the processor has, and drawn as the reference says.

use std::sync::Arc;

use glam::DMat4;
use surfel::Instance;
use surfel::readback::Picture;
use surfel::select::View;
use surfel::standalone::{Offscreen, Shot};
use surfel::structure::groups::{Groups, Relax};
use surfel::structure::octree::{self, Preset};
use surfel::structure::{Cloud, Flat, Octree, Packing, Sequential, sequential};
use surfel::style::{Interval, Style};
use surfel::technique::{Blend, Primitive, Selection, Technique};

use crate::against_reference::{Case, SIZE, check};
use crate::levels::{colored_torus, near, perspective};
use crate::vulkan;

const PACKED: [Packing; 2] = [Packing::Exact, Packing::Quantised];

/// A torus far from its origin, in colours of its own, and points that cannot be drawn.
fn torus(normals: bool, colors: bool) -> Flat {
    let mut cloud = colored_torus(5000);
    cloud.colors = cloud.colors.filter(|_| colors);
    cloud.normals = cloud.normals.filter(|_| normals);
    let mut flat = Flat::new(&cloud);
    flat.geometry[300][3] = 0.0;
    flat.geometry[301][0] = f32::NAN;
    flat.geometry[302][3] = f32::INFINITY;
    flat.groups = Some(Groups::color(&flat, &Relax { factor: 0.5, limit: 24, ..Relax::default() }).expect("groups"));
    flat
}

const WAYS: [(Blend, Primitive); 6] = [
    (Blend::Fuzzy, Primitive::Point),
    (Blend::Fuzzy, Primitive::Quad),
    (Blend::Opaque, Primitive::Point),
    (Blend::Opaque, Primitive::Quad),
    (Blend::TwoPass, Primitive::Point),
    (Blend::Groups, Primitive::Point),
];

#[test]
fn packed_points_are_drawn_as_the_reference_does() {
    vulkan::draw(SIZE, true, |off| {
        for packing in PACKED {
            let cloud = Cloud::from(torus(true, true)).packed(packing);
            let id = off.renderer.add(cloud.clone()).expect("a cloud");
            let instances = [(cloud, Instance { cloud: id, transform: DMat4::IDENTITY })];
            for (v, view) in [("whole", perspective()), ("near", near())] {
                // Discs seen nearly edge-on from near are steeper than the slope that `check` allows depths for.
                let ways = WAYS.iter().filter(|(blend, _)| v == "whole" || *blend != Blend::Opaque);
                for &(blend, primitive) in ways {
                    let technique = Technique { primitive, blend, ..Technique::TWO_PASS };
                    let name = format!("{packing}, {v}, {blend} {primitive}");
                    check(off, &Case::levels(name, &instances, &view, technique, &Style::default()));
                }
            }
            off.renderer.remove(id);
        }
    });
}

fn picture(off: &mut Offscreen, cloud: &Cloud, view: &View, technique: Technique, style: &Style) -> Picture {
    let id = off.renderer.add(cloud.clone()).expect("a cloud");
    let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
    off.draw(&Shot { view, instances: &instances, technique, style, count: true }).expect("a frame");
    off.renderer.remove(id);
    off.read().expect("a picture")
}

/// What is drawn of packed points, and of the same points unpacked: single floats that differ in one bit anywhere would show in
/// some pixel's colour or depth, all of them floats.
fn same(off: &mut Offscreen, name: &str, packed: &Cloud, technique: Technique, style: &Style) {
    assert_ne!(packed.flat().packing(), Packing::Full, "{name}");
    let full = packed.clone().packed(Packing::Full);
    for (v, view) in [("whole", perspective()), ("near", near())] {
        let [a, b] = [packed, &full].map(|cloud| picture(off, cloud, &view, technique, style));
        let differ = a.rgba.iter().zip(&b.rgba).filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count();
        assert!(a.rgba.iter().any(|p| p[3] > 0.0), "{name}, {v}: nothing is drawn");
        assert!(differ == 0 && a.depth == b.depth, "{name}, {v}: {differ} pixels");
    }
}

#[test]
fn the_device_decodes_to_the_bits_of_the_processor() {
    vulkan::draw(SIZE, true, |off| {
        for (normals, colors) in [(true, true), (true, false), (false, true), (false, false)] {
            let flat = torus(normals, colors);
            for packing in PACKED {
                let cloud = Cloud::from(flat.clone()).packed(packing);
                for (blend, primitive) in WAYS {
                    let technique = Technique { primitive, blend, ..Technique::TWO_PASS };
                    let name = format!("{packing}, normals {normals}, colours {colors}, {blend} {primitive}");
                    same(off, &name, &cloud, technique, &Style::default());
                }
            }
        }
    });
}

#[test]
fn structures_draw_packed_points_as_unpacked_ones() {
    let flat = torus(true, true);
    let mut clouds: Vec<Cloud> = Vec::new();
    for (_, preset) in Preset::ALL {
        let options = octree::Options { block: 200, ..octree::Options::new(*preset) };
        clouds.push(Arc::new(Octree::build(&flat, &options)).into());
    }
    let options = sequential::Options { blocks: 300, ..sequential::Options::default() };
    clouds.push(Arc::new(Sequential::build(&flat, &options)).into());
    vulkan::draw(SIZE, true, |off| {
        for cloud in &clouds {
            for packing in PACKED {
                let packed = cloud.clone().packed(packing);
                for (primitive, selection, interval) in [
                    (Primitive::Point, Selection::Compute, Interval::Exact),
                    (Primitive::Quad, Selection::Compute, Interval::Published),
                    (Primitive::Point, Selection::Vertex, Interval::Published),
                ] {
                    let name = format!("{}, {packing}, {primitive} {selection} {interval}", cloud.structure());
                    let technique = Technique { primitive, selection, ..Technique::default() };
                    let style = Style { threshold: 4.0, interval, ..Style::default() };
                    same(off, &name, &packed, technique, &style);
                }
            }
        }
    });
}
