//! Asynchronous fetching: what is asked of the access, in which order, how often.

use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Condvar, Mutex};
use std::thread;
use std::time::Duration;

use surfel::stream::{
    Access, Backoff, Fault, FaultKind, FetchOptions, FetchStats, Fetcher, HttpAccess, HttpOptions, Want,
};
use surfel::{Error, Place};

use crate::server::{After, Reply, Served, Server};
use crate::stream_http::{PASSING, quick, within_a_minute};

/// Bytes in memory behind a gate, which writes down what is read.
#[derive(Debug)]
struct Gated {
    bytes: Vec<u8>,
    reads: Mutex<Vec<(u64, usize)>>,
    open: Mutex<bool>,
    moved: Condvar,
    /// Reads that begin here fail so often.
    broken: Mutex<HashMap<u64, u32>>,
}

impl Gated {
    fn new(open: bool) -> Arc<Gated> {
        Arc::new(Gated {
            bytes: Served::new(100_000).bytes,
            reads: Mutex::default(),
            open: Mutex::new(open),
            moved: Condvar::new(),
            broken: Mutex::default(),
        })
    }

    fn set(&self, open: bool) {
        *self.open.lock().expect("no panic") = open;
        self.moved.notify_all();
    }

    fn reads(&self) -> Vec<(u64, usize)> {
        self.reads.lock().expect("no panic").clone()
    }
}

impl Access for Gated {
    fn name(&self) -> &str {
        "memory"
    }

    fn size(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn read(&self, at: u64, to: &mut [u8]) -> Result<(), Fault> {
        self.reads.lock().expect("no panic").push((at, to.len()));
        let open = self.open.lock().expect("no panic");
        drop(self.moved.wait_while(open, |open| !*open).expect("no panic"));
        if let Some(left) = self.broken.lock().expect("no panic").get_mut(&at).filter(|left| **left > 0) {
            *left -= 1;
            return Err(Fault { kind: FaultKind::Io, name: "memory".into(), at, why: "broken".into() });
        }
        to.copy_from_slice(&self.bytes[at as usize..at as usize + to.len()]);
        Ok(())
    }

    fn interrupt(&self) {
        self.set(true);
    }
}

const QUICK: Backoff = Backoff { first: Duration::from_millis(1), cap: Duration::from_millis(8) };

fn options() -> FetchOptions {
    FetchOptions { threads: 1, join: 0, backoff: QUICK, ..FetchOptions::default() }
}

fn fetcher(access: &Arc<Gated>, options: FetchOptions) -> Fetcher<Vec<u8>> {
    Fetcher::with_options(Arc::clone(access) as Arc<dyn Access>, options, |_, bytes| Ok(bytes)).expect("threads")
}

/// Patch `key` of 100 bytes at 100 · key.
fn want(key: u32, priority: f32) -> Want {
    Want { key, at: 100 * u64::from(key), bytes: 100, priority }
}

/// Until `enough`; fails if it never is.
fn until(mut enough: impl FnMut() -> bool) {
    for _ in 0..60_000 {
        if enough() {
            return;
        }
        thread::sleep(Duration::from_millis(1));
    }
    panic!("it never came");
}

/// As many results as that, in the order in which they came.
fn taken<T: Send + 'static>(fetcher: &mut Fetcher<T>, count: usize) -> Vec<(u32, Result<T, Error>)> {
    let mut all = Vec::new();
    until(|| {
        all.extend(fetcher.take());
        all.len() >= count
    });
    assert_eq!(all.len(), count);
    all
}

/// Lets everything that is wanted settle, and says what was done.
fn settled(fetcher: &Fetcher<Vec<u8>>, requests: u64) -> FetchStats {
    until(|| fetcher.stats().requests >= requests && fetcher.stats().in_flight == 0);
    fetcher.stats()
}

#[test]
fn by_priority_then_key() {
    let access = Gated::new(false);
    let mut fetcher = fetcher(&access, options());
    // The gate holds the only thread until the list is there.
    fetcher.want(&[want(0, 0.0)]);
    until(|| access.reads().len() == 1);
    let list =
        [(7, 1.0), (3, 2.0), (9, 2.0), (1, f32::NEG_INFINITY), (4, 1.0), (2, f32::INFINITY), (8, -0.0), (6, 0.0)];
    fetcher.want(&list.map(|(key, priority)| want(key, priority)));
    access.set(true);
    let keys: Vec<u32> = taken(&mut fetcher, 9).into_iter().map(|(key, _)| key).collect();
    assert_eq!(keys, [0, 2, 3, 9, 4, 7, 6, 8, 1]);
    let reads: Vec<u64> = access.reads().into_iter().map(|r| r.0 / 100).collect();
    assert_eq!(reads, [0, 2, 3, 9, 4, 7, 6, 8, 1]);
}

