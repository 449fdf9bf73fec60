//! The builder of layered point clouds: the same bytes whatever runs it, any input, and nothing left behind.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use glam::Vec3;
use surfel::Error;
use surfel::load::{Options as Reading, Pieces, PointCloud};
use surfel::structure::groups::Relax;
use surfel::structure::layered::{Normals, Options, build};

use crate::common::data;
use crate::folder::Folder;
use crate::layered::{Model, numbered, scene, small};

fn bytes(folder: &Folder, cloud: &PointCloud, options: &Options) -> Vec<u8> {
    let path = PathBuf::from(folder.path("m.lpc"));
    build(vec![Pieces::of(cloud.clone())], &path, options).expect("a model");
    fs::read(path).expect("the model")
}

#[test]
fn threads_and_memory_change_no_byte_and_seeds_do() {
    let folder = Folder::new("layered-same");
    let cloud = scene("demo", 60_000);
    let whole = bytes(&folder, &cloud, &small());
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        assert!(pool.install(|| bytes(&folder, &cloud, &small())) == whole, "{threads} threads");
    }
    // 16 MiB are for buffers: parts of 13,000 points are built in memory, larger ones from files.
    let little = Options { memory: 17 << 20, ..small() };
    assert!(bytes(&folder, &cloud, &little) == whole, "out of core");
    assert!(bytes(&folder, &cloud, &Options { seed: 2, ..small() }) != whole, "another seed");
    let groups = Some(Relax::default());
    let with = bytes(&folder, &cloud, &Options { groups, ..small() });
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    assert!(pool.install(|| bytes(&folder, &cloud, &Options { groups, ..little })) == with && with.len() > whole.len());
}

#[test]
fn estimated_normals_hardly_depend_on_memory() {
    let folder = Folder::new("layered-normals");
    let cloud = PointCloud { normals: None, radii: None, up: Some(Vec3::Z), ..scene("terrain", 30_000) };
    let options = Options { exact: true, ..small() };
    let read = |memory| {
        let path = PathBuf::from(folder.path("m.lpc"));
        build(vec![Pieces::of(cloud.clone())], &path, &Options { memory, ..options }).expect("a model");
        let access = surfel::stream::FileAccess::open(&path).expect("it");
        let index = surfel::structure::Index::read(&access).expect("index");
        let flat = surfel::structure::layered::whole(&index, &access).expect("all");
        let mut by: Vec<(u32, u32, f32)> = (0..flat.len())
            .map(|i| (flat.colors.as_ref().unwrap()[i], flat.normals.as_ref().unwrap()[i], flat.geometry[i][3]))
            .collect();
        by.sort_by_key(|x| x.0);
        by
    };
    let (whole, cells) = (read(1 << 30), read(18 << 20));
    let mut differ = 0;
    for (a, b) in whole.iter().zip(&cells) {
        differ += usize::from(a != b);
        let [a, b] = [a.1, b.1].map(|n| surfel::structure::octahedral::decode(n).expect("a plane"));
        assert!(a.dot(b) > 0.0 && a.z > 0.0, "terrain looks up in every cell");
    }
    // Margins of 32 spacings: the guard against strays alone looks farther.
    assert!(differ < 30, "{differ} of 30000");
    let mut kept = cloud.clone();
    surfel::load::attributes::complete(&mut kept, &Default::default());
    let radii = kept.radii.expect("radii");
    assert!(whole.iter().all(|(c, _, r)| radii[(c & 0xff_ffff) as usize] == *r), "as in memory");
}

#[test]
fn without_normals_radii_are_the_spacing() {
    let cloud = PointCloud { normals: None, radii: None, ..scene("sphere", 20_000) };
    let model = Model::new("layered-bare", &cloud, &Options { normals: Normals::Input, ..small() });
    assert!(!model.index.normals && model.index.nodes.iter().all(|n| n.cone == -1.0));
    // 4π / n is the area of a point.
    let even = (4.0 * std::f32::consts::PI / 20_000.0).sqrt();
    let all: Vec<f32> = model.patches.iter().flat_map(|p| &p.radii).map(|r| r / even).collect();
    let within = all.iter().filter(|r| (0.8..2.0).contains(*r)).count();
    assert!(within > 19_000, "{within}");
}

