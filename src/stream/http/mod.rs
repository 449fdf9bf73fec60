//! A file behind any HTTP server that answers range requests (RFC 9110, section 14).
//!
//! Opening costs one request, which also brings the file's beginning. Every later one carries what the file was opened as
//! (`If-Range`), and every answer is compared with that. At most one answer a thread is held, of the size that was asked
//! for, whatever a server sends.

mod client;
mod head;

use std::fmt;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

use self::client::{Ask, Client, Problem, locked};
use self::head::{Head, Version};
use super::{Access, Backoff, Fault, FaultKind};
use crate::error::{Error, Result};

/// A server may send less than was asked for; so often the rest is asked for.
const PIECES: usize = 8;

/// How to deal with a server.
#[derive(Debug, Clone, PartialEq)]
pub struct HttpOptions {
    /// Most time to resolve the name, and as much to connect (TLS is not in it).
    pub connect: Duration,
    /// Longest silence: until the head of an answer is here, and between parts of its body.
    pub silence: Duration,
    /// A body of n bytes has `silence` + n / `slowest` in all, so that a trickle ends too \[bytes/s\].
    pub slowest: u32,
    /// Requests for one [`Access::read`], at least 1; faults that do not pass are not retried.
    pub attempts: u32,
    /// Pauses between them.
    pub backoff: Backoff,
    /// The longest pause that `Retry-After` is obeyed for.
    pub longest_pause: Duration,
    /// What opening brings of the file and keeps \[bytes\]; at least 1 is asked for.
    pub head: u32,
    /// The largest file that is kept as a whole where the server knows no ranges \[bytes\].
    pub whole: u64,
    /// Connections that are kept open while idle.
    pub connections: usize,
    /// Whether the variables `ALL_PROXY`, `HTTPS_PROXY`, `HTTP_PROXY` and `NO_PROXY` count.
    pub proxy: bool,
    /// Of the chance in the pauses.
    pub seed: u64,
}

impl Default for HttpOptions {
    /// 5 s to connect, 10 s of silence, 16 KiB/s, 4 attempts, pauses up to 30 s (`Retry-After`: 60 s), 64 KiB at once,
    /// whole files up to 64 MiB, 16 connections, proxies.
    fn default() -> Self {
        HttpOptions {
            connect: Duration::from_secs(5),
            silence: Duration::from_secs(10),
            slowest: 16 << 10,
            attempts: 4,
            backoff: Backoff::default(),
            longest_pause: Duration::from_secs(60),
            head: 64 << 10,
            whole: 64 << 20,
            connections: 16,
            proxy: true,
            seed: 1,
        }
    }
}

/// What was asked of a server since a file was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HttpStats {
    /// Requests sent, that of opening too; following a redirection is not counted.
    pub requests: u64,
    /// Bytes of bodies that were read.
    pub bytes: u64,
    /// Attempts after the first, of opening and of [`Access::read`].
    pub retries: u64,
}

/// A file on a server.
pub struct HttpAccess {
    client: Client,
    name: String,
    size: u64,
    version: Version,
    /// The file's first bytes.
    head: Vec<u8>,
    /// More of them, since they were [expected](Access::expect).
    start: OnceLock<Vec<u8>>,
    /// All of it, where the server sends nothing less.
    whole: OnceLock<Vec<u8>>,
    /// Held while all of it is fetched.
    fetching: Mutex<()>,
}

impl fmt::Debug for HttpAccess {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("HttpAccess").field("name", &self.name).field("size", &self.size).finish_non_exhaustive()
    }
}

/// What opening learns.
struct Opened {
    size: u64,
    version: Version,
    head: Vec<u8>,
    /// Whether `head` is all of it, because there are no ranges.
    whole: bool,
}

impl HttpAccess {
    /// Asks for the first [`HttpOptions::head`] bytes, and so learns length, version, and whether ranges work. One request;
    /// a second one where they do not and the file is larger than that.
    ///
    /// # Errors
    /// [`Error::Stream`]: no such server or file (`Unreachable`, `Refused`), no ranges and too large (`Ranges`), a head
    /// that makes no sense or a compressed body (`Protocol`), too slow (`TimedOut`), too busy (`Busy`).
    pub fn open(address: &str, options: HttpOptions) -> Result<HttpAccess> {
        let client = Client::new(address, options);
        let name = without_password(address);
        match client.retried(|| opened(&client)) {
            Ok(Opened { size, version, head, whole }) => {
                let (head, whole) = if whole { (Vec::new(), OnceLock::from(head)) } else { (head, OnceLock::new()) };
                Ok(HttpAccess {
                    client,
                    name,
                    size,
                    version,
                    head,
                    start: OnceLock::new(),
                    whole,
                    fetching: Mutex::new(()),
                })
            }
            Err(Problem { kind, why }) => Err(Error::Stream(Fault { kind, name, at: 0, why })),
        }
    }