#[test]
fn what_is_no_longer_wanted_is_forgotten() {
    let access = Gated::new(false);
    let mut fetcher = fetcher(&access, options());
    fetcher.want(&(0..10).map(|key| want(key, 0.0)).collect::<Vec<_>>());
    until(|| access.reads().len() == 1);
    fetcher.want(&[want(8, 0.0), want(20, 1.0)]);
    access.set(true);
    let keys: Vec<u32> = taken(&mut fetcher, 3).into_iter().map(|(key, _)| key).collect();
    assert_eq!(keys, [0, 20, 8], "what was begun comes all the same");
    let stats = settled(&fetcher, 3);
    assert_eq!((stats.requests, stats.delivered, stats.forgotten), (3, 3, 8), "{stats:?}");
    assert_eq!((stats.bytes, stats.held), (300, 0));
}

#[test]
fn nothing_is_fetched_twice_unless_it_is_wanted_again() {
    let access = Gated::new(false);
    let mut fetcher = fetcher(&access, FetchOptions { threads: 3, ..options() });
    let list: Vec<Want> = (0..3).map(|key| want(key, 0.0)).collect();
    fetcher.want(&list);
    until(|| access.reads().len() == 3);
    // In flight.
    fetcher.want(&list);
    access.set(true);
    until(|| fetcher.stats().delivered == 3);
    // Come, not taken; then taken, by a caller that made its list before it knew. Patch 3 shows that the lists were read.
    fetcher.want(&[list[0], list[1], list[2], want(3, -1.0)]);
    assert_eq!(taken(&mut fetcher, 4).len(), 4);
    assert_eq!(access.reads().len(), 4);
    // Taken, and wanted again.
    fetcher.want(&[list[1]]);
    assert_eq!(taken(&mut fetcher, 1)[0].0, 1);
    assert_eq!(access.reads().len(), 5);
    // By the very list that has just been made.
    fetcher.want(&[list[1]]);
    assert_eq!(taken(&mut fetcher, 1)[0].0, 1);
    assert_eq!(access.reads().len(), 6);
    // The same key twice in a list is one patch.
    fetcher.want(&[list[2], list[2]]);
    assert_eq!(taken(&mut fetcher, 1)[0].0, 2);
    assert_eq!(settled(&fetcher, 7).requests, 7);
}

#[test]
fn bytes_that_are_not_taken_count() {
    let access = Gated::new(true);
    let mut fetcher = fetcher(&access, FetchOptions { threads: 4, in_flight: 350, ..options() });
    let mut left: HashSet<u32> = (0..40).collect();
    while !left.is_empty() {
        let list: Vec<Want> = left.iter().map(|key| want(*key, 0.0)).collect();
        fetcher.want(&list);
        // Nobody takes anything until the workers stop by themselves.
        until(|| fetcher.stats().in_flight == 0 && fetcher.stats().held == 100 * left.len().min(3) as u64);
        let came = fetcher.take();
        assert_eq!(came.len(), left.len().min(3));
        came.iter().for_each(|(key, _)| assert!(left.remove(key)));
    }
    // One that is larger than the budget goes alone.
    fetcher.want(&[Want { key: 100, at: 0, bytes: 900, priority: 0.0 }, want(101, -1.0)]);
    until(|| fetcher.stats().delivered == 41);
    assert_eq!(access.reads().last(), Some(&(0, 900)));
    assert_eq!(taken(&mut fetcher, 2)[1].0, 101, "only after it was taken");
}

#[test]
fn neighbours_come_in_one_request() {
    let access = Gated::new(false);
    let mut fetcher = fetcher(&access, FetchOptions { gap: 50, join: 1000, ..options() });
    fetcher.want(&[want(0, 0.0)]);
    until(|| access.reads().len() == 1);
    let at = |key, at, bytes, priority| Want { key, at, bytes, priority };
    fetcher.want(&[
        at(10, 5000, 100, 1.0), // a gap of 50 after 11: joined
        at(11, 4800, 150, 3.0), // the first
        at(12, 5151, 100, 2.0), // 51 after 10: not joined
        at(13, 4700, 60, 0.0),  // 40 before 11: joined
        at(14, 20_000, 600, 1.5),
        at(15, 20_600, 400, 1.2), // 1000 bytes: joined
        at(16, 21_000, 1, 0.5),   // one byte too many
        at(17, 20_300, 100, 0.1), // within
    ]);
    access.set(true);
    let came = taken(&mut fetcher, 9);
    assert_eq!(access.reads()[1..], [(4700, 400), (5151, 100), (20_000, 1000), (21_000, 1)]);
    let keys: Vec<u32> = came.iter().map(|(key, _)| *key).collect();
    assert_eq!(keys, [0, 13, 11, 10, 12, 14, 17, 15, 16]);
    for (key, first, len) in [(13, 4700, 60), (11, 4800, 150), (10, 5000, 100), (17, 20_300, 100), (15, 20_600, 400)] {
        let bytes = came.iter().find(|c| c.0 == key).and_then(|c| c.1.as_ref().ok()).expect("a patch");
        assert_eq!(bytes[..], access.bytes[first..first + len], "{key}");
    }
    let stats = settled(&fetcher, 5);
    assert_eq!((stats.requests, stats.coalesced, stats.bytes), (5, 4, 100 + 400 + 100 + 1000 + 1), "{stats:?}");
}

