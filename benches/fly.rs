//! Flying through a layered point cloud: what a viewer waits for, and what streaming costs.
//!
//! 1. The first picture, from `open()` on a renderer that has drawn before: from a file, and over HTTP from an nginx that answers late.
//! 2. A lap that streams against one that finds everything there: `prepare`, and the share of the model that is resident.
//! 3. Pictures of the cut at one pixel against those of all samples: PSNR and holes, both against the truth of the reference.
//!
//! `cargo bench --bench fly`; a model can be given: `-- MODEL.lpc`; `-- --test` runs once, small.

#[path = "../tests/common/folder.rs"]
mod folder;
#[path = "../tests/common/nginx.rs"]
mod nginx;

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use glam::{DMat4, DVec3};
use surfel::ash::vk;
use surfel::load::Pieces;
use surfel::measure::{Image, Summary, compare};
use surfel::reference;
use surfel::select::{DepthConvention, DrawList, View};
use surfel::standalone::{FrameTimes, Offscreen, Options, Shot, Standalone};
use surfel::stats::LayeredStats;
use surfel::stream::{Access, FileAccess, HttpAccess, HttpOptions};
use surfel::structure::layered::{Index, Layered, Streaming, build, whole};
use surfel::structure::{Cloud, Flat};
use surfel::style::Style;
use surfel::technique::Technique;
use surfel::{CloudId, Instance};

const SIZE: [u32; 2] = [640, 480];
/// Models of more samples are too large to be drawn as a whole.
const WHOLE: u64 = 8_000_000;

/// A model and where it is looked at from.
struct Place {
    path: PathBuf,
    middle: DVec3,
    ball: f64,
    up: DVec3,
}

impl Place {
    fn new(path: PathBuf) -> Place {
        let index = Index::read(&FileAccess::open(&path).expect("a model")).expect("an index");
        let root = index.nodes[0];
        let up = index.up.map_or(DVec3::Y, |up| up.as_dvec3());
        Place { path, middle: index.origin + root.centre.as_dvec3(), ball: root.ball.into(), up }
    }

    /// From so many balls away, at an angle about the way up.
    fn view(&self, distance: f64, angle: f64) -> View {
        let side = self.up.any_orthonormal_vector();
        let (sin, cos) = angle.sin_cos();
        let direction = (cos * side + sin * self.up.cross(side) + 0.4 * self.up).normalize();
        let lens = View::perspective(0.8, SIZE[0] as f64 / SIZE[1] as f64, 1e-3 * self.ball);
        let eye = self.middle + distance * self.ball * direction;
        View::look_at(eye, self.middle, self.up, lens, DepthConvention::Reversed)
    }
}

fn draw(off: &mut Offscreen, cloud: CloudId, view: &View) -> (LayeredStats, u64, FrameTimes) {
    let instances = [Instance { cloud, transform: DMat4::IDENTITY }];
    let style = Style::default();
    let shot = Shot { view, instances: &instances, technique: Technique::default(), style: &style, count: false };
    let (mut stats, times) = off.draw(&shot).expect("a frame");
    (stats.layered.pop().unwrap_or_default(), stats.points_submitted, times)
}

/// Milliseconds from `open` to the first frame that shows something.
fn first_picture(off: &mut Offscreen, view: &View, open: impl Fn() -> Arc<dyn Access>) -> f64 {
    let start = Instant::now();
    let access = open();
    let index = Arc::new(Index::read(&*access).expect("an index"));
    let cloud = off.renderer.add(Layered::new(index, access, Streaming::default())).expect("a model");
    while draw(off, cloud, view).1 == 0 {}
    let time = start.elapsed();
    off.renderer.remove(cloud);
    1e3 * time.as_secs_f64()
}

fn said(values: &[f64]) -> String {
    let s = Summary::of(values).expect("rounds");
    format!("{:>7.1} ({:.1} to {:.1})", s.median, s.lower, s.upper)
}

