//! Which patch next, and which of its neighbours come along. Knows no threads and no clock: time is an argument.

use std::cmp::Reverse;
use std::collections::{HashMap, HashSet};
use std::time::Instant;

use super::desk::Generation;
use super::{FetchOptions, Want};
use crate::rng::Rng;

/// One request.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Job {
    /// First byte.
    pub at: u64,
    /// From the first patch's first byte to the last one's last.
    pub bytes: u64,
    /// By place in the file.
    pub wants: Vec<Want>,
    /// Whether it had failed before.
    pub retry: bool,
}

/// Why no request may be begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Idle {
    /// When to look again unless something happens before.
    pub until: Option<Instant>,
    /// Whether there would be one if less waited to be taken.
    pub full: bool,
}

/// What went wrong with a key so far.
#[derive(Debug, Default)]
struct Failure {
    fetches: u32,
    decodings: u32,
    /// None: given up.
    not_before: Option<Instant>,
}

pub(super) struct Plan {
    options: FetchOptions,
    /// Of the file \[bytes\].
    size: u64,
    /// As the caller gave it.
    pub list: Vec<Want>,
    pub generation: Generation,
    /// What may be begun of it, by place in the file.
    items: Vec<Item>,
    /// Numbers in `items`, first things last.
    order: Vec<usize>,
    /// When a key of the list may be tried again.
    cooled: Option<Instant>,
    failures: HashMap<u32, Failure>,
    in_flight: HashSet<u32>,
    bytes_in_flight: u64,
    /// Requests that failed since one succeeded.
    failed: u32,
    /// Nothing is begun before.
    pause: Option<Instant>,
    rng: Rng,
}

#[derive(Debug)]
struct Item {
    want: Want,
    begun: bool,
    /// How often fetching or decoding it failed. One that did takes no neighbours along.
    failures: u32,
}

impl Plan {
    pub(super) fn new(options: FetchOptions, size: u64) -> Plan {
        Plan {
            size,
            list: Vec::new(),
            generation: 0,
            items: Vec::new(),
            order: Vec::new(),
            cooled: None,
            failures: HashMap::new(),
            in_flight: HashSet::new(),
            bytes_in_flight: 0,
            failed: 0,
            pause: None,
            rng: Rng::new(options.seed),
            options,
        }
    }

    /// Whether a key that had to pause may be tried again.
    pub(super) fn is_stale(&self, now: Instant) -> bool {
        self.cooled.is_some_and(|t| t <= now)
    }

    /// Takes a new list; how many keys were planned, not begun, and are not in it.
    pub(super) fn replace(&mut self, generation: Generation, list: Vec<Want>) -> u64 {
        let left: Vec<u32> = self.items.iter().filter(|i| !i.begun).map(|i| i.want.key).collect();
        (self.generation, self.list) = (generation, list);
        if left.is_empty() {
            return 0;
        }
        let wanted: HashSet<u32> = self.list.iter().map(|w| w.key).collect();
        left.iter().filter(|key| !wanted.contains(key)).count() as u64
    }

    /// Plans the list anew, without the keys that `came`. Returns what lies beyond the file's end: that is given up.
    pub(super) fn make(&mut self, came: &[u32], now: Instant) -> Vec<Want> {
        let mut beyond = Vec::new();
        let mut seen: HashSet<u32> = came.iter().copied().collect();
        let mut order: Vec<Want> = Vec::with_capacity(self.list.len());
        self.cooled = None;
        for want in self.list.iter().filter(|w| !self.in_flight.contains(&w.key)) {
            match self.failures.get(&want.key).map(|f| f.not_before) {
                Some(None) => continue,
                Some(Some(t)) if t > now => self.cooled = Some(self.cooled.map_or(t, |c| c.min(t))),
                _ if want.at.checked_add(u64::from(want.bytes)).is_none_or(|end| end > self.size) => {
                    self.failures.entry(want.key).or_default().not_before = None;
                    beyond.push(*want);
                }
                _ => order.push(*want),
            }
        }
        order.sort_unstable_by(|a, b| b.priority.total_cmp(&a.priority).then(a.key.cmp(&b.key)).then(a.at.cmp(&b.at)));
        order.retain(|w| seen.insert(w.key));
        let mut places: Vec<usize> = (0..order.len()).collect();
        places.sort_unstable_by_key(|i| (order[*i].at, order[*i].bytes, *i));
        let failures = |w: &Want| self.failures.get(&w.key).map_or(0, |f| f.fetches.saturating_add(f.decodings));
        let item = |want: Want| Item { want, begun: false, failures: failures(&want) };
        self.items = places.iter().map(|i| item(order[*i])).collect();
        self.order = (0..places.len()).collect();
        self.order.sort_unstable_by_key(|n| Reverse(places[*n]));
        beyond
    }