    /// What was asked so far.
    pub fn stats(&self) -> HttpStats {
        let Client { requests, bytes, retries, .. } = &self.client;
        HttpStats { requests: requests.load(Relaxed), bytes: bytes.load(Relaxed), retries: retries.load(Relaxed) }
    }

    /// Whether the server knows no ranges, so that the file is held as a whole.
    pub fn is_whole(&self) -> bool {
        self.whole.get().is_some()
    }

    fn fault(&self, at: u64, Problem { kind, why }: Problem) -> Fault {
        Fault { kind, name: self.name.clone(), at, why }
    }

    /// Serves what is here already. False: it is not.
    fn kept(&self, at: u64, to: &mut [u8]) -> Result<bool, Fault> {
        let end = at.checked_add(to.len() as u64).filter(|end| *end <= self.size).ok_or_else(|| {
            let why = format!("{} bytes were asked for, the file has {} in all", to.len(), self.size);
            self.fault(at, Problem::new(FaultKind::Short, why))
        })?;
        let kept = self.whole.get().or(self.start.get()).unwrap_or(&self.head);
        // The end is no farther than `kept` goes, so both fit in memory.
        let here = end <= kept.len() as u64;
        if here {
            to.copy_from_slice(&kept[at as usize..end as usize]);
        }
        Ok(here || to.is_empty())
    }

    fn request(&self, at: u64, to: &mut [u8]) -> Result<(), Problem> {
        let mut done = 0;
        for _ in 0..PIECES {
            done += self.piece(at + done as u64, &mut to[done..])?;
            if done == to.len() {
                return Ok(());
            }
        }
        let why = format!("the server sent {done} of {} bytes in {PIECES} answers", to.len());
        Err(Problem::new(FaultKind::Short, why))
    }

    /// One request; how many bytes it brought.
    fn piece(&self, at: u64, to: &mut [u8]) -> Result<usize, Problem> {
        let (first, last) = (at, at + to.len() as u64 - 1);
        let ask = Ask { range: Some((first, last)), condition: self.version.condition(), bytes: to.len() as u64 };
        let (head, mut response) = self.client.send(&ask)?;
        match head.status {
            206 => {
                let range = checked_range(&head, first, last)?;
                self.same(&head, range.total)?;
                let bytes = (range.last - first + 1) as usize;
                self.client.fill(&mut response, &mut to[..bytes])?;
                Ok(bytes)
            }
            200 => {
                self.same(&head, head.length)?;
                drop(response);
                self.fetch_whole()?;
                let kept = self.whole.get().map_or(&[][..], Vec::as_slice);
                to.copy_from_slice(&kept[at as usize..at as usize + to.len()]);
                Ok(to.len())
            }
            416 => self.same(&head, head.total).and(Err(head.problem())),
            _ => Err(head.problem()),
        }
    }

    /// An error where an answer is about another version than was opened.
    fn same(&self, head: &Head, size: Option<u64>) -> Result<(), Problem> {
        let changed = |why: &str| Err(Problem::new(FaultKind::Changed, format!("the file was altered: {why}")));
        match (self.version.differs(&head.version), size) {
            (Some(why), _) => changed(&why),
            (_, Some(size)) if size != self.size => changed(&format!("it had {} bytes and has {size}", self.size)),
            _ => Ok(()),
        }
    }

    /// The server answered a range with the file: it may do so, and has to be taken at its word, once.
    fn fetch_whole(&self) -> Result<(), Problem> {
        let _one = locked(&self.fetching);
        if self.whole.get().is_some() {
            return Ok(());
        }
        if self.size > self.client.options.whole {
            return Err(too_large(Some(self.size), self.client.options.whole));
        }
        let (head, mut response) = self.client.send(&Ask { range: None, condition: None, bytes: self.size })?;
        if head.status != 200 {
            return Err(head.problem());
        }
        self.same(&head, head.length)?;
        let all = self.client.drain(&mut response, self.size)?;
        let all = all.filter(|all| all.len() as u64 == self.size).ok_or_else(|| {
            Problem::new(FaultKind::Changed, format!("the file was altered: it no longer has {} bytes", self.size))
        })?;
        let _ = self.whole.set(all);
        Ok(())
    }
}

impl Access for HttpAccess {
    fn name(&self) -> &str {
        &self.name
    }

    fn size(&self) -> u64 {
        self.size
    }

