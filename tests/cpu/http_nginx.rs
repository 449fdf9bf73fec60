//! A server that people have: nginx from Debian.

use std::collections::HashSet;
use std::fs;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use surfel::stream::{Access, Backoff, FetchOptions, Fetcher, HttpAccess, Want};

use crate::folder::Folder;
use crate::nginx::Nginx;
use crate::server::Served;
use crate::stream_http::{quick, within_a_minute};

const SIZE: usize = 1 << 20;

fn served(test: &str) -> (Folder, Vec<u8>, Nginx) {
    let folder = Folder::new(test);
    let bytes = Served::new(SIZE).bytes;
    fs::write(folder.0.join("model"), &bytes).expect("a file");
    let nginx = Nginx::start(&folder.0);
    (folder, bytes, nginx)
}

#[test]
fn many_ranges_at_once_over_few_connections() {
    let (_folder, bytes, nginx) = served("nginx-many");
    let access = HttpAccess::open(&nginx.address("model"), quick()).expect("a file");
    assert_eq!(access.size(), SIZE as u64);
    let (threads, each) = (8, 100);
    thread::scope(|scope| {
        for n in 0..threads {
            let (access, bytes) = (&access, &bytes);
            scope.spawn(move || {
                for i in 0..each {
                    let len = 1 + (n * 977 + i * 131) % 9000;
                    let at = 64 + (n * 104_729 + i * 7919) % (SIZE - 64 - len);
                    let mut to = vec![0; len];
                    access.read(at as u64, &mut to).expect("a part");
                    assert!(to == bytes[at..at + len], "thread {n}, read {i}");
                }
            });
        }
    });
    assert_eq!((access.stats().requests, access.stats().retries), (1 + threads as u64 * each as u64, 0));
    // nginx writes a request down after it was answered.
    let log = within_a_minute(move || {
        while nginx.log().len() < 1 + threads * each {
            thread::sleep(Duration::from_millis(1));
        }
        nginx.log()
    });
    assert!(log.iter().all(|(_, status)| *status == 206));
    let connections: HashSet<u64> = log.iter().map(|l| l.0).collect();
    assert!(connections.len() <= threads, "{} connections for {threads} threads", connections.len());
}

#[test]
fn a_server_that_goes_and_comes_back() {
    let (_folder, bytes, mut nginx) = served("nginx-restart");
    let access = HttpAccess::open(&nginx.address("model"), quick()).expect("a file");
    let backoff = Backoff { first: Duration::from_millis(2), cap: Duration::from_millis(20) };
    let options = FetchOptions { threads: 4, join: 0, in_flight: 64 << 10, backoff, ..FetchOptions::default() };
    let access: Arc<dyn Access> = Arc::new(access);
    let mut fetcher = Fetcher::with_options(access, options, |_, bytes| Ok(bytes)).expect("threads");
    let (parts, len) = (200u32, 5000u32);
    within_a_minute(move || {
        let want = |key: u32| Want { key, at: u64::from(key * len) + 64, bytes: len, priority: 0.0 };
        let mut missing: Vec<Want> = (0..parts).map(want).collect();
        let mut step = 0;
        while !missing.is_empty() {
            fetcher.want(&missing);
            for (key, part) in fetcher.take() {
                let first = want(key).at as usize;
                assert!(part.expect("a part") == bytes[first..first + len as usize], "part {key}");
                missing.retain(|w| w.key != key);
            }
            match step {
                0 if missing.len() < 150 => {
                    nginx.stop();
                    step = 1;
                }
                1 if fetcher.stats().all_faults() > 10 => {
                    assert!(fetcher.fault().is_some_and(|f| f.kind.is_passing()), "{:?}", fetcher.fault());
                    assert!(nginx.restart());
                    step = 2;
                }
                _ => thread::sleep(Duration::from_micros(200)),
            }
        }
        let stats = fetcher.stats();
        assert_eq!((step, stats.delivered, stats.given_up), (2, u64::from(parts), 0), "{stats:?}");
        assert!(stats.retries > 0, "{stats:?}");
    });
}
