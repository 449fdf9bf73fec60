//! Patches from an [`Access`], asynchronously. A frame says what it wants and takes what has come; it never waits.
//!
//! The frame's thread and the workers share one small lock, the *desk*, under which a list changes hands and results are
//! put down: nothing there takes longer than a few results do. Everything that looks at a whole list (sorting, joining, forgetting)
//! is the workers' business, under a lock of their own, the *plan*.

mod desk;
mod plan;
mod worker;

use std::fmt;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use self::worker::{Decode, Shared};
use super::{Access, Backoff, Fault, FaultKind};
use crate::error::{Error, Result};

/// A patch that a frame would like to have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Want {
    /// The caller's name for it; one key is always the same bytes.
    pub key: u32,
    /// First byte.
    pub at: u64,
    /// How many.
    pub bytes: u32,
    /// Greatest first; those that tie by key, least first. NaN goes by the order of [`f32::total_cmp`].
    pub priority: f32,
}

/// How to fetch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FetchOptions {
    /// Threads that read and decode, at least 1: so many requests are in flight at most.
    pub threads: usize,
    /// Most bytes that are in flight, or have come and are not yet taken. A patch that is larger goes alone.
    pub in_flight: u64,
    /// Patches that lie at most so far apart in the file come in one request \[bytes\].
    pub gap: u32,
    /// Longest request of several patches; 0 joins none \[bytes\].
    pub join: u32,
    /// How often a patch is fetched in all that cannot be decoded, at least 1.
    pub decodings: u32,
    /// Pauses of a key whose fetching failed, and of everything while nothing succeeds.
    pub backoff: Backoff,
    /// Of the chance in the pauses.
    pub seed: u64,
}

impl FetchOptions {
    /// 4 threads, 16 MiB in flight, gaps of 4 KiB, joined up to 256 KiB, 3 decodings.
    pub const DEFAULT: FetchOptions = FetchOptions {
        threads: 4,
        in_flight: 16 << 20,
        gap: 4 << 10,
        join: 256 << 10,
        decodings: 3,
        backoff: Backoff::DEFAULT,
        seed: 1,
    };
}

impl Default for FetchOptions {
    fn default() -> Self {
        FetchOptions::DEFAULT
    }
}

/// What a [`Fetcher`] did so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FetchStats {
    /// Requests begun.
    pub requests: u64,
    /// Bytes that came, gaps between joined patches among them.
    pub bytes: u64,
    /// Patches that were delivered.
    pub delivered: u64,
    /// Patches in flight now.
    pub in_flight: u64,
    /// Bytes in flight or waiting to be taken now.
    pub held: u64,
    /// Requests for patches that had failed before.
    pub retries: u64,
    /// Patches whose bytes could not be decoded, each time.
    pub corrupt: u64,
    /// Patches that were given up, since they never could, or lie beyond the file's end.
    pub given_up: u64,
    /// Patches that were planned, not begun, and then no longer wanted. Lists that no worker looked at before the next one
    /// came do not count.
    pub forgotten: u64,
    /// Patches that came along with a neighbour's request.
    pub coalesced: u64,
    faults: [u64; FaultKind::ALL.len()],
}

impl FetchStats {
    /// Requests that failed so.
    pub fn faults(&self, kind: FaultKind) -> u64 {
        self.faults[kind as usize]
    }

    /// Requests that failed.
    pub fn all_faults(&self) -> u64 {
        self.faults.iter().sum()
    }
}

/// Fetches and decodes patches on threads of its own. `T` is what a patch is decoded to.
///
/// - **Order**: by priority, and strictly so: while the next in order does not fit [`FetchOptions::in_flight`], none goes before it.
///   Neighbours in the file come along with it.
/// - **Faults** cost the key a pause that doubles, up to a cap, and never give it up: what is still wanted comes once the fault
///   clears. While every request fails, one at a time is sent, with a pause that doubles too, whatever the number of keys. A key that
///   failed is fetched alone.
/// - **Bytes that do not decode** are fetched again, [`FetchOptions::decodings`] times in all. Then the key is given up for good, and
///   its error delivered once. So is, without a request, what lies beyond the file's end.
/// - **Dropping** it ends the waiting of requests in flight ([`Access::interrupt`]) and joins the threads. That takes as long as the
///   longest of: a decoding, a read from a file, resolving or reaching a server (`HttpOptions::connect`, 5 s each).
pub struct Fetcher<T> {
    shared: Arc<Shared<T>>,
    threads: Vec<JoinHandle<()>>,
    /// Changes places with the list on the desk.
    spare: Vec<Want>,
    latest: Vec<Want>,
    /// Since the latest list.
    took: bool,
}

