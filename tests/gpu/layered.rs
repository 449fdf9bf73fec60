//! Layered point clouds in frames: what is streamed is drawn as the reference draws the samples of the same cut, in every view, by
//! every blend; and what is not there is stood in for.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{DMat4, DQuat, DVec3, dvec3};
use surfel::load::{Pieces, PointCloud, synthetic};
use surfel::select::layered::Refine;
use surfel::select::{DepthConvention, Sight, View};
use surfel::standalone::{Offscreen, Shot};
use surfel::stream::{Access, FileAccess};
use surfel::structure::layered::{Layered, Options, Patience, Streaming, build, in_view};
use surfel::structure::{Cloud, Index};
use surfel::style::Style;
use surfel::technique::{Blend, Primitive, Technique};
use surfel::{FrameStats, Instance};

use crate::against_reference::{Case, FEW, SIZE, UNWEIGHTED, WEIGHTED, check};
use crate::folder::Folder;
use crate::vulkan;

/// Longer than any machine takes to read a file of a few hundred KiB: without it a fault here would have no end.
const PATIENCE: Duration = Duration::from_secs(60);

struct Model {
    _folder: Folder,
    index: Arc<Index>,
    access: Arc<dyn Access>,
}

impl Model {
    /// A torus in colours of its own, or another scene in such, in patches of 256.
    fn new(test: &str, scene: &str, points: usize) -> Model {
        let mut cloud = synthetic::scene(scene, points, 1).expect("a scene");
        let normals = cloud.normals.as_ref().expect("normals");
        cloud.colors = Some(normals.iter().map(|n| n.to_array().map(|v| (127.5 + 127.0 * v) as u8)).collect());
        cloud.closed = false;
        Model::of(test, cloud)
    }

    fn of(test: &str, cloud: PointCloud) -> Model {
        let folder = Folder::new(&format!("gpu-layered-{test}"));
        let path = PathBuf::from(folder.path("m.lpc"));
        let options = Options { samples: 256, ..Options::default() };
        let built = build(vec![Pieces::of(cloud)], &path, &options).expect("a model");
        let access = FileAccess::open(&path).expect("the model");
        Model { _folder: folder, index: Arc::new(built.index), access: Arc::new(access) }
    }

    fn streamed(&self, streaming: Streaming) -> Cloud {
        Layered::new(Arc::clone(&self.index), Arc::clone(&self.access), streaming).into()
    }

    /// The samples of a view's cut, as a flat cloud.
    fn in_view(&self, view: &View, transform: &DMat4, style: &Style, refine: &Refine) -> Cloud {
        let sight = Sight::new(view, SIZE, transform, self.index.origin, style);
        let of = in_view(&self.index, Arc::clone(&self.access), &sight, refine, Patience::default());
        Arc::new(of.expect("a picture").flat).into()
    }
}

/// Draws until nothing is missing.
fn complete(off: &mut Offscreen, shot: &Shot) -> FrameStats {
    let start = Instant::now();
    loop {
        let (stats, _) = off.draw(shot).expect("a frame");
        if stats.layered.iter().all(|l| l.cut.missing == 0) {
            return stats;
        }
        assert!(start.elapsed() < PATIENCE, "patches do not come: {:?}", stats.layered);
    }
}

fn look(eye: DVec3, target: DVec3, lens: DMat4) -> View {
    View::look_at(eye, target, DVec3::Y, lens, DepthConvention::Reversed)
}

fn views() -> Vec<(&'static str, View, f32)> {
    let aspect = SIZE[0] as f64 / SIZE[1] as f64;
    let lens = View::perspective(0.9, aspect, 0.01);
    let place = dvec3(0.8, 2.0, 1.9);
    let flipped = DMat4::from_scale(dvec3(1.0, -1.0, 1.0)) * lens;
    vec![
        ("far", look(2.0 * place, DVec3::ZERO, lens), 4.0),
        ("coarse", look(place, DVec3::ZERO, lens), 12.0),
        ("fine", look(place, DVec3::ZERO, lens), 2.0),
        ("near", look(dvec3(0.9, 0.5, 0.4), dvec3(0.7, 0.0, 0.2), lens), 3.0),
        ("within", look(dvec3(1.0, 0.0, 0.1), dvec3(0.6, 0.8, 0.0), lens), 3.0),
        ("orthographic", look(place, DVec3::ZERO, View::orthographic(2.6, aspect, 0.1, 9.0)), 4.0),
        ("flipped", look(place, DVec3::ZERO, flipped), 4.0),
    ]
}

#[test]
fn what_is_streamed_is_drawn_as_its_cut_by_every_blend() {
    let model = Model::new("blends", "torus", 20_000);
    vulkan::draw(SIZE, true, |off| {
        let (mut coarsest, mut finest) = (u64::MAX, 0);
        for (name, view, threshold) in views() {
            // From nothing, as the reference: patches that are there and out of sight still tell the radii of samples out of sight, of
            // which the account of what is outside would speak.
            let id = off.renderer.add(model.streamed(Streaming::STILL)).expect("a model");
            for (blend, primitive) in [
                (Blend::TwoPass, Primitive::Point),
                (Blend::TwoPass, Primitive::Quad),
                (Blend::Fuzzy, Primitive::Point),
                (Blend::Opaque, Primitive::Point),
            ] {
                let style = Style { threshold, ..Style::default() };
                let technique = Technique { primitive, blend, ..Technique::TWO_PASS };
                let transform = DMat4::from_rotation_translation(DQuat::from_rotation_y(0.4), dvec3(0.1, 0.0, 0.0));
                let instance = Instance { cloud: id, transform };
                let shot = Shot { view: &view, instances: &[instance], technique, style: &style, count: true };
                let stats = complete(off, &shot);
                let flat = model.in_view(&view, &transform, &style, &Refine::default());
                assert_eq!(stats.points_submitted, flat.points() as u64, "{name}: the samples of the cut");
                (coarsest, finest) = (coarsest.min(stats.points_submitted), finest.max(stats.points_submitted));
                check(
                    off,
                    &Case {
                        name: format!("layered, {name}, {blend}, {primitive}"),
                        size: SIZE,
                        instances: &[(flat, instance)],
                        view: &view,
                        technique,
                        style: &style,
                        bound: if blend == Blend::Opaque { UNWEIGHTED } else { WEIGHTED },
                        ties: FEW,
                    },
                );
            }
            off.renderer.remove(id);
        }
        assert!(coarsest < 3000 && finest > 12_000, "{coarsest} to {finest} samples: views that differ");
    });
}
