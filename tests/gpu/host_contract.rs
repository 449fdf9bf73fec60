//! `docs/EMBEDDING.md` says which commands each entry point records, and that no barrier names an image of the host. The
//! engine's device table writes down what is really called.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DMat4;
use surfel::ash::vk;
use surfel::load::{Pieces, synthetic};
use surfel::select::DepthConvention;
use surfel::stream::FileAccess;
use surfel::structure::groups::{Groups, Relax};
use surfel::structure::layered::{Layered, Options, Streaming, build};
use surfel::structure::{Cloud, Sequential, sequential};
use surfel::style::Style;
use surfel::technique::{Blend, PRESETS, Selection, Technique};
use surfel::{FrameInput, HostDepth, Instance, Renderer};

use crate::folder::Folder;
use crate::host_engine::Engine;
use crate::host_scene::{Lens, camera, sphere};
use crate::host_table;
use crate::host_target::{Depth, Kind, PLAIN, Target};

/// The row of an entry point in the page's table of commands.
fn documented(entry: &str) -> BTreeSet<&'static str> {
    let page = include_str!("../../docs/EMBEDDING.md");
    let start = format!("| {entry} | `vkCmd");
    let row = page.lines().find(|l| l.starts_with(&start)).unwrap_or_else(|| panic!("no row for {entry}"));
    row.split('`').filter(|word| word.starts_with("vkCmd")).collect()
}

#[test]
fn the_page_lists_every_command() {
    Engine::with(|engine| {
        let kind = Kind { depth: Depth::Lent, size: [16, 12], extent: [16, 12], ..PLAIN };
        let target = Target::new(engine, kind);
        let device = host_table::wrapped_device(engine);
        let host = engine.host_with(device, Box::new(engine.memory()));
        // SAFETY: the handles belong together and outlive the renderer.
        let mut renderer = unsafe { Renderer::new(host, target.formats()) }.expect("a renderer");
        let mut tree = Sequential::build(&sphere(50), &sequential::Options::default());
        tree.flat.groups = Some(Groups::color(&tree.flat, &Relax::default()).expect("groups"));
        let clouds = [Cloud::from(sphere(50)), Arc::new(tree).into()].map(|c| renderer.add(c).expect("a cloud"));
        let folder = Folder::new("contract");
        let path = PathBuf::from(folder.path("m.lpc"));
        let of = || vec![Pieces::of(synthetic::scene("sphere", 400, 1).expect("a sphere"))];
        let index = build(of(), &path, &Options { samples: 64, ..Options::default() }).expect("a model").index;
        let access = FileAccess::open(&path).expect("the model");
        let cmd = engine.command_buffer();
        let mut recorded = [BTreeSet::new(), BTreeSet::new(), BTreeSet::new()];
        let depth = target.depth.as_ref().expect("a depth");
        let theirs: Vec<_> = [&target.color, depth].map(|t| t.image).into();
        let model = Layered::new(Arc::new(index), Arc::new(access), Streaming::STILL);
        let model = renderer.add(model).expect("a model");
        // A layered point cloud has no groups; its patches come when they come.
        let all =
            PRESETS.iter().flat_map(|(_, t)| [(*t, false), (*t, true)]).filter(|(t, m)| !m || t.blend != Blend::Groups);
        for (technique, streamed) in all {
            let start = Instant::now();
            loop {
                let id = engine.completed() + 1;
                let (view, style) = (camera(0, Lens::Straight, DepthConvention::Reversed, 4.0 / 3.0), Style::default());
                let drawn = if streamed { &[model, clouds[0]] } else { &clouds };
                let input = FrameInput {
                    id,
                    extent: vk::Extent2D { width: 16, height: 12 },
                    offset: vk::Offset2D::default(),
                    views: &[view],
                    instances: &drawn.map(|cloud| Instance { cloud, transform: DMat4::IDENTITY }),
                    technique: Technique { selection: Selection::Compute, ..technique },
                    style: &style,
                    host_depth: Some(HostDepth { view: depth.view, layout: vk::ImageLayout::DEPTH_READ_ONLY_OPTIMAL }),
                    count: true,
                    keep_lists: false,
                };
                engine.begin(cmd);
                host_table::take_commands();
                let mut take = |i: usize| {
                    let (commands, images) = host_table::take_commands();
                    assert!(!commands.is_empty());
                    recorded[i].extend(commands);
                    assert!(images.iter().all(|i| !theirs.contains(i)), "a barrier names an image of the engine");
                };
                // SAFETY: recording; ids grow; `opaque` leaves the depth as the input says.
                unsafe {
                    target.opaque(engine, cmd, &view);
                    renderer.prepare(cmd, &input).expect("prepare");
                    take(0);
                    renderer.render(cmd).expect("render");
                    take(1);
                    target.begin_composite(engine, cmd);
                    renderer.composite(cmd).expect("composite");
                    take(2);
                    target.end_composite(engine, cmd);
                }
                engine.submit(cmd, id);
                engine.wait(id);
                let stats = renderer.retire(id).expect("statistics").pop().expect("of this frame");
                if stats.layered.iter().all(|l| l.cut.missing == 0) {
                    break;
                }
                assert!(start.elapsed() < Duration::from_secs(60), "patches do not come: {stats:?}");
            }
        }
        // The flags without which another device than lavapipe would blend in any order.
        let ordered = host_table::ordered();
        assert!(!ordered.passes.is_empty() && !ordered.pipelines.is_empty(), "{ordered:?}");
        let attachment = vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT;
        let itself = (
            attachment,
            vk::AccessFlags::COLOR_ATTACHMENT_WRITE,
            vk::PipelineStageFlags::FRAGMENT_SHADER,
            vk::AccessFlags::INPUT_ATTACHMENT_READ,
            vk::DependencyFlags::BY_REGION,
        );
        let subpass = vk::SubpassDescriptionFlags::RASTERIZATION_ORDER_ATTACHMENT_COLOR_ACCESS_EXT;
        assert!(ordered.passes.iter().all(|pass| *pass == (subpass, vec![itself])), "{:?}", ordered.passes);
        let blending = vk::PipelineColorBlendStateCreateFlags::RASTERIZATION_ORDER_ATTACHMENT_ACCESS_EXT;
        assert!(ordered.pipelines.iter().all(|flags| *flags == blending), "{:?}", ordered.pipelines);
        for (entry, commands) in ["prepare", "render", "composite"].into_iter().zip(&recorded) {
            assert_eq!(*commands, documented(entry), "{entry}: recorded, and in docs/EMBEDDING.md");
        }
        // SAFETY: all frames are complete.
        unsafe { renderer.destroy() };
        target.destroy(engine);
    });
}