#[test]
fn a_key_that_fails_pauses_and_comes_alone() {
    let access = Gated::new(true);
    access.broken.lock().expect("no panic").insert(500, 3);
    let mut fetcher = fetcher(&access, FetchOptions { threads: 2, gap: 0, join: 300, ..options() });
    // Patches 5 to 7 go together, and fail with the first; then each goes alone, and 5 fails twice more.
    fetcher.want(&[want(5, 0.0), want(6, 0.0), want(7, 0.0), want(20, 0.0)]);
    let keys: HashSet<u32> =
        taken(&mut fetcher, 4).into_iter().map(|(key, patch)| patch.map(|_| key).expect("it came")).collect();
    assert_eq!(keys, HashSet::from([5, 6, 7, 20]));
    let stats = settled(&fetcher, 7);
    assert_eq!((stats.faults(FaultKind::Io), stats.all_faults(), stats.retries), (3, 3, 5), "{stats:?}");
    assert_eq!((stats.requests, stats.delivered, stats.coalesced), (7, 4, 2), "{stats:?}");
    assert_eq!(fetcher.fault(), None, "it works again");
}

#[test]
fn a_server_that_is_down_is_not_hammered() {
    let access = Gated::new(true);
    access.broken.lock().expect("no panic").extend((0..900).map(|key| (100 * key, u32::MAX)));
    let never = Backoff { first: Duration::from_secs(3600), cap: Duration::from_secs(3600) };
    let mut fetcher = fetcher(&access, FetchOptions { threads: 4, backoff: never, ..options() });
    let list: Vec<Want> = (0..900).map(|key| want(key, 0.0)).collect();
    until(|| {
        fetcher.want(&list);
        fetcher.stats().all_faults() >= 5
    });
    for _ in 0..20 {
        fetcher.want(&list);
        thread::sleep(Duration::from_millis(1));
    }
    // Five failures, and what the other three threads had begun before the fifth.
    let requests = fetcher.stats().requests;
    assert!((5..=8).contains(&requests), "{requests} requests for 900 keys");
    assert!(fetcher.fault().is_some_and(|f| f.kind == FaultKind::Io));
}

#[test]
fn what_cannot_be_decoded_is_given_up_after_a_while() {
    let access = Gated::new(true);
    let tries = Arc::new(AtomicUsize::new(0));
    let decode = {
        let tries = Arc::clone(&tries);
        move |key: u32, bytes: Vec<u8>| match (key, tries.fetch_add(usize::from(key == 1), SeqCst)) {
            (2, _) => Err(Error::Data { file: "memory".into(), place: Place::Byte(200), why: "no patch".into() }),
            (1, 0..2) => Err(Error::Unsupported("not yet".into())),
            _ => Ok(bytes.len()),
        }
    };
    let mut fetcher =
        Fetcher::with_options(Arc::clone(&access) as Arc<dyn Access>, options(), decode).expect("threads");
    let list = [want(0, 0.0), want(1, 0.0), want(2, 0.0)];
    fetcher.want(&list);
    let mut came = taken(&mut fetcher, 3);
    came.sort_by_key(|(key, _)| *key);
    assert!(matches!(came[..], [(0, Ok(100)), (1, Ok(100)), (2, Err(Error::Data { .. }))]), "{came:?}");
    let stats = fetcher.stats();
    assert_eq!((stats.corrupt, stats.given_up, stats.delivered, stats.requests), (2 + 3, 1, 2, 1 + 3 + 3), "{stats:?}");
    // For good; 0 shows that the list was read.
    fetcher.want(&list[..1]);
    assert_eq!(taken(&mut fetcher, 1)[0].0, 0);
    fetcher.want(&[want(2, 1.0), want(0, 0.0)]);
    assert_eq!(taken(&mut fetcher, 1)[0].0, 0);
    assert_eq!(access.reads().iter().filter(|r| r.0 == 200).count(), 3);
}

