//! Where the bytes of a model come from: a file, or any HTTP server. Nothing here knows what the bytes mean.
//!
//! [`Access`] is blocking positioned reads; [`Fetcher`] makes of it what a frame can use: it is told what is wanted, and
//! asked what has come.
#![forbid(unsafe_code)]

mod backoff;
mod fetch;
mod file;
#[cfg(feature = "http")]
mod http;

pub use backoff::Backoff;
pub use fetch::{FetchOptions, FetchStats, Fetcher, Want};
pub use file::FileAccess;
#[cfg(feature = "http")]
pub use http::{HttpAccess, HttpOptions, HttpStats};

use std::fmt;
use std::sync::Arc;

use crate::error::{Error, Result};

/// Bytes of one model, wherever they are. All calls block; several threads may call at once.
pub trait Access: Send + Sync + fmt::Debug {
    /// The file's path or address, for messages.
    fn name(&self) -> &str;

    /// Length when it was opened \[bytes\].
    fn size(&self) -> u64;

    /// Fills all of `to` with the bytes from `at` on, of the very file that was opened: where that was replaced meanwhile,
    /// the fault is [`FaultKind::Changed`].
    fn read(&self, at: u64, to: &mut [u8]) -> Result<(), Fault>;

    /// As [`read`](Access::read), without retries and pauses of its own: for a caller that has its own.
    fn read_once(&self, at: u64, to: &mut [u8]) -> Result<(), Fault> {
        self.read(at, to)
    }

    /// The first `bytes` will be read soon: where a read costs a round trip, they are fetched in one, and kept. What fails here is for
    /// the reads to say.
    fn expect(&self, bytes: u64) {
        let _ = bytes;
    }

    /// Ends the waiting of all threads that are in a call now: their requests fail. What is asked afterwards works, the
    /// retries of [`read`](Access::read) too.
    fn interrupt(&self) {}
}

/// Opens a model at an address (`http://`, `https://`) or in a file.
///
/// # Errors
/// What [`FileAccess::open`] and `HttpAccess::open` say; `Unsupported` for an address whose feature (`http`, `https`) this
/// build lacks.
pub fn open(location: &str) -> Result<Arc<dyn Access>> {
    let scheme = |name: &str| location.get(..name.len()).is_some_and(|start| start.eq_ignore_ascii_case(name));
    let lacks =
        |feature: &str| Err(Error::Unsupported(format!("{location}: this build lacks the feature `{feature}`")));
    match (scheme("http://"), scheme("https://")) {
        (_, true) if !cfg!(feature = "https") => lacks("https"),
        (true, _) if !cfg!(feature = "http") => lacks("http"),
        #[cfg(feature = "http")]
        (true, _) | (_, true) => Ok(Arc::new(HttpAccess::open(location, HttpOptions::default())?)),
        _ => Ok(Arc::new(FileAccess::open(location)?)),
    }
}

/// Why bytes did not come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FaultKind {
    /// The system refused to read.
    Io,
    /// There is less than was asked for, or the connection ended before all had come.
    Short,
    /// It is no longer the file that was opened.
    Changed,
    /// No connection, or it broke before an answer.
    Unreachable,
    /// The server said nothing for too long, or sent too slowly.
    TimedOut,
    /// The server cannot now: status 429 or 5xx.
    Busy,
    /// The server, or this side, will not: any other status, an address or certificate that is no good.
    Refused,
    /// The server sends whole files only, and this one is too large for that.
    Ranges,
    /// The answer is none to the request: another range, compressed bytes, broken HTTP.
    Protocol,
}

impl FaultKind {
    /// All kinds, in the order of their declaration.
    pub const ALL: [FaultKind; 9] = [
        FaultKind::Io,
        FaultKind::Short,
        FaultKind::Changed,
        FaultKind::Unreachable,
        FaultKind::TimedOut,
        FaultKind::Busy,
        FaultKind::Refused,
        FaultKind::Ranges,
        FaultKind::Protocol,
    ];

    /// Whether the same request may well succeed a moment later.
    pub fn is_passing(self) -> bool {
        use FaultKind::{Busy, Protocol, Short, TimedOut, Unreachable};
        matches!(self, Short | Unreachable | TimedOut | Busy | Protocol)
    }
}

/// Bytes that did not come.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// What went wrong.
    pub kind: FaultKind,
    /// [`Access::name`].
    pub name: String,
    /// First byte asked for.
    pub at: u64,
    /// In one line.
    pub why: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at byte {}: {}", self.name, self.at, self.why)
    }
}

impl std::error::Error for Fault {}
