//! Streaming: what comes from a file and from a server on this machine, and what a frame pays for asking.
//!
//! 1. Ranges of 16 KiB at random places, blocking, from a file (in the page cache) and from nginx on localhost, by 1 to 8 threads.
//! 2. The frame's own cost: `want` with 10,000 keys and `take`, while four threads fetch and decode what can be had.
//!
//! `cargo bench --bench stream`; `-- --test` runs once, small.

#[path = "../tests/common/folder.rs"]
mod folder;
#[path = "../tests/common/nginx.rs"]
mod nginx;

use std::collections::HashSet;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use surfel::measure::Summary;
use surfel::stream::{Access, FetchOptions, Fetcher, FileAccess, HttpAccess, HttpOptions, Want};

const RANGE: usize = 16 << 10;

/// Seconds that `requests` ranges take; bytes are compared with what they should be.
fn ranges(access: &dyn Access, bytes: &[u8], threads: usize, requests: usize) -> f64 {
    let start = Instant::now();
    thread::scope(|scope| {
        for thread in 0..threads {
            scope.spawn(move || {
                let mut to = vec![0; RANGE];
                for i in (thread..requests).step_by(threads) {
                    let at = (i * 2_654_435_761) % (bytes.len() - RANGE);
                    access.read(at as u64, &mut to).expect("a range");
                    assert!(to == bytes[at..at + RANGE], "wrong bytes at {at}");
                }
            });
        }
    });
    start.elapsed().as_secs_f64()
}

fn throughput(small: bool) {
    let size = if small { 1 << 20 } else { 64 << 20 };
    let (requests, rounds) = if small { (64, 1) } else { (4000, 5) };
    let folder = folder::Folder::new("bench-stream");
    let bytes: Vec<u8> = (0..size as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    std::fs::write(folder.path("model"), &bytes).expect("a file");
    let nginx = nginx::Nginx::start(&folder.0);
    let options = HttpOptions { proxy: false, ..HttpOptions::default() };
    let file = FileAccess::open(folder.path("model")).expect("a file");
    let http = HttpAccess::open(&nginx.address("model"), options).expect("a file behind nginx");
    println!("ranges of 16 KiB at random places in a file of {} MiB", size >> 20);
    println!("  from    threads   requests/s (quartiles)          MiB/s");
    for (name, access) in [("file", &file as &dyn Access), ("nginx", &http)] {
        for threads in [1, 2, 4, 8] {
            ranges(access, &bytes, threads, requests / 4);
            let rates: Vec<f64> =
                (0..rounds).map(|_| requests as f64 / ranges(access, &bytes, threads, requests)).collect();
            let rate = Summary::of(&rates).expect("rounds");
            let mib = rate.median * RANGE as f64 / f64::from(1 << 20);
            println!(
                "  {name:<7} {threads:>7} {:>12.0} ({:.0} to {:.0}) {mib:>12.0}",
                rate.median, rate.lower, rate.upper
            );
        }
    }
    let log = nginx.log();
    let connections: HashSet<u64> = log.iter().map(|l| l.0).collect();
    println!("  nginx counts {} requests over {} connections", log.len(), connections.len());
}

/// Fetches a patch from a file, or never: then the thread sleeps, as one that waits for a server does.
#[derive(Debug)]
struct Slow(Duration);

impl Access for Slow {
    fn name(&self) -> &str {
        "slow"
    }

    fn size(&self) -> u64 {
        u64::MAX
    }

    fn read(&self, at: u64, to: &mut [u8]) -> Result<(), surfel::stream::Fault> {
        thread::sleep(self.0);
        to.fill(at as u8);
        Ok(())
    }
}

fn frames(small: bool) {
    let (keys, rounds) = if small { (1000, 20) } else { (10_000, 600) };
    println!("\na frame's want of {keys} keys and take, four threads, a frame each 4 ms, {rounds} frames");
    println!("  a request takes   µs: median   99 % below   longest   patches that came");
    for millis in [0, 1, 20] {
        let access: Arc<dyn Access> = Arc::new(Slow(Duration::from_millis(millis)));
        let options = FetchOptions { threads: 4, ..FetchOptions::default() };
        let mut fetcher = Fetcher::with_options(access, options, |_, bytes| Ok(bytes)).expect("threads");
        let (mut times, mut came) = (Vec::new(), 0);
        for frame in 0..rounds {
            // The camera moves: what is wanted shifts, and so do priorities.
            let list: Vec<Want> = (0..keys)
                .map(|i| {
                    let key: u32 = frame * 40 + i;
                    let priority = (key.wrapping_mul(2_654_435_761) >> 8) as f32;
                    Want { key, at: u64::from(key) * 20_000, bytes: RANGE as u32, priority }
                })
                .collect();
            let start = Instant::now();
            fetcher.want(&list);
            let patches = fetcher.take();
            times.push(start.elapsed().as_secs_f64() * 1e6);
            came += patches.len();
            thread::sleep(Duration::from_millis(4));
        }
        times.sort_by(f64::total_cmp);
        let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
        println!("  {millis:>12} ms {:>12.1} {:>12.1} {:>9.1} {came:>19}", at(0.5), at(0.99), at(1.0));
    }
}

fn main() {
    let small = std::env::args().any(|a| a == "--test");
    throughput(small);
    frames(small);
}