#[test]
fn odd_clouds_are_built() {
    let line = |n: usize, f: &dyn Fn(f32) -> Vec3| PointCloud {
        positions: (0..n).map(|i| f(i as f32 / n as f32)).collect(),
        ..PointCloud::default()
    };
    let ball = |scale: f32| {
        let mut cloud = scene("sphere", 5_000);
        cloud.positions.iter_mut().for_each(|p| *p *= scale);
        cloud.radii = None;
        cloud
    };
    let clouds: [(&str, PointCloud); 9] = [
        ("one point", line(1, &|_| Vec3::ONE)),
        ("two", line(2, &|t| Vec3::X * t)),
        ("copies", line(100_000, &|_| Vec3::splat(7.0))),
        ("copies and one far", line(20_000, &|t| if t > 0.0 { Vec3::ONE } else { Vec3::splat(1e6) })),
        ("a line", line(5_000, &|t| Vec3::new(t, 2.0 * t, -t))),
        ("a plane", line(5_000, &|t| Vec3::new(t, (t * 71.0).fract(), 0.0))),
        ("tiny", ball(1e-6)),
        ("huge", ball(1e7)),
        ("towards zero", line(5_000, &|t| Vec3::X * (2.0f32).powf(-120.0 * t))),
    ];
    for (name, cloud) in clouds {
        for normals in [Normals::Auto, Normals::Input] {
            let options = Options { normals, samples: 256, ..Options::default() };
            let model = Model::new("layered-odd", &numbered(cloud.clone()), &options);
            let mut numbers: Vec<u32> =
                model.patches.iter().flat_map(|p| p.colors.iter().flatten()).map(|c| c & 0xff_ffff).collect();
            numbers.sort_unstable();
            assert!(numbers.iter().copied().eq(0..cloud.len() as u32), "{name}: every point once");
        }
    }
}