    fn read(&self, at: u64, to: &mut [u8]) -> Result<(), Fault> {
        if self.kept(at, to)? {
            return Ok(());
        }
        self.client.retried(|| self.request(at, to)).map_err(|p| self.fault(at, p))
    }

    fn read_once(&self, at: u64, to: &mut [u8]) -> Result<(), Fault> {
        if self.kept(at, to)? {
            return Ok(());
        }
        self.request(at, to).map_err(|p| self.fault(at, p))
    }

    fn expect(&self, bytes: u64) {
        let bytes = bytes.min(self.size);
        let kept = self.whole.get().or(self.start.get()).unwrap_or(&self.head);
        if bytes <= kept.len() as u64 || bytes > self.client.options.whole {
            return;
        }
        let mut start = vec![0; bytes as usize];
        let (here, rest) = start.split_at_mut(kept.len());
        here.copy_from_slice(kept);
        if self.request(here.len() as u64, rest).is_ok() {
            let _ = self.start.set(start);
        }
    }

    fn interrupt(&self) {
        self.client.interrupt();
    }
}

fn opened(client: &Client) -> Result<Opened, Problem> {
    let first_bytes = u64::from(client.options.head.max(1));
    let (head, mut response) =
        client.send(&Ask { range: Some((0, first_bytes - 1)), condition: None, bytes: first_bytes })?;
    match head.status {
        206 => {
            let range = checked_range(&head, 0, first_bytes - 1)?;
            let size = range
                .total
                .ok_or_else(|| Problem::new(FaultKind::Protocol, "the server does not say how long the file is"))?;
            let mut bytes = vec![0; range.last as usize + 1];
            client.fill(&mut response, &mut bytes)?;
            Ok(Opened { size, version: head.version, head: bytes, whole: false })
        }
        // A file without bytes has no first one.
        416 if head.total == Some(0) => Ok(Opened { size: 0, version: head.version, head: Vec::new(), whole: true }),
        200 => {
            let most = client.options.whole;
            if head.length.is_some_and(|length| length > most) {
                return Err(too_large(head.length, most));
            }
            // What fits the time that this request has is taken; else the file is asked for again, with the time that it needs.
            let (version, all) = if head.length.is_some_and(|length| length <= first_bytes) {
                (head.version, client.drain(&mut response, first_bytes)?)
            } else {
                drop(response);
                let bytes = head.length.unwrap_or(most);
                let (head, mut response) = client.send(&Ask { range: None, condition: None, bytes })?;
                if head.status != 200 {
                    return Err(head.problem());
                }
                (head.version, client.drain(&mut response, most)?)
            };
            let head = all.ok_or_else(|| too_large(None, most))?;
            Ok(Opened { size: head.len() as u64, version, head, whole: true })
        }
        _ => Err(head.problem()),
    }
}

/// The range of an answer with status 206 that begins where it should and goes no farther.
fn checked_range(head: &Head, first: u64, last: u64) -> Result<head::ContentRange, Problem> {
    let wrong = |got: &str| {
        let why = format!("bytes {first} to {last} were asked for, and the server sent {got}");
        Err(Problem::new(FaultKind::Protocol, why))
    };
    match (head.range, head.length) {
        (Some(r), _) if r.first != first || r.last > last => wrong(&format!("{} to {}", r.first, r.last)),
        (Some(r), Some(length)) if length != r.last - r.first + 1 => wrong(&format!("a body of {length} bytes")),
        (Some(r), _) => Ok(r),
        (None, _) => wrong("a part without saying which"),
    }
}

fn too_large(size: Option<u64>, most: u64) -> Problem {
    let size = size.map_or(String::new(), |s| format!(" of {s} bytes"));
    let why = format!(
        "the server does not answer range requests, and the file{size} is too large to be fetched as a whole \
         (more than {most} bytes): serve it from one that does, as nginx, Apache and every object store do"
    );
    Problem::new(FaultKind::Ranges, why)
}

/// For messages: user name and password do not belong there.
fn without_password(address: &str) -> String {
    let start = address.find("://").map_or(0, |at| at + 3);
    let host = address[start..].find(['/', '?', '#']).map_or(address.len(), |at| start + at);
    match address[start..host].rfind('@') {
        Some(at) => format!("{}{}", &address[..start], &address[start + at + 1..]),
        None => address.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_name_no_password() {
        assert_eq!(without_password("http://a:b@host/x@y"), "http://host/x@y");
        assert_eq!(without_password("http://host/x@y?z=@"), "http://host/x@y?z=@");
        assert_eq!(without_password("https://me@host"), "https://host");
    }
}
