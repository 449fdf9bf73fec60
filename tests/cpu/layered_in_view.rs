//! What a picture fetches of a model: its cut, and coarser patches where some do not come.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use glam::{DMat4, DVec3};
use surfel::Error;
use surfel::select::layered::{Cut, Refine, refine};
use surfel::select::{Sight, View};
use surfel::stream::{Access, Fault, FaultKind, FileAccess, HttpAccess, HttpOptions};
use surfel::structure::layered::{InView, Options, Patience, coarse, in_view, whole};
use surfel::structure::{Flat, Index};
use surfel::style::Style;

use crate::layered::{Model, scene, small};
use crate::server::{Served, Server};

const PATIENCE: Patience = Patience { threads: 3, silence: Duration::from_secs(20) };

fn sight(index: &Index, distance: f64, threshold: f32) -> Sight {
    let target = index.origin + index.nodes[0].centre.as_dvec3();
    let lens = View::perspective(0.8, 1.0, 0.01);
    let eye = target + distance * DVec3::new(0.4, 0.7, 0.6).normalize();
    let view = View::look_at(eye, target, DVec3::Y, lens, Default::default());
    Sight::new(&view, [300, 300], &DMat4::IDENTITY, index.origin, &Style { threshold, ..Style::default() })
}

fn seen(index: &Index, access: Arc<dyn Access>, sight: &Sight) -> Result<InView, Error> {
    in_view(&Arc::new(index.clone()), access, sight, &Refine::default(), PATIENCE)
}

fn bag(flat: &Flat) -> HashMap<[u32; 3], u32> {
    let mut bag = HashMap::new();
    for [x, y, z, _] in &flat.geometry {
        *bag.entry([x, y, z].map(|v| v.to_bits())).or_default() += 1;
    }
    bag
}

fn file(model: &Model) -> Arc<dyn Access> {
    Arc::new(FileAccess::open(model.folder.path("m.lpc")).expect("the model"))
}

#[test]
fn a_picture_reads_its_cut_and_no_more() {
    let model = Model::new("in-view", &scene("torus", 20_000), &small());
    let index = &model.index;
    let all = bag(&whole(index, &model.access).expect("all samples"));
    let mut last = 0;
    for (distance, threshold) in [(40.0, 3.0), (12.0, 3.0), (4.0, 3.0)] {
        let sight = sight(index, distance, threshold);
        let of = seen(index, file(&model), &sight).expect("a picture");
        let mut cut = Cut::default();
        refine(index, &sight, &Refine::default(), |_| 1.0, &mut cut);
        assert_eq!((of.counts, of.flat.len() as u64), (cut.counts, cut.counts.samples));
        assert!(of.fetched.delivered == cut.counts.drawn as u64 && of.fault.is_none());
        let bytes: u64 = cut.drawn().map(|s| index.nodes[s.node as usize].bytes as u64).sum();
        assert!(of.fetched.bytes >= bytes);
        assert!(of.flat.len() > last, "{distance}: {} samples", of.flat.len());
        assert!(distance < 5.0 || of.flat.len() < 10_000, "{distance}: {} samples", of.flat.len());
        last = of.flat.len();
        assert!(bag(&of.flat).iter().all(|(place, n)| all.get(place) >= Some(n)), "samples of the model, none twice");
        // Radii, one by one: the sample's own, and at least that of the deepest node where that has children.
        let mut at = of.flat.geometry.iter();
        for step in cut.drawn() {
            let (number, patch) = (cut.step_of(step.node).expect("a step"), &model.patches[step.node as usize]);
            for (p, own) in patch.positions.iter().zip(&patch.radii) {
                let deepest = cut.deepest(number, *p);
                let leaf = index.nodes[deepest.node as usize].split == 3;
                let expected = if leaf { *own } else { own.max(cut.radius_of(number, *p)) };
                assert_eq!(at.next().map(|g| g[3]), Some(expected));
            }
        }
    }
    // So fine that everything is needed, and everything is in the picture: the model as it is.
    let sight = sight(index, 12.0, 1e-4);
    let of = seen(index, file(&model), &sight).expect("a picture").flat;
    let whole = whole(index, &model.access).expect("all samples");
    let sorted = |flat: &Flat| {
        let mut all: Vec<[u32; 4]> = flat.geometry.iter().map(|g| g.map(f32::to_bits)).collect();
        all.sort_unstable();
        all
    };
    assert!(sorted(&of) == sorted(&whole));
}