fn parts(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").file_name());
    let mut names: Vec<String> = entries.map(|n| n.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn a_failed_build_leaves_the_old_model_and_nothing_else() {
    let folder = Folder::new("layered-failed");
    let path = PathBuf::from(folder.path("m.lpc"));
    fs::write(&path, "old").expect("a file");
    // What a killed process has left is removed, what a living one has is not, nor what no process can have.
    fs::write(folder.path("m.lpc.99999999999.part"), "").expect("a file");
    fs::write(folder.path("m.lpc.4194303.part"), "").expect("a file");
    fs::write(folder.path("m.lpc.4194303-7.part"), "").expect("a file");
    fs::write(folder.path("m.lpc.1.part"), "").expect("a file");
    let mut ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
        property float z\nend_header\n"
        .to_vec();
    ply.extend([0xff; 24]);
    let input = folder.path("a.ply");
    fs::write(&input, ply).expect("a file");
    let pieces = Pieces::open(Path::new(&input), &Reading::default()).expect("a header");
    let error = build(vec![pieces], &path, &Options { name: "a.ply", ..small() }).expect_err("no numbers");
    assert_eq!(error.to_string(), "a.ply: there is no point in the input");
    assert_eq!(fs::read(&path).expect("the old one"), b"old");
    assert_eq!(parts(&folder.0), ["a.ply", "m.lpc", "m.lpc.1.part", "m.lpc.99999999999.part"]);
    bytes(&folder, &scene("sphere", 2_000), &small());
    assert_eq!(parts(&folder.0), ["a.ply", "m.lpc", "m.lpc.1.part", "m.lpc.99999999999.part"]);
}

#[test]
fn what_cannot_be_written_is_named() {
    let folder = Folder::new("layered-nowhere");
    let nowhere = PathBuf::from(folder.path("none/m.lpc"));
    let error = build(vec![Pieces::of(scene("sphere", 100))], &nowhere, &small()).expect_err("no folder");
    assert!(matches!(&error, Error::Io { file, .. } if *file == nowhere), "{error}");
    // A file where a folder should be: no right to write helps, not even root's.
    fs::write(folder.path("file"), "").expect("a file");
    let beneath = PathBuf::from(folder.path("file/m.lpc"));
    let error = build(vec![Pieces::of(scene("sphere", 100))], &beneath, &small()).expect_err("no folder");
    let kind = |e: &Error| matches!(e, Error::Io { file, source } if *file == beneath && source.kind() == ErrorKind::NotADirectory);
    assert!(kind(&error), "{error}");
    fs::remove_file(folder.path("file")).expect("it");
    // A folder of that name: the last step fails, and takes its file along.
    let taken = PathBuf::from(folder.path("taken.lpc"));
    fs::create_dir(&taken).expect("a folder");
    let error = build(vec![Pieces::of(scene("sphere", 100))], &taken, &small()).expect_err("a folder");
    assert!(matches!(&error, Error::Io { file, .. } if *file == taken), "{error}");
    assert_eq!(parts(&folder.0), ["taken.lpc"]);
}

/// The binary builds a scene in a folder of its own, with settings of the shell before it.
#[cfg(unix)]
fn built_by_binary(settings: &str, args: &[&str]) -> std::process::Output {
    let binary = env!("CARGO_BIN_EXE_surfel");
    let line = format!("{settings}; exec \"$0\" build \"$@\"");
    let mut shell = std::process::Command::new("sh");
    // So that memory, which each thread takes some of, is the same everywhere.
    shell.env("RAYON_NUM_THREADS", "4").arg("-c").arg(line).arg(binary).args(args);
    shell.output().expect("a shell")
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_named_and_leaves_the_old_model() {
    let folder = Folder::new("layered-full");
    let path = folder.path("m.lpc");
    fs::write(&path, "old").expect("a file");
    // The system refuses what would make a file larger than so many blocks of 512 bytes, as a full disk would: at once, and
    // in the middle of 100,000 points of 24 bytes.
    for blocks in [0, 2000] {
        let settings = format!("trap '' XFSZ; ulimit -f {blocks}");
        let output = built_by_binary(&settings, &["scene:deep:100k", "-o", &path, "-q"]);
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(1), 0), "{told}");
        assert_eq!(told, format!("surfel: {path}: File too large (os error 27)\n"));
        assert_eq!(fs::read(&path).expect("the old one"), b"old");
        assert_eq!(parts(&folder.0), ["m.lpc"], "{blocks} blocks");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn memory_is_what_was_given() {
    let folder = Folder::new("layered-memory");
    // 3 M points of 24 bytes are more than 64 MiB, and so are all ways of holding them.
    let output = built_by_binary(":", &["scene:deep:3M", "-o", &folder.path("m.lpc"), "--memory", "64M"]);
    let told = String::from_utf8_lossy(&output.stdout);
    let peak =
        told.lines().find_map(|l| l.trim().strip_prefix("peak memory")?.trim().strip_suffix(" MiB")?.parse().ok());
    let peak: f64 = peak.unwrap_or_else(|| panic!("{told}"));
    assert!(told.contains("samples      3 000 000\n") && peak < 1.1 * 64.0, "{told}");
}

#[test]
fn with_data_integers_of_las_are_kept_to_the_bit() {
    let file = data("lone_star_utm.copc.laz");
    let folder = Folder::new("layered-las");
    let path = PathBuf::from(folder.path("m.lpc"));
    let pieces = Pieces::open(&file, &Reading::default()).expect("a scan");
    let (origin, lattice) = (pieces.origin(), pieces.lattice().expect("integers"));
    let options = Options { exact: true, normals: Normals::Input, ..small() };
    let built = build(vec![pieces], &path, &options).expect("a model");
    let cloud = surfel::load::open(&file, &Reading::default()).expect("a scan");
    assert_eq!(built.index.lattice, Some(lattice));
    let access = surfel::stream::FileAccess::open(&path).expect("it");
    let flat = surfel::structure::layered::whole(&built.index, &access).expect("all");
    let number = |p: glam::DVec3| (p / lattice).round().as_i64vec3().to_array();
    let mut kept: Vec<[i64; 3]> = (0..flat.len() as u32).map(|i| number(flat.position(i).as_dvec3())).collect();
    let mut read: Vec<[i64; 3]> = (0..cloud.len()).map(|i| number(cloud.world(i) - origin)).collect();
    kept.sort_unstable();
    read.sort_unstable();
    assert!(kept == read, "the same integers");
    // Every patch found them: exact coordinates of floats would take twice the bits.
    let bits = 8.0 * access_bytes(&built.index) / flat.len() as f64;
    assert!(bits < 130.0, "{bits}");
}

fn access_bytes(index: &surfel::structure::Index) -> f64 {
    index.nodes.iter().map(|n| n.bytes as f64).sum()
}

#[test]
fn radii_that_nobody_gives_are_a_flat_cloud_s() {
    // Two squares of random points, a tenth of each thin, so far apart that the first cut goes between them: a leaf's points and the
    // root's samples among them are one square, whole.
    let noise = surfel::load::synthetic::scene("noise", 6000, 5).expect("noise").positions;
    let place = |(i, p): (usize, &Vec3)| Vec3::new(if i % 10 == 0 { p.x - 2.0 } else { 0.3 * p.x }, p.y, 0.0);
    let square: Vec<Vec3> = noise.iter().take(3000).enumerate().map(place).collect();
    let other = noise.iter().skip(3000).enumerate().map(place).map(|p| p + 100.0 * Vec3::X);
    let cloud = |positions: Vec<Vec3>| PointCloud {
        normals: Some(vec![Vec3::Z; positions.len()]),
        positions,
        ..PointCloud::default()
    };
    let other: Vec<Vec3> = other.collect();
    let both = cloud(square.iter().chain(&other).copied().collect());
    let model = Model::new("layered-local", &numbered(both), &Options { exact: true, ..Options::default() });
    assert_eq!(model.index.nodes.iter().map(|n| n.level).collect::<Vec<_>>(), [0, 1, 1], "a root and a leaf each");
    let mut wanted = Vec::new();
    for part in [square, other] {
        let mut part = cloud(part);
        surfel::load::attributes::complete(&mut part, &Default::default());
        wanted.extend(part.radii.expect("radii"));
    }
    for (node, patch) in model.patches.iter().enumerate() {
        for (color, radius) in patch.colors.iter().flatten().zip(&patch.radii) {
            let i = (color & 0xff_ffff) as usize;
            assert_eq!(*radius, wanted[i], "node {node}, point {i}");
        }
    }
}