#[test]
fn an_index_that_lies_costs_nothing() {
    let access = Gated::new(true);
    let mut fetcher = fetcher(&access, FetchOptions { join: 1 << 20, ..options() });
    let lies = [(1, 99_901, 100), (2, u64::MAX, u32::MAX), (3, 0, u32::MAX), (4, u64::MAX - 10, 5)];
    let mut list: Vec<Want> = lies.into_iter().map(|(key, at, bytes)| Want { key, at, bytes, priority: 1.0 }).collect();
    list.push(want(0, 0.0));
    fetcher.want(&list);
    let mut came = taken(&mut fetcher, 5);
    came.sort_by_key(|(key, _)| *key);
    assert!(came[0].1.is_ok());
    for (key, error) in &came[1..] {
        let lies = matches!(error, Err(Error::Stream(fault)) if fault.kind == FaultKind::Short);
        assert!(lies, "{key}: {error:?}");
    }
    assert_eq!(access.reads(), [(0, 100)], "nothing else was read");
    // They are told once.
    fetcher.want(&list);
    assert_eq!(taken(&mut fetcher, 1)[0].0, 0);
    assert_eq!((fetcher.stats().given_up, fetcher.stats().all_faults()), (4, 0));
}

#[test]
fn keys_that_always_fail_do_not_keep_others_away() {
    let access = Gated::new(true);
    access.broken.lock().expect("no panic").extend((0..20).map(|key| (100 * key, u32::MAX)));
    let mut fetcher = fetcher(&access, options());
    let list: Vec<Want> = (0..40).map(|key| want(key, -(key as f32))).collect();
    fetcher.want(&list);
    let mut keys: Vec<u32> = taken(&mut fetcher, 20).into_iter().map(|(key, _)| key).collect();
    keys.sort_unstable();
    assert_eq!(keys, (20..40).collect::<Vec<_>>());
}

#[test]
fn every_fault_in_turn_and_the_view_is_complete() {
    let file = Served::new(10_000);
    let served = file.clone();
    // Every other request goes wrong, in a way that depends on its number.
    let server = Server::start(move |a| match (a.number % 2, (a.number / 2) % PASSING.len()) {
        (1, wrong) => PASSING[wrong].2(&served, a),
        _ => served.right(a),
    });
    let http = HttpOptions { slowest: 10_000_000, ..quick() };
    let access: Arc<dyn Access> = Arc::new(HttpAccess::open(&server.address(""), http).expect("a file"));
    let all = FetchOptions { threads: 3, ..options() };
    let mut fetcher = Fetcher::with_options(access, all, |_, bytes| Ok(bytes)).expect("threads");
    let mut missing: Vec<Want> = (1..99).map(|key| want(key, 0.0)).collect();
    within_a_minute(move || {
        while !missing.is_empty() {
            fetcher.want(&missing);
            for (key, patch) in fetcher.take() {
                assert_eq!(patch.expect("a patch"), file.bytes[100 * key as usize..][..100]);
                missing.retain(|w| w.key != key);
            }
            thread::sleep(Duration::from_micros(200));
        }
        let stats = fetcher.stats();
        assert_eq!((stats.delivered, stats.given_up, stats.corrupt), (98, 0, 0), "{stats:?}");
        for kind in PASSING.iter().map(|p| p.1) {
            assert!(stats.faults(kind) > 0, "{kind:?}: {stats:?}");
        }
        assert_eq!(stats.requests, stats.delivered + stats.all_faults(), "every request was one or the other");
        assert_eq!(server.requests() as u64, 1 + stats.requests);
    });
}

#[test]
fn dropping_it_ends_a_stall() {
    let file = Served::new(10_000);
    let server = Server::start(move |a| match a.number {
        0 => file.right(a),
        _ => Reply(Vec::new(), After::Hang),
    });
    let options = HttpOptions { silence: Duration::from_secs(3600), ..quick() };
    let access: Arc<dyn Access> = Arc::new(HttpAccess::open(&server.address(""), options).expect("a file"));
    let mut fetcher = Fetcher::new(access, 4, |_, bytes| Ok(bytes)).expect("threads");
    fetcher.want(&(1..99).map(|key| Want { at: 90 * u64::from(key), ..want(key, 0.0) }).collect::<Vec<_>>());
    until(|| server.requests() > 1);
    within_a_minute(move || drop(fetcher));
    // And one that never had anything to do.
    let idle = Fetcher::new(Gated::new(true) as Arc<dyn Access>, 2, |_, bytes| Ok(bytes)).expect("threads");
    within_a_minute(move || drop(idle));
}
