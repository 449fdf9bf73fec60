//! One request: sent, followed, timed; what can go wrong with it, in words.

use std::io::Read;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ureq::http::{Response, header};
use ureq::{Agent, Body, ResponseExt};

use super::HttpOptions;
use super::head::Head;
use crate::rng::Rng;
use crate::stream::FaultKind;

/// A fault without the place.
#[derive(Debug)]
pub(super) struct Problem {
    pub kind: FaultKind,
    pub why: String,
}

impl Problem {
    pub(super) fn new(kind: FaultKind, why: impl Into<String>) -> Problem {
        Problem { kind, why: why.into() }
    }

    /// `broken` is the kind of a connection that ends.
    fn of(error: ureq::Error, broken: FaultKind) -> Problem {
        use std::io::ErrorKind;
        let kind = match &error {
            ureq::Error::Timeout(_) => FaultKind::TimedOut,
            ureq::Error::Io(e) if matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => {
                FaultKind::TimedOut
            }
            // rustls reports certificates and broken records so.
            ureq::Error::Io(e) if matches!(e.kind(), ErrorKind::InvalidData) => FaultKind::Refused,
            ureq::Error::Io(_) => broken,
            ureq::Error::HostNotFound | ureq::Error::ConnectionFailed => FaultKind::Unreachable,
            ureq::Error::ConnectProxyFailed(_) => FaultKind::Unreachable,
            ureq::Error::Protocol(_) | ureq::Error::LargeResponseHeader(..) => FaultKind::Protocol,
            ureq::Error::TooManyRedirects | ureq::Error::BodyStalled => FaultKind::Protocol,
            _ => FaultKind::Refused,
        };
        Problem::new(kind, error.to_string())
    }
}

pub(super) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Every critical section leaves whole values behind, whatever another thread's panic cut short.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What is asked for.
pub(super) struct Ask<'a> {
    /// `FIRST-LAST`; none asks for the file.
    pub range: Option<(u64, u64)>,
    /// For `If-Range`.
    pub condition: Option<&'a str>,
    /// Of the body, for its time \[bytes\].
    pub bytes: u64,
}

/// A server's file: how it is reached, and what was asked so far.
pub(super) struct Client {
    pub options: HttpOptions,
    address: String,
    /// Where the server last sent us instead.
    moved: Mutex<Option<String>>,
    agent: Mutex<Agent>,
    /// The server said to come no sooner.
    not_before: Mutex<Option<Instant>>,
    rng: Mutex<Rng>,
    pub requests: AtomicU64,
    pub bytes: AtomicU64,
    pub retries: AtomicU64,
}

impl Client {
    pub(super) fn new(address: &str, options: HttpOptions) -> Client {
        Client {
            address: address.to_owned(),
            moved: Mutex::new(None),
            agent: Mutex::new(agent(address, &options)),
            not_before: Mutex::new(None),
            rng: Mutex::new(Rng::new(options.seed)),
            requests: AtomicU64::new(0),
            bytes: AtomicU64::new(0),
            retries: AtomicU64::new(0),
            options,
        }
    }

    /// Ends all requests in flight; later ones go over new connections.
    pub(super) fn interrupt(&self) {
        let fresh = agent(&self.address, &self.options);
        let old = std::mem::replace(&mut *locked(&self.agent), fresh);
        old.shutdown();
    }

    /// Sends a request. An answer that brings no bytes is returned too, with whatever status it has.
    pub(super) fn send(&self, ask: &Ask) -> Result<(Head, Response<Body>), Problem> {
        self.wanted_yet()?;
        let moved = locked(&self.moved).clone();
        if let Some(moved) = moved {
            let answer = self.send_to(&moved, ask)?;
            // Addresses that servers send clients to may expire: then the way is asked for anew.
            if !matches!(answer.0.status, 400 | 401 | 403 | 404 | 410) {
                return Ok(answer);
            }
            *locked(&self.moved) = None;
        }
        self.send_to(&self.address, ask)
    }