impl<T> fmt::Debug for Fetcher<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Fetcher").field("access", &self.shared.access).finish_non_exhaustive()
    }
}

impl<T: Send + 'static> Fetcher<T> {
    /// Starts `threads` threads, with the other options' defaults. `decode(key, bytes)` runs on them; it must not panic.
    ///
    /// # Errors
    /// [`Error::Io`] where the system gives no thread.
    pub fn new(
        access: Arc<dyn Access>,
        threads: usize,
        decode: impl Fn(u32, Vec<u8>) -> Result<T> + Send + Sync + 'static,
    ) -> Result<Fetcher<T>> {
        Fetcher::with_options(access, FetchOptions { threads, ..FetchOptions::default() }, decode)
    }

    /// As [`new`](Fetcher::new).
    ///
    /// # Errors
    /// The same.
    pub fn with_options(
        access: Arc<dyn Access>,
        options: FetchOptions,
        decode: impl Fn(u32, Vec<u8>) -> Result<T> + Send + Sync + 'static,
    ) -> Result<Fetcher<T>> {
        let name = access.name().to_owned();
        let decode: Box<Decode<T>> = Box::new(decode);
        let shared = Arc::new(Shared::new(access, options, decode));
        let mut fetcher = Fetcher { shared, threads: Vec::new(), spare: Vec::new(), latest: Vec::new(), took: false };
        for number in 0..options.threads.max(1) {
            let shared = Arc::clone(&fetcher.shared);
            let thread = thread::Builder::new().name(format!("surfel-fetch-{number}")).spawn(move || shared.work());
            // On the way out, those that were started are joined.
            fetcher.threads.push(thread.map_err(|e| Error::io(&name, e))?);
        }
        Ok(fetcher)
    }

    /// Replaces the list of all that is wanted; what was not begun and is not in it is forgotten. What is in flight, or has come
    /// and was not taken when the list was made, may be in it and is not fetched twice.
    ///
    /// Costs a copy of the list; nothing where it is what it was and nothing was taken since.
    pub fn want(&mut self, wanted: &[Want]) {
        if !self.took && self.latest == wanted {
            return;
        }
        self.took = false;
        self.latest.clear();
        self.latest.extend_from_slice(wanted);
        self.spare.clear();
        self.spare.extend_from_slice(wanted);
        self.shared.desk.publish(&mut self.spare);
    }

    /// What has come since the last call, in the order in which it came: patches, and errors of those that were given up.
    /// Empty when there is nothing.
    pub fn take(&mut self) -> Vec<(u32, Result<T>)> {
        let taken = self.shared.desk.take();
        self.took |= !taken.is_empty();
        taken
    }

    /// What was done so far.
    pub fn stats(&self) -> FetchStats {
        self.shared.desk.stats()
    }

    /// The latest fault, for a message; none once a request has succeeded since.
    pub fn fault(&self) -> Option<Fault> {
        self.shared.desk.fault()
    }
}

impl<T> Drop for Fetcher<T> {
    fn drop(&mut self) {
        self.shared.desk.stop();
        // A worker may have been about to ask when it was interrupted, so it is interrupted until it is gone.
        let mut pause = Duration::from_micros(100);
        while self.threads.iter().any(|t| !t.is_finished()) {
            self.shared.access.interrupt();
            thread::sleep(pause);
            pause = (2 * pause).min(Duration::from_millis(20));
        }
        for thread in self.threads.drain(..) {
            // A decoder that panicked has said so already.
            let _ = thread.join();
        }
    }
}