fn first_pictures(off: &mut Offscreen, place: &Place, rounds: usize) {
    let view = place.view(2.5, 0.3);
    let file = || Arc::new(FileAccess::open(&place.path).expect("a model")) as Arc<dyn Access>;
    // Pipelines and attachments.
    first_picture(off, &view, file);
    println!("first picture, from open() [ms]");
    let times: Vec<f64> = (0..rounds).map(|_| first_picture(off, &view, file)).collect();
    println!("  from a file                             {}", said(&times));
    let folder = folder::Folder::new("bench-fly-served");
    std::fs::copy(&place.path, folder.path("model")).expect("room for a copy");
    let nginx = nginx::Nginx::start(&folder.0);
    for late in [0, 20, 80].map(Duration::from_millis) {
        let address = relayed(&nginx.address("model"), late);
        let options = HttpOptions { proxy: false, ..HttpOptions::default() };
        let http = || Arc::new(HttpAccess::open(&address, options.clone()).expect("a model")) as Arc<dyn Access>;
        let times: Vec<f64> = (0..rounds).map(|_| first_picture(off, &view, http)).collect();
        println!("  over HTTP, each answer {:>2} ms late       {}", late.as_millis(), said(&times));
    }
    println!("  nginx counts {} requests for {} of them", nginx.log().len(), 3 * rounds);
}

/// The same address through a relay that holds every request back for so long, as a server far away would. It listens until the
/// bench ends.
fn relayed(address: &str, late: Duration) -> String {
    let (host, file) = address.strip_prefix("http://").and_then(|rest| rest.split_once('/')).expect("an address");
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let relay = format!("http://{}/{file}", listener.local_addr().expect("its number"));
    let host = host.to_owned();
    thread::spawn(move || {
        for client in listener.incoming().flatten() {
            let server = TcpStream::connect(&host).expect("the server");
            let [mut from, mut to] = [&client, &server].map(|stream| {
                stream.set_nodelay(true).expect("an option");
                stream.try_clone().expect("a handle")
            });
            thread::spawn(move || {
                let mut request = vec![0; 1 << 14];
                while let Ok(n @ 1..) = from.read(&mut request) {
                    thread::sleep(late);
                    if to.write_all(&request[..n]).is_err() {
                        break;
                    }
                }
                // Nobody listens any more, or nobody asks.
                let _ = to.shutdown(Shutdown::Both);
            });
            let (mut from, mut to) = (server, client);
            thread::spawn(move || std::io::copy(&mut from, &mut to));
        }
    });
    relay
}

/// A lap that streams and one that does not, again and again with an empty cache.
fn laps(off: &mut Offscreen, place: &Place, frames: usize, rounds: usize) {
    let (mut ratios, mut completes, mut shares) = (Vec::new(), Vec::new(), Vec::new());
    let mut resident = 0.0f64;
    for _ in 0..rounds {
        let access = FileAccess::open(&place.path).expect("a model");
        let index = Arc::new(Index::read(&access).expect("an index"));
        let nodes = index.nodes.len();
        let cloud = off.renderer.add(Layered::new(index, Arc::new(access), Streaming::default())).expect("a model");
        let lap = |off: &mut Offscreen| -> Vec<(LayeredStats, FrameTimes)> {
            let frame = |i: usize| {
                let angle = i as f64 / frames as f64 * std::f64::consts::TAU;
                let (layered, _, times) = draw(off, cloud, &place.view(1.0 + 0.8 * angle.cos(), angle));
                (layered, times)
            };
            (0..frames).map(frame).collect()
        };
        let [first, second] = [lap(off), lap(off)];
        let cpu = |times: &FrameTimes| times.prepare_cpu.unwrap_or(times.prepare);
        // Frame by frame, so that both have drawn the same view.
        let pairs: Vec<f64> = first.iter().zip(&second).map(|(a, b)| cpu(&a.1) / cpu(&b.1)).collect();
        ratios.push(Summary::of(&pairs).expect("frames").median);
        completes.push(100.0 * first.iter().filter(|f| f.0.cut.missing == 0).count() as f64 / frames as f64);
        let there: u32 = first.iter().map(|f| f.0.cut.visited - f.0.cut.missing).sum();
        shares.push(100.0 * f64::from(there) / f64::from(first.iter().map(|f| f.0.cut.visited).sum::<u32>()));
        let most = first.iter().chain(&second).map(|f| f.0.resident).max().unwrap_or(0);
        resident = resident.max(100.0 * f64::from(most) / nodes as f64);
        off.renderer.remove(cloud);
    }
    println!("{frames} frames twice, {rounds} rounds");
    println!("  prepare while streaming / resident      {}, of the processor's time", said(&ratios));
    println!("  frames of the first lap without a gap   {} %", said(&completes));
    println!("  patches there of visited                {} %", said(&shares));
    println!("  resident at most                        {resident:>7.1} % of the patches");
}