    fn send_to(&self, address: &str, ask: &Ask) -> Result<(Head, Response<Body>), Problem> {
        let agent = locked(&self.agent).clone();
        let mut request = agent.get(address).header(header::ACCEPT_ENCODING, "identity");
        if let Some((first, last)) = ask.range {
            request = request.header(header::RANGE, format!("bytes={first}-{last}"));
            if let Some(condition) = ask.condition {
                request = request.header(header::IF_RANGE, condition);
            }
        }
        let all =
            self.options.silence + Duration::from_secs_f64(ask.bytes as f64 / f64::from(self.options.slowest.max(1)));
        let request = request.config().timeout_recv_body(Some(all)).build();
        self.requests.fetch_add(1, Relaxed);
        let response = request.call().map_err(|e| Problem::of(e, FaultKind::Unreachable))?;
        let head = Head::of(&response)?;
        if let (Some(seconds), 429 | 503) = (head.retry_after, head.status) {
            let wait = Duration::from_secs(seconds).min(self.options.longest_pause);
            *locked(&self.not_before) = Some(Instant::now() + wait);
        }
        let from = response.get_uri();
        if matches!(head.status, 200 | 206) && from != address {
            *locked(&self.moved) = Some(from.to_string());
        }
        Ok((head, response))
    }

    /// Nothing is sent while the server wants to be left alone.
    fn wanted_yet(&self) -> Result<(), Problem> {
        let mut not_before = locked(&self.not_before);
        match not_before.and_then(|t| t.checked_duration_since(Instant::now())).filter(|left| !left.is_zero()) {
            Some(left) => {
                let why = format!("the server asked to be left alone for another {:.1} s", left.as_secs_f64());
                Err(Problem::new(FaultKind::Busy, why))
            }
            None => {
                *not_before = None;
                Ok(())
            }
        }
    }

    /// Tries until it succeeds, or fails for good, or has failed [`HttpOptions::attempts`] times.
    pub(super) fn retried<T>(&self, mut attempt: impl FnMut() -> Result<T, Problem>) -> Result<T, Problem> {
        let mut failures = 0;
        loop {
            let problem = match attempt() {
                Ok(value) => return Ok(value),
                Err(problem) => problem,
            };
            failures += 1;
            if !problem.kind.is_passing() {
                return Err(problem);
            }
            if failures >= self.options.attempts {
                let why = format!("{} ({failures} attempts)", problem.why);
                return Err(Problem { why, ..problem });
            }
            let asked = locked(&self.not_before).map(|t| t.saturating_duration_since(Instant::now()));
            let pause = self.options.backoff.pause(failures, &mut locked(&self.rng));
            std::thread::sleep(pause.max(asked.unwrap_or_default()));
            self.retries.fetch_add(1, Relaxed);
        }
    }

    /// Fills `to` from a body that should have exactly these bytes.
    pub(super) fn fill(&self, response: &mut Response<Body>, to: &mut [u8]) -> Result<(), Problem> {
        let mut body = response.body_mut().as_reader();
        let mut done = 0;
        while done < to.len() {
            let got = body.read(&mut to[done..]).map_err(|e| Problem::of(e.into(), FaultKind::Short));
            let got = got.map_err(|p| Problem { why: format!("{} after {done} of {} bytes", p.why, to.len()), ..p })?;
            if got == 0 {
                let why = format!("the answer ended after {done} of {} bytes", to.len());
                return Err(Problem::new(FaultKind::Short, why));
            }
            done += got;
            self.bytes.fetch_add(got as u64, Relaxed);
        }
        // The connection is kept only once the end has been seen. All bytes are here, so an error there changes nothing.
        match body.read(&mut [0]) {
            Ok(1..) => Err(Problem::new(FaultKind::Protocol, "the answer has more bytes than its head says")),
            _ => Ok(()),
        }
    }

    /// Reads a body to its end, of at most `most` bytes; none if it has more.
    pub(super) fn drain(&self, response: &mut Response<Body>, most: u64) -> Result<Option<Vec<u8>>, Problem> {
        let mut all = Vec::new();
        let read = response.body_mut().as_reader().take(most.saturating_add(1)).read_to_end(&mut all);
        self.bytes.fetch_add(all.len() as u64, Relaxed);
        read.map_err(|e| Problem::of(e.into(), FaultKind::Short))?;
        Ok((all.len() as u64 <= most).then_some(all))
    }
}

fn agent(address: &str, options: &HttpOptions) -> Agent {
    let mut config = Agent::config_builder()
        .http_status_as_error(false)
        .https_only(address.get(..6).is_some_and(|start| start.eq_ignore_ascii_case("https:")))
        .max_redirects(5)
        .user_agent(concat!("surfel/", env!("CARGO_PKG_VERSION")))
        .max_idle_connections(options.connections)
        .max_idle_connections_per_host(options.connections)
        .timeout_resolve(Some(options.connect))
        .timeout_connect(Some(options.connect))
        .timeout_send_request(Some(options.silence))
        .timeout_recv_response(Some(options.silence))
        .timeout_per_read(Some(options.silence));
    if !options.proxy {
        config = config.proxy(None);
    }
    Agent::new_with_config(config.build())
}
