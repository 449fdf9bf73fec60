//! An HTTP server that does what a script says: right answers, and every kind of wrong one.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// One request, as it came.
#[derive(Debug, Clone)]
pub struct Asked {
    /// From 0, over all connections.
    pub number: usize,
    pub path: String,
    /// First and last byte.
    pub range: Option<(usize, usize)>,
    pub head: String,
}

impl Asked {
    fn of(number: usize, head: &str) -> Asked {
        let mut asked = Asked { number, path: String::new(), range: None, head: head.to_owned() };
        asked.path = head.split(' ').nth(1).unwrap_or_default().to_owned();
        asked.range = asked.field("range").and_then(|r| {
            let (first, last) = r.strip_prefix("bytes=")?.split_once('-')?;
            Some((first.parse().ok()?, last.parse().ok()?))
        });
        asked
    }

    pub fn field(&self, name: &str) -> Option<&str> {
        let of = |line: &'_ str| line.split_once(':').filter(|f| f.0.eq_ignore_ascii_case(name)).is_some();
        self.head.lines().find(|l| of(l)).and_then(|l| l.split_once(':')).map(|f| f.1.trim())
    }
}

/// What happens after an answer's bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum After {
    Keep,
    Close,
    /// Nothing more comes, until the client gives up.
    Hang,
    /// The bytes come one at a time, so far apart.
    Drip(Duration),
    /// The connection is reset; no byte is sent.
    Reset,
}

pub struct Reply(pub Vec<u8>, pub After);

/// A file as a server has it.
#[derive(Debug, Clone)]
pub struct Served {
    pub bytes: Vec<u8>,
    pub etag: &'static str,
}

impl Served {
    pub fn new(len: usize) -> Served {
        Served {
            bytes: (0..len as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect(),
            etag: "\"one\"",
        }
    }

    /// Status line and fields, then the body.
    pub fn answer(&self, status: &str, fields: &str, body: &[u8], after: After) -> Reply {
        let mut bytes = format!("HTTP/1.1 {status}\r\nETag: {}\r\n{fields}\r\n", self.etag).into_bytes();
        bytes.extend_from_slice(body);
        Reply(bytes, after)
    }

    /// The part from `first` to `last`, cut at the end of the file, called `named`.
    pub fn part_named(&self, (first, last): (usize, usize), named: &str, after: After) -> Reply {
        let last = last.min(self.bytes.len() - 1);
        let fields = format!("Content-Length: {}\r\nContent-Range: {named}\r\n", last - first + 1);
        self.answer("206 Partial Content", &fields, &self.bytes[first..=last], after)
    }

    pub fn part(&self, (first, last): (usize, usize)) -> Reply {
        let named = format!("bytes {first}-{}/{}", last.min(self.bytes.len() - 1), self.bytes.len());
        self.part_named((first, last), &named, After::Keep)
    }

    pub fn whole(&self) -> Reply {
        self.answer("200 OK", &format!("Content-Length: {}\r\n", self.bytes.len()), &self.bytes, After::Keep)
    }

    pub fn status(&self, status: &str, fields: &str) -> Reply {
        self.answer(status, &format!("Content-Length: 0\r\n{fields}"), b"", After::Keep)
    }

    /// What a proper server says.
    pub fn right(&self, asked: &Asked) -> Reply {
        match asked.range {
            None => self.whole(),
            Some((first, _)) if first >= self.bytes.len() => {
                self.status("416 Range Not Satisfiable", &format!("Content-Range: bytes */{}\r\n", self.bytes.len()))
            }
            Some(range) => self.part(range),
        }
    }
}

type Script = dyn Fn(&Asked) -> Reply + Send + Sync;

struct State {
    script: Box<Script>,
    requests: AtomicUsize,
    connections: AtomicUsize,
    asked: Mutex<Vec<Asked>>,
    stop: AtomicBool,
}

pub struct Server {
    state: Arc<State>,
    place: SocketAddr,
    accepting: Option<thread::JoinHandle<()>>,
}

impl Server {
    pub fn start(script: impl Fn(&Asked) -> Reply + Send + Sync + 'static) -> Server {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let place = listener.local_addr().expect("its number");
        let state = Arc::new(State {
            script: Box::new(script),
            requests: AtomicUsize::new(0),
            connections: AtomicUsize::new(0),
            asked: Mutex::new(Vec::new()),
            stop: AtomicBool::new(false),
        });
        let shared = Arc::clone(&state);
        let accepting = thread::spawn(move || {
            for stream in listener.incoming() {
                if shared.stop.load(SeqCst) {
                    return;
                }
                let (Ok(stream), state) = (stream, Arc::clone(&shared)) else { continue };
                state.connections.fetch_add(1, SeqCst);
                // Ends with its client.
                thread::spawn(move || serve(stream, &state));
            }
        });
        Server { state, place, accepting: Some(accepting) }
    }

    pub fn address(&self, path: &str) -> String {
        format!("http://{}/{path}", self.place)
    }

    pub fn requests(&self) -> usize {
        self.state.requests.load(SeqCst)
    }

    pub fn connections(&self) -> usize {
        self.state.connections.load(SeqCst)
    }

    pub fn asked(&self) -> Vec<Asked> {
        self.state.asked.lock().expect("no panic").clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.state.stop.store(true, SeqCst);
        let _ = TcpStream::connect(self.place);
        let _ = self.accepting.take().expect("once").join();
    }
}

/// The length of the request's head at the front of what has come, without taking it.
fn peeked(stream: &TcpStream, buffer: &mut [u8]) -> Option<usize> {
    loop {
        let got = stream.peek(buffer).ok().filter(|n| *n > 0)?;
        match buffer[..got].windows(4).position(|w| w == b"\r\n\r\n") {
            Some(end) => return Some(end + 4),
            None => thread::sleep(Duration::from_micros(200)),
        }
    }
}

fn serve(mut stream: TcpStream, state: &State) {
    let mut buffer = vec![0; 1 << 14];
    stream.set_nodelay(true).expect("an option");
    while let Some(head) = peeked(&stream, &mut buffer) {
        let number = state.requests.fetch_add(1, SeqCst);
        let asked = Asked::of(number, &String::from_utf8_lossy(&buffer[..head]));
        state.asked.lock().expect("no panic").push(asked.clone());
        let Reply(bytes, after) = (state.script)(&asked);
        if after == After::Reset {
            // What was not read when a socket is closed makes that a reset.
            return;
        }
        stream.read_exact(&mut buffer[..head]).expect("what was peeked");
        let sent = match after {
            After::Drip(pause) => bytes.iter().try_for_each(|byte| {
                thread::sleep(pause);
                stream.write_all(&[*byte])
            }),
            _ => stream.write_all(&bytes),
        };
        match after {
            _ if sent.is_err() => return,
            After::Keep => {}
            After::Hang => {
                let _ = stream.read(&mut buffer);
                return;
            }
            _ => return,
        }
    }
}
