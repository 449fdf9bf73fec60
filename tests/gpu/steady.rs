//! Frames keep no memory: drawing the same again and again takes none that the first frames did not.
//!
//! Not only ours: a driver may keep something for every frame as well. Lavapipe of Mesa 22.3 compiles a shader that branches on
//! parameters whenever it is bound, and keeps the copy until the pipeline goes: half a MB each.

use std::process::Command;

use glam::DMat4;
use surfel::standalone::{Layers, Offscreen, Options, Shot};
use surfel::structure::layered::Streaming;
use surfel::structure::nodes::ErrorRule;
use surfel::structure::{Cloud, Flat, sequential};
use surfel::style::{Ellipse, EyeDome, Footprint, Interval, Shading, Style, Voronoi};
use surfel::technique::{Blend, Primitive, Selection, Technique};
use surfel::{FrameStats, Instance};

use crate::against_reference::SIZE;
use crate::layered::{Model, complete};
use crate::levels::{colored_torus, near, orthographic, perspective, tree};
use crate::vulkan;

/// Set for the process that measures: memory is a process's, and tests share one.
const ALONE: &str = "SURFEL_TEST_ALONE";
const FRAMES: u64 = 8;
/// KB that as many frames may add: a twentieth of the least that any blend's frame took with such copies, 320 KB.
const MOST: u64 = FRAMES * 16;
/// What grows must grow every time: the allocator's own growth ends.
const ROUNDS: u32 = 4;

/// KB of this process that lie in memory.
fn resident() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").expect("a process's status");
    let line = text.lines().find(|l| l.starts_with("VmRSS:")).expect("what is resident");
    line.split_whitespace().nth(1).and_then(|n| n.parse().ok()).expect("KB")
}

fn steady(off: &mut Offscreen, name: &str, shot: &Shot) -> FrameStats {
    let stats = complete(off, shot);
    let mut grown = Vec::new();
    for _ in 0..ROUNDS {
        let before = resident();
        for _ in 0..FRAMES {
            off.draw(shot).expect("a frame");
        }
        grown.push(resident().saturating_sub(before));
        if grown.last() <= Some(&MOST) {
            return stats;
        }
    }
    panic!("{name}: {FRAMES} frames take {grown:?} KB more, again and again");
}

#[test]
fn frames_keep_no_memory() {
    if std::env::var_os(ALONE).is_none() {
        let mut alone = Command::new(std::env::current_exe().expect("this test"));
        let out = alone.args(["--exact", "steady::frames_keep_no_memory"]).env(ALONE, "1").output().expect("a process");
        let text = String::from_utf8_lossy(&out.stdout);
        assert!(out.status.success() && text.contains("1 passed"), "{text}{}", String::from_utf8_lossy(&out.stderr));
        return;
    }
    let plain = |colors| {
        let mut cloud = colored_torus(4000);
        cloud.colors = cloud.colors.filter(|_| colors);
        Flat::new(&cloud)
    };
    let blocks = sequential::Options { blocks: 300, ..Default::default() };
    let one = sequential::Options { rule: ErrorRule::Split, ..Default::default() };
    let model = Model::new("steady", "torus", 4000);
    let streaming = Streaming { occlusion: true, ..Streaming::STILL };
    let clouds: [(&str, Cloud); 5] = [
        ("without colours", plain(false).into()),
        ("many lists", tree(&plain(true), blocks)),
        ("split", tree(&plain(true), one)),
        ("hybrid", crate::hybrid::hybrid(ErrorRule::Geometric, true)),
        ("streamed", model.streamed(streaming)),
    ];
    let style =
        Style { threshold: 4.0, shading: Shading::PHONG, eye_dome: Some(EyeDome::default()), ..Style::default() };
    let published = Style { interval: Interval::Published, ..style };
    let unlit = Style {
        threshold: 4.0,
        ellipse: Ellipse::Approximate,
        voronoi: Voronoi::Slabs,
        shading: Shading::None,
        ..Style::default()
    };
    let squares = Style { footprint: Footprint::Pixels(3.0), ..unlit };
    let ways = [
        (Blend::TwoPass, Primitive::Point, Selection::Compute, &style),
        (Blend::TwoPass, Primitive::Quad, Selection::Vertex, &style),
        (Blend::Fuzzy, Primitive::Point, Selection::Vertex, &published),
        (Blend::Fuzzy, Primitive::Quad, Selection::Compute, &unlit),
        (Blend::Groups, Primitive::Point, Selection::Compute, &style),
        (Blend::Groups, Primitive::Quad, Selection::Vertex, &unlit),
        (Blend::Opaque, Primitive::Point, Selection::Vertex, &style),
        (Blend::Opaque, Primitive::Quad, Selection::Compute, &squares),
    ];
    let options = Options { layers: Layers::default(), ..vulkan::options() };
    let mut drawn = 0;
    vulkan::draw_with(&options, SIZE, true, |off| {
        for (name, cloud) in clouds {
            let grouped = name == "streamed" || cloud.flat().groups.is_some();
            let id = off.renderer.add(cloud).expect("a cloud");
            let instances = [Instance { cloud: id, transform: DMat4::IDENTITY }];
            for (v, view) in [("whole", perspective()), ("near", near()), ("orthographic", orthographic())] {
                for (blend, primitive, selection, style) in ways.iter().filter(|(b, ..)| grouped || *b != Blend::Groups)
                {
                    let technique = Technique {
                        primitive: *primitive,
                        selection: *selection,
                        blend: *blend,
                        ..Technique::TWO_PASS
                    };
                    // Counting is a pass of its own, with every other way.
                    let count = *selection == Selection::Compute;
                    let shot = Shot { view: &view, instances: &instances, technique, style, count };
                    let name = format!("{name}, {v}, {blend} {primitive} {selection}");
                    drawn += steady(off, &name, &shot).points_drawn.unwrap_or(0);
                }
            }
            off.renderer.remove(id);
        }
    });
    assert!(drawn > 100_000, "{drawn}");
}