/// Both pictures against the truth.
fn pictures(off: &mut Offscreen, place: &Place, samples: u32) {
    let access = FileAccess::open(&place.path).expect("a model");
    let index = Index::read(&access).expect("an index");
    if index.samples() > WHOLE {
        println!("pictures: {} samples are too many to be drawn as a whole", index.samples());
        return;
    }
    let flat = Arc::new(whole(&index, &access).expect("all samples"));
    let layered = Layered::new(Arc::new(index), Arc::new(access), Streaming::STILL);
    let cut = off.renderer.add(layered).expect("a model");
    let all = off.renderer.add(Cloud::from(Arc::clone(&flat))).expect("all samples");
    println!(
        "pictures at 1 px against the truth ({samples} x {samples} samples a pixel)   PSNR [dB] and holes of all samples, of the cut"
    );
    for (name, distance) in [("from afar", 6.0), ("nearer", 2.5), ("near", 1.2)] {
        let view = place.view(distance, 0.3);
        let truth = truth(&flat, &view, samples);
        let judged = |off: &mut Offscreen, cloud| {
            while draw(off, cloud, &view).0.cut.missing > 0 {}
            let picture = off.read().expect("a picture");
            let rgba: Vec<[f64; 4]> = picture.rgba.iter().map(|p| p.map(f64::from)).collect();
            let difference = compare(&truth, &image(&rgba), 0.0).expect("pictures of one size");
            (difference.psnr, difference.silhouette.map_or(0, |s| s.holes_inside))
        };
        let [a, b] = [judged(off, all), judged(off, cut)];
        println!("  {name:<12} {:>7.2}, {:>5}   {:>7.2}, {:>5}   {:+.2} dB", a.0, a.1, b.0, b.1, b.0 - a.0);
    }
    off.renderer.remove(cut);
    off.renderer.remove(all);
}

fn image(rgba: &[[f64; 4]]) -> Image {
    Image::from_linear(SIZE[0], SIZE[1], rgba, [29, 31, 35])
}

/// All samples in f64.
fn truth(flat: &Flat, view: &View, samples: u32) -> Image {
    let list = DrawList::all([flat.len() as u32]);
    let scene = reference::Scene {
        instances: &[reference::Instance::points(flat, DMat4::IDENTITY)],
        list: &list,
        view,
        width: SIZE[0],
        height: SIZE[1],
        technique: Technique::TWO_PASS,
        style: &Style::default(),
        host_depth: None,
    };
    image(&reference::supersampled(&scene, samples).rgba)
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let small = arguments.iter().any(|a| a == "--test");
    let folder = folder::Folder::new("bench-fly");
    let place = match arguments.iter().find(|a| a.ends_with(".lpc")) {
        Some(path) => Place::new(path.into()),
        None => {
            let path = PathBuf::from(folder.path("torus.lpc"));
            let pieces = Pieces::scene("torus", if small { 30_000 } else { 4_000_000 }, 1).expect("a scene");
            build(vec![pieces], &path, &Default::default()).expect("a model");
            Place::new(path)
        }
    };
    let standalone = Standalone::new(&Options::default()).expect("a Vulkan device");
    println!("{}, {} x {}, {}", standalone.info.name, SIZE[0], SIZE[1], place.path.display());
    let mut off = Offscreen::new(standalone, vk::Extent2D { width: SIZE[0], height: SIZE[1] }, true).expect("a target");
    let (frames, rounds, samples) = if small { (4, 1, 1) } else { (60, 5, 8) };
    first_pictures(&mut off, &place, rounds);
    laps(&mut off, &place, frames, rounds);
    pictures(&mut off, &place, samples);
    let messages = off.destroy().close();
    assert!(messages.is_empty(), "{messages:?}");
}