    /// The next request, if one may be begun while `waiting` bytes are not taken.
    pub(super) fn next(&mut self, waiting: u64, now: Instant) -> Result<Job, Idle> {
        let cooled = Idle { until: self.cooled, full: false };
        match self.pause {
            Some(pause) if pause > now => return Err(Idle { until: Some(pause), full: false }),
            // Until one request succeeds, there is one at a time.
            Some(_) if !self.in_flight.is_empty() => return Err(cooled),
            _ => {}
        }
        while self.order.last().is_some_and(|n| self.items[*n].begun) {
            self.order.pop();
        }
        let Some(&first) = self.order.last() else { return Err(cooled) };
        let first = if self.pause.is_some() { self.probe().unwrap_or(first) } else { first };
        let held = self.bytes_in_flight + waiting;
        let free = self.options.in_flight.saturating_sub(held);
        let bytes = u64::from(self.items[first].want.bytes);
        if bytes > free && held > 0 {
            return Err(Idle { full: true, ..cooled });
        }
        let (low, high, end) = self.joined(first, free);
        let (at, retry) = (self.items[low].want.at, self.items[first].failures > 0);
        let mut wants = Vec::new();
        for item in self.items[low..=high].iter_mut().filter(|i| !i.begun && (i.failures == 0 || retry)) {
            item.begun = true;
            self.in_flight.insert(item.want.key);
            wants.push(item.want);
        }
        let bytes = end - at;
        self.bytes_in_flight += bytes;
        Ok(Job { at, bytes, wants, retry })
    }

    /// While nothing succeeds, what failed least often is tried: keys that always fail must not keep the others from showing that
    /// the server is well.
    fn probe(&self) -> Option<usize> {
        let open = self.order.iter().rev().filter(|n| !self.items[**n].begun);
        open.min_by_key(|n| self.items[**n].failures).copied()
    }

    /// First and last of the items that come along with `first`, and the end of their bytes.
    fn joined(&self, first: usize, free: u64) -> (usize, usize, u64) {
        let end_of = |w: &Want| w.at.saturating_add(u64::from(w.bytes));
        let want = &self.items[first].want;
        let (mut low, mut high, mut start, mut end) = (first, first, want.at, end_of(want));
        if self.items[first].failures > 0 {
            return (low, high, end);
        }
        let most = u64::from(self.options.join).min(free);
        let gap = u64::from(self.options.gap);
        let open = |n: &usize| !self.items[*n].begun && self.items[*n].failures == 0;
        while let Some(n) = (high + 1..self.items.len()).find(open) {
            let next = &self.items[n].want;
            if next.at > end.saturating_add(gap) || end_of(next).max(end) - start > most {
                break;
            }
            (high, end) = (n, end.max(end_of(next)));
        }
        while let Some(n) = (0..low).rev().find(open) {
            let next = &self.items[n].want;
            if end_of(next).saturating_add(gap) < start || end_of(next).max(end) - next.at > most {
                break;
            }
            (low, start, end) = (n, next.at, end.max(end_of(next)));
        }
        (low, high, end)
    }

    /// A request came back with bytes, or without.
    pub(super) fn returned(&mut self, job: &Job, came: bool, now: Instant) {
        self.bytes_in_flight -= job.bytes;
        if came {
            (self.failed, self.pause) = (0, None);
            return;
        }
        self.failed = self.failed.saturating_add(1);
        let threads = self.options.threads.max(1) as u32;
        if self.failed > threads {
            self.pause = Some(now + self.options.backoff.pause(self.failed - threads, &mut self.rng));
        }
        for want in &job.wants {
            self.in_flight.remove(&want.key);
            let failure = self.failures.entry(want.key).or_default();
            failure.fetches = failure.fetches.saturating_add(1);
            let again = now + self.options.backoff.pause(failure.fetches, &mut self.rng);
            failure.not_before = Some(again);
            self.cool(again);
        }
    }

    /// A patch of a request that came was decoded.
    pub(super) fn decoded(&mut self, key: u32) {
        self.in_flight.remove(&key);
        self.failures.remove(&key);
    }

    /// Or it could not be; whether it is given up.
    pub(super) fn corrupt(&mut self, key: u32, now: Instant) -> bool {
        self.in_flight.remove(&key);
        let failure = self.failures.entry(key).or_default();
        failure.decodings += 1;
        let give_up = failure.decodings >= self.options.decodings.max(1);
        let again = now + self.options.backoff.pause(failure.decodings, &mut self.rng);
        failure.not_before = (!give_up).then_some(again);
        if !give_up {
            self.cool(again);
        }
        give_up
    }

    fn cool(&mut self, again: Instant) {
        self.cooled = Some(self.cooled.map_or(again, |c| c.min(again)));
    }

    pub(super) fn held(&self) -> (u64, u64) {
        (self.in_flight.len() as u64, self.bytes_in_flight)
    }
}
