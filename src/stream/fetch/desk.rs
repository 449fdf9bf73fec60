//! Where the frame's thread and the workers meet. Nothing here looks at a whole list.

use std::mem;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::plan::{Idle, Job};
use super::{FetchStats, Want};
use crate::error::{Error, Result};
use crate::stream::Fault;

/// A lock that a panicking decoder cannot spoil: it is never held while one runs.
pub(super) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Which list, from 1; 0 is before the first.
pub(super) type Generation = u64;

struct Content<T> {
    /// The latest list, if no worker has it yet.
    list: Option<Vec<Want>>,
    /// Of the latest list.
    generation: Generation,
    /// A list that a worker has done with, to be filled again.
    used: Vec<Want>,
    done: Vec<(u32, Result<T>)>,
    /// Bytes of patches in `done`.
    done_bytes: u64,
    /// Keys of `done`.
    waiting: Vec<u32>,
    /// Keys that were taken, with the latest list that may have been made without knowledge of it.
    taken: Vec<(Generation, Vec<u32>)>,
    stats: FetchStats,
    fault: Option<Fault>,
    /// Counts whatever may give a worker something to do.
    signal: u64,
    /// Workers that wait.
    idle: usize,
    /// One of them waits for results to be taken.
    full: bool,
    stop: bool,
}

pub(super) struct Desk<T> {
    content: Mutex<Content<T>>,
    bell: Condvar,
}

/// What a worker has to know before it plans.
pub(super) struct News {
    pub list: Option<(Generation, Vec<Want>)>,
    /// Keys that a list of the generation in hand may have in vain, if one is planned.
    pub came: Vec<u32>,
    /// Bytes of what waits to be taken.
    pub waiting: u64,
    pub signal: u64,
    pub stop: bool,
}

impl<T> Desk<T> {
    pub(super) fn new() -> Desk<T> {
        let content = Content {
            list: None,
            generation: 0,
            used: Vec::new(),
            done: Vec::new(),
            done_bytes: 0,
            waiting: Vec::new(),
            taken: Vec::new(),
            stats: FetchStats::default(),
            fault: None,
            signal: 0,
            idle: 0,
            full: false,
            stop: false,
        };
        Desk { content: Mutex::new(content), bell: Condvar::new() }
    }

    /// Wakes one worker, which wakes the next if it finds something to do: a frame's thread does not pay for waking them all.
    fn ring(&self, content: &mut Content<T>) {
        content.signal += 1;
        if content.idle > 0 {
            self.bell.notify_one();
        }
    }

    /// Takes the list, and leaves one to be filled in its place.
    pub(super) fn publish(&self, list: &mut Vec<Want>) {
        let mut content = locked(&self.content);
        let used = content.list.take().unwrap_or_else(|| mem::take(&mut content.used));
        content.list = Some(mem::replace(list, used));
        content.generation += 1;
        self.ring(&mut content);
    }

    pub(super) fn take(&self) -> Vec<(u32, Result<T>)> {
        let mut content = locked(&self.content);
        if content.done.is_empty() {
            return Vec::new();
        }
        let done = mem::take(&mut content.done);
        let keys = (content.generation, mem::take(&mut content.waiting));
        content.taken.push(keys);
        content.done_bytes = 0;
        if mem::take(&mut content.full) {
            self.ring(&mut content);
        } else {
            // Whoever finds no room just now looks again.
            content.signal += 1;
        }
        done
    }

    pub(super) fn stats(&self) -> FetchStats {
        let content = locked(&self.content);
        FetchStats { held: content.stats.held + content.done_bytes, ..content.stats }
    }

    pub(super) fn fault(&self) -> Option<Fault> {
        locked(&self.content).fault.clone()
    }

    pub(super) fn stop(&self) {
        let mut content = locked(&self.content);
        content.stop = true;
        content.signal += 1;
        self.bell.notify_all();
    }

    /// For a worker whose list is of `generation`: a newer list if there is one, for which it gives back the old. `again`: it
    /// plans anew even if there is none.
    pub(super) fn news(&self, generation: Generation, old: &mut Vec<Want>, again: bool) -> News {
        let mut content = locked(&self.content);
        let list = content.list.take().map(|list| (content.generation, list));
        if list.is_some() {
            content.used = mem::take(old);
        }
        let generation = list.as_ref().map_or(generation, |l| l.0);
        content.taken.retain(|(latest, _)| *latest >= generation);
        let mut came = Vec::new();
        if again || list.is_some() {
            came.extend(content.taken.iter().flat_map(|(_, keys)| keys).chain(&content.waiting));
        }
        News { list, came, waiting: content.done_bytes, signal: content.signal, stop: content.stop }
    }

    /// Until something happens after `signal`, or until `wake`.
    pub(super) fn wait(&self, signal: u64, wake: Option<Instant>) {
        let mut content = locked(&self.content);
        content.idle += 1;
        while content.signal == signal {
            let Some(wake) = wake else {
                content = self.bell.wait(content).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            let Some(left) = wake.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) else { break };
            content = self.bell.wait_timeout(content, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        content.idle -= 1;
    }

    /// Puts down a patch of `bytes`, or the error of one that is given up.
    pub(super) fn put(&self, key: u32, bytes: u64, result: Result<T>) {
        let mut content = locked(&self.content);
        content.stats.delivered += u64::from(result.is_ok());
        content.done_bytes += bytes;
        content.done.push((key, result));
        content.waiting.push(key);
    }

    /// What a plan came to: a request, or none; `held` is what is in flight now, keys and bytes.
    pub(super) fn begin(&self, job: Result<&Job, &Idle>, forgotten: u64, held: (u64, u64)) {
        let mut content = locked(&self.content);
        content.full |= job.is_err_and(|idle| idle.full);
        let stats = &mut content.stats;
        stats.forgotten += forgotten;
        (stats.in_flight, stats.held) = held;
        if let Ok(job) = job {
            stats.requests += 1;
            stats.retries += u64::from(job.retry);
            stats.coalesced += job.wants.len() as u64 - 1;
            // There may be work for another. One that looked since the last signal and found none goes on waiting.
            if content.idle > 0 {
                self.bell.notify_one();
            }
        }
    }

    /// A request is over, decoding too: there may be room for another.
    pub(super) fn end(&self, held: (u64, u64)) {
        let mut content = locked(&self.content);
        (content.stats.in_flight, content.stats.held) = held;
        self.ring(&mut content);
    }

    /// A request brought bytes.
    pub(super) fn came(&self, bytes: u64) {
        let mut content = locked(&self.content);
        content.stats.bytes += bytes;
        content.fault = None;
    }

    /// A request failed.
    pub(super) fn failed(&self, fault: Fault) {
        let mut content = locked(&self.content);
        content.stats.faults[fault.kind as usize] += 1;
        content.fault = Some(fault);
    }

    /// A patch could not be decoded.
    pub(super) fn corrupt(&self) {
        locked(&self.content).stats.corrupt += 1;
    }

    /// A key will not come, and this is why.
    pub(super) fn give_up(&self, key: u32, error: Error) {
        locked(&self.content).stats.given_up += 1;
        self.put(key, 0, Err(error));
    }
}