#[test]
fn the_overview_is_the_first_patches() {
    let model = Model::new("overview", &scene("sphere", 5000), &small());
    let sizes: Vec<u64> = model.index.nodes.iter().map(|n| n.samples as u64).collect();
    let of = |most: u64| coarse(&model.index, &model.access, most).expect("samples").len() as u64;
    assert_eq!([of(0), of(sizes[0])], [sizes[0]; 2], "the root in any case");
    assert_eq!(of(sizes[0] + sizes[1] + sizes[2] - 1), sizes[0] + sizes[1]);
    assert_eq!(of(u64::MAX), 5000);
}

/// A file with faults at some places.
#[derive(Debug)]
struct Bad {
    file: FileAccess,
    /// Bytes that come altered.
    altered: Vec<u64>,
}

impl Access for Bad {
    fn name(&self) -> &str {
        self.file.name()
    }

    fn size(&self) -> u64 {
        self.file.size()
    }

    fn read(&self, at: u64, to: &mut [u8]) -> Result<(), Fault> {
        self.file.read(at, to)?;
        for place in self.altered.iter().filter_map(|b| b.checked_sub(at)) {
            if let Some(byte) = to.get_mut(place as usize) {
                *byte ^= 1;
            }
        }
        Ok(())
    }
}

#[test]
fn where_a_patch_is_broken_its_parent_stands_for_it() {
    let model = Model::new("broken", &scene("torus", 8000), &small());
    let index = &model.index;
    let sight = sight(index, 12.0, 1e-4);
    let bad = |node: usize| {
        let n = &index.nodes[node];
        let altered = vec![n.at + n.bytes as u64 / 2];
        Arc::new(Bad { file: FileAccess::open(model.folder.path("m.lpc")).expect("the model"), altered })
    };
    let broken = index.nodes.iter().position(|n| n.level == 2).expect("three levels");
    let of = seen(index, bad(broken), &sight).expect("a picture all the same");
    let fault = of.fault.expect("a fault").to_string();
    assert!(fault.contains("checksum") && fault.contains("m.lpc at byte"), "{fault}");
    let lost: u64 = model.below(broken as u32).iter().map(|n| index.nodes[*n as usize].samples as u64).sum();
    assert_eq!((of.counts.missing, of.flat.len() as u64), (1, 8000 - lost), "all that is not below it");
    assert!(of.fetched.corrupt > 0 && of.fetched.given_up == 1, "{:?}", of.fetched);

    let nothing = seen(index, bad(0), &sight).expect_err("no picture without the root");
    assert!(matches!(&nothing, Error::Data { .. }), "{nothing}");
}

/// Answers nothing, ever.
#[derive(Debug)]
struct Silent(u64);

impl Access for Silent {
    fn name(&self) -> &str {
        "silent"
    }

    fn size(&self) -> u64 {
        self.0
    }

    fn read(&self, at: u64, _: &mut [u8]) -> Result<(), Fault> {
        Err(Fault { kind: FaultKind::Unreachable, name: "silent".into(), at, why: "gone".into() })
    }
}

#[test]
fn nothing_is_waited_for_without_end() {
    let model = Model::new("silent", &scene("torus", 2000), &small());
    let sight = sight(&model.index, 12.0, 1.0);
    let patience = Patience { silence: Duration::from_millis(50), ..PATIENCE };
    let index = Arc::new(model.index.clone());
    let error = in_view(&index, Arc::new(Silent(model.access.size())), &sight, &Refine::default(), patience);
    assert!(matches!(error, Err(Error::Stream(_))), "{error:?}");
}

/// The first picture takes the way to the server twice: for the file's beginning, and for the rest of the index with the root.
#[test]
fn index_and_root_are_two_requests() {
    let model = Model::new("layered-requests", &scene("demo", 20_000), &Options { samples: 256, ..Options::default() });
    let bytes = std::fs::read(model.folder.path("m.lpc")).expect("the model");
    let end = model.index.nodes[0].at;
    let served = Served { bytes, etag: "\"one\"" };
    let server = Server::start(move |asked| served.right(asked));
    // As far as the root, so that its patch's size is known, and no farther; the index of a large model does not fit.
    let options = HttpOptions { head: 256, proxy: false, ..HttpOptions::default() };
    let access: Arc<dyn Access> = Arc::new(HttpAccess::open(&server.address("m.lpc"), options).expect("a model"));
    let index = Arc::new(Index::read(&*access).expect("an index"));
    assert!(end > 5000 && index.nodes == model.index.nodes);
    // So coarse that the root is all there is to see.
    let of = seen(&index, access, &sight(&index, 1e3, 1e3)).expect("a picture");
    assert_eq!((of.flat.len(), of.counts.drawn), (256, 1));
    let asked: Vec<_> = server.asked().iter().map(|a| a.range).collect();
    let last = (end + u64::from(index.nodes[0].bytes)) as usize - 1;
    assert_eq!(asked, [Some((0, 255)), Some((256, last))]);
}
