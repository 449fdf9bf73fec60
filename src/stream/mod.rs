//! Where the bytes of a model come from: a file, or any HTTP server. Nothing here knows what the bytes mean.
#![forbid(unsafe_code)]

mod file;

pub use file::FileAccess;

use std::fmt;

/// Bytes of one model, wherever they are. All calls block; several threads may call at once.
pub trait Access: Send + Sync + fmt::Debug {
    /// The file's path or address, for messages.
    fn name(&self) -> &str;

    /// Length when it was opened \[bytes\].
    fn size(&self) -> u64;

    /// Fills all of `to` with the bytes from `at` on, of the very file that was opened: where that was replaced meanwhile,
    /// the fault is [`FaultKind::Changed`].
    fn read(&self, at: u64, to: &mut [u8]) -> Result<(), Fault>;
}

/// Why bytes did not come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FaultKind {
    /// The system refused to read.
    Io,
    /// There is less than was asked for.
    Short,
    /// It is no longer the file that was opened.
    Changed,
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
