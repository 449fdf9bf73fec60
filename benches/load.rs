//! Reading files that lie in the page cache. Timed: everything from the path to the finished cloud. Not timed: the
//! check of the answer before, and the file's first way from the disk.
//!
//! `SURFEL_BENCH_POINTS` sets the size of the files made here (default 2 000 000); the naive line is `std::fs::read`
//! alone, which no reader of the whole file can beat.

use std::hint::black_box;
use std::io::Write;
use std::path::{Path, PathBuf};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use surfel::load::{self, Bounds, Options, PointCloud, synthetic};

/// 27 bytes a vertex: position, normal, colour.
fn write_ply(path: &Path, cloud: &PointCloud, text: bool) -> std::io::Result<()> {
    let mut out = std::io::BufWriter::new(std::fs::File::create(path)?);
    let format = if text { "ascii" } else { "binary_little_endian" };
    write!(out, "ply\nformat {format} 1.0\nelement vertex {}\n", cloud.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(out, "property float {name}")?;
    }
    write!(out, "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n")?;
    let (normals, colors) = (cloud.normals.as_deref().unwrap_or(&[]), cloud.colors.as_deref().unwrap_or(&[]));
    for ((p, n), c) in cloud.positions.iter().zip(normals).zip(colors) {
        if text {
            writeln!(out, "{} {} {} {} {} {} {} {} {}", p.x, p.y, p.z, n.x, n.y, n.z, c[0], c[1], c[2])?;
        } else {
            for v in [p.x, p.y, p.z, n.x, n.y, n.z] {
                out.write_all(&v.to_le_bytes())?;
            }
            out.write_all(c)?;
        }
    }
    out.flush()
}

fn open(path: &Path) -> PointCloud {
    load::open(path, &Options::default()).expect("the bench's own file is good")
}

fn bench(c: &mut Criterion) {
    let points = std::env::var("SURFEL_BENCH_POINTS").ok().and_then(|n| n.parse().ok()).unwrap_or(2_000_000);
    let folder = std::env::temp_dir().join(format!("surfel-bench-load-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let cloud = synthetic::scene("terrain", points, 1).expect("a scene of that name");
    let mut group = c.benchmark_group("load");
    group.sample_size(10);
    for (name, text) in [("ply binary", false), ("ply ascii", true)] {
        let path = folder.join(format!("{text}.ply"));
        write_ply(&path, &cloud, text).expect("room for the bench's file");
        let read = open(&path);
        assert!(read.positions == cloud.positions && read.colors == cloud.colors, "{name} gives other points");
        drop(read);
        group.throughput(Throughput::Elements(points as u64));
        group.bench_function(name, |b| b.iter(|| black_box(open(&path))));
        group.bench_function(format!("{name}, naive: bytes only"), |b| b.iter(|| black_box(std::fs::read(&path))));
    }
    let data = std::env::var_os("SURFEL_DATA").map(PathBuf::from);
    let data = data.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"));
    let autzen = data.join("autzen_stadium.laz");
    if autzen.is_file() {
        let read = open(&autzen);
        let bounds = Bounds::of(&read).expect("points");
        assert!(read.len() == 10_653_336 && (bounds.min.x - 635_577.79).abs() < 1e-3, "autzen gives other points");
        drop(read);
        group.throughput(Throughput::Elements(10_653_336));
        group.bench_function("laz autzen", |b| b.iter(|| black_box(open(&autzen))));
    } else {
        eprintln!("load/laz autzen: left out, {} is not there", autzen.display());
    }
    group.finish();
    // Its own folder, made above.
    let _ = std::fs::remove_dir_all(&folder);
}

criterion_group!(benches, bench);
criterion_main!(benches);
