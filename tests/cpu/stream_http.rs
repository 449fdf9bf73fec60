//! A file behind a server that errs: every fault is named, and what passes is survived.

use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use surfel::Error;
use surfel::stream::{Access, Backoff, Fault, FaultKind, HttpAccess, HttpOptions, open};

use crate::server::{After, Asked, Reply, Served, Server};

const SIZE: usize = 10_000;

/// Quick to give up, and no proxy.
pub fn quick() -> HttpOptions {
    HttpOptions {
        connect: Duration::from_secs(2),
        silence: Duration::from_millis(250),
        attempts: 3,
        backoff: Backoff { first: Duration::from_millis(1), cap: Duration::from_millis(4) },
        longest_pause: Duration::from_millis(50),
        head: 64,
        whole: 4096,
        proxy: false,
        ..HttpOptions::default()
    }
}

/// Runs `f` on a thread of its own, and fails if that hangs.
pub fn within_a_minute<T: Send + 'static>(f: impl FnOnce() -> T + Send + 'static) -> T {
    let (send, receive) = mpsc::channel();
    thread::spawn(move || send.send(f()));
    receive.recv_timeout(Duration::from_secs(60)).expect("neither a hang nor a panic")
}

fn fault(result: Result<HttpAccess, Error>) -> Fault {
    match result {
        Err(Error::Stream(fault)) => fault,
        other => panic!("a fault was expected: {other:?}"),
    }
}

fn read(access: &HttpAccess, at: u64, len: usize) -> Result<Vec<u8>, Fault> {
    let mut bytes = vec![0; len];
    access.read(at, &mut bytes).map(|()| bytes)
}

fn once(access: &HttpAccess, at: u64, len: usize) -> Result<Vec<u8>, Fault> {
    let mut bytes = vec![0; len];
    access.read_once(at, &mut bytes).map(|()| bytes)
}

type Wrong = fn(&Served, &Asked) -> Reply;

/// What passes, and what it is called. `asked` has a range.
pub const PASSING: &[(&str, FaultKind, Wrong)] = &[
    ("another range", FaultKind::Protocol, |f, a| {
        let (first, last) = a.range.expect("a range");
        f.part((first + 1, last + 1))
    }),
    ("a longer range", FaultKind::Protocol, |f, a| {
        let (first, last) = a.range.expect("a range");
        f.part((first, last + 1))
    }),
    ("a part without its range", FaultKind::Protocol, |f, _| {
        f.answer("206 Partial Content", "Content-Length: 3\r\n", b"abc", After::Keep)
    }),
    ("a range that says nothing", FaultKind::Protocol, |f, a| {
        f.part_named(a.range.expect("a range"), "bytes 9-1/zero", After::Keep)
    }),
    ("a lie about the body's length", FaultKind::Protocol, |f, a| {
        let (first, last) = a.range.expect("a range");
        let fields = format!("Content-Length: {}\r\nContent-Range: bytes {first}-{last}/{SIZE}\r\n", u64::MAX / 2);
        f.answer("206 Partial Content", &fields, &f.bytes[first..=last], After::Hang)
    }),
    ("more than the range, chunked", FaultKind::Protocol, |f, a| {
        let (first, last) = a.range.expect("a range");
        let fields = format!("Transfer-Encoding: chunked\r\nContent-Range: bytes {first}-{last}/{SIZE}\r\n");
        let chunk = [format!("{:x}\r\n", SIZE).as_bytes(), &f.bytes, b"\r\n0\r\n\r\n"].concat();
        f.answer("206 Partial Content", &fields, &chunk, After::Keep)
    }),
    ("compressed", FaultKind::Protocol, |f, a| {
        let (first, last) = a.range.expect("a range");
        let range = format!("Content-Encoding: gzip\r\nContent-Range: bytes {first}-{last}/{SIZE}\r\n");
        f.answer("206 Partial Content", &format!("{range}Content-Length: 2\r\n"), &[0x1f, 0x8b], After::Keep)
    }),
    ("no HTTP", FaultKind::Protocol, |_, _| Reply(b"SSH-2.0-OpenSSH_9.2\r\n\r\n".to_vec(), After::Close)),
    ("an endless head", FaultKind::Protocol, |f, _| {
        f.answer("206 Partial Content", &"X-Filler: 0123456789abcdef\r\n".repeat(20_000), b"", After::Close)
    }),
    ("a short body", FaultKind::Short, |f, a| {
        let (first, last) = a.range.expect("a range");
        let Reply(bytes, _) = f.part((first, last));
        Reply(bytes[..bytes.len() - 7].to_vec(), After::Close)
    }),
    ("a reset", FaultKind::Unreachable, |_, _| Reply(Vec::new(), After::Reset)),
    ("no answer", FaultKind::Unreachable, |_, _| Reply(Vec::new(), After::Close)),
    ("silence", FaultKind::TimedOut, |_, _| Reply(Vec::new(), After::Hang)),
    ("a stall in the body", FaultKind::TimedOut, |f, a| {
        let Reply(bytes, _) = f.part(a.range.expect("a range"));
        Reply(bytes[..bytes.len() - 7].to_vec(), After::Hang)
    }),
    ("a trickle", FaultKind::TimedOut, |f, a| {
        Reply(f.part(a.range.expect("a range")).0, After::Drip(Duration::from_millis(5)))
    }),
    ("503", FaultKind::Busy, |f, _| f.status("503 Service Unavailable", "")),
    ("429", FaultKind::Busy, |f, _| f.status("429 Too Many Requests", "Retry-After: 0\r\n")),
    ("500", FaultKind::Busy, |f, _| f.status("500 Internal Server Error", "")),
];

/// Right, but for the request of this number, and all after it if `for_good`.
fn wrong_at(number: usize, for_good: bool, wrong: Wrong) -> (Served, Server) {
    let file = Served::new(SIZE);
    let served = file.clone();
    let at = move |n: usize| if for_good { n >= number } else { n == number };
    (file, Server::start(move |a| if at(a.number) { wrong(&served, a) } else { served.right(a) }))
}

#[test]
fn opening_is_one_request_that_brings_the_beginning() {
    let (file, server) = wrong_at(usize::MAX, false, |f, a| f.right(a));
    let access = HttpAccess::open(&server.address("a"), quick()).expect("a file");
    assert_eq!((access.size(), access.name()), (SIZE as u64, server.address("a").as_str()));
    assert_eq!(read(&access, 3, 61).expect("kept"), file.bytes[3..64]);
    assert_eq!(server.requests(), 1);
    assert_eq!(read(&access, 3, 62).expect("fetched"), file.bytes[3..65]);
    assert_eq!(read(&access, SIZE as u64 - 5, 5).expect("the end"), file.bytes[SIZE - 5..]);
    assert_eq!((server.requests(), server.connections()), (3, 1), "one connection is kept");
    let asked = server.asked();
    assert!(asked.iter().all(|a| a.field("accept-encoding") == Some("identity")), "{asked:?}");
    assert_eq!([0, 1, 2].map(|n: usize| asked[n].field("if-range")), [None, Some("\"one\""), Some("\"one\"")]);
    let stats = access.stats();
    assert_eq!((stats.requests, stats.bytes, stats.retries), (3, 64 + 62 + 5, 0));
}

#[test]
fn what_is_expected_is_one_request_and_kept() {
    let served = Served::new(4000);
    let answers = served.clone();
    // The third request gets no answer that is one.
    let server = Server::start(move |asked| match asked.number {
        2 => answers.status("503 Service Unavailable", ""),
        _ => answers.right(asked),
    });
    let access = HttpAccess::open(&server.address("file"), quick()).expect("a file");
    access.expect(1000);
    assert_eq!(server.asked()[1].range, Some((64, 999)), "what opening brought is not asked for again");
    for (at, len) in [(0, 1000), (0, 10), (60, 10), (999, 1)] {
        assert!(read(&access, at, len).expect("bytes") == served.bytes[at as usize..at as usize + len]);
    }
    access.expect(900);
    assert_eq!(server.requests(), 2);
    // A fault is for the reads to say, and what is too much is not kept.
    let other = HttpAccess::open(&server.address("file"), HttpOptions { head: 4, whole: 3999, ..quick() });
    assert_eq!((other.is_err(), server.requests() > 2), (false, true));
    let other = other.expect("after another attempt");
    let before = server.requests();
    other.expect(u64::MAX);
    assert_eq!(server.requests(), before, "more than is ever kept");
    assert!(read(&other, 10, 20).expect("bytes") == served.bytes[10..30]);
}

#[test]
fn what_passes_is_named_and_survived() {
    for &(name, kind, wrong) in PASSING {
        let (file, server) = wrong_at(1, false, wrong);
        let access = HttpAccess::open(&server.address(""), HttpOptions { slowest: 10_000_000, ..quick() }).expect(name);
        let fault = once(&access, 500, 100).expect_err(name);
        assert_eq!((fault.kind, fault.at, server.requests()), (kind, 500, 2), "{name}: {fault}");
        assert_eq!(once(&access, 500, 100).expect(name), file.bytes[500..600], "{name}");

        let (file, server) = wrong_at(1, false, wrong);
        let access = HttpAccess::open(&server.address(""), HttpOptions { slowest: 10_000_000, ..quick() }).expect(name);
        assert_eq!(read(&access, 500, 100).expect(name), file.bytes[500..600], "{name}");
        assert_eq!((server.requests(), access.stats().retries), (3, 1), "{name}");
    }
}

#[test]
fn opening_survives_what_passes_and_names_what_stays() {
    for &(name, kind, wrong) in PASSING {
        let (file, server) = wrong_at(0, false, wrong);
        let access = HttpAccess::open(&server.address(""), HttpOptions { slowest: 10_000_000, ..quick() }).expect(name);
        assert_eq!((access.size(), server.requests()), (SIZE as u64, 2), "{name}");
        assert_eq!(read(&access, 0, 64).expect(name), file.bytes[..64]);

        let (_, server) = wrong_at(0, true, wrong);
        let options = HttpOptions { slowest: 10_000_000, silence: Duration::from_millis(60), ..quick() };
        let fault = fault(HttpAccess::open(&server.address(""), options));
        assert_eq!((fault.kind, server.requests()), (kind, 3), "{name}: {fault}");
        assert!(fault.why.ends_with("(3 attempts)"), "{name}: {fault}");
    }
}

#[test]
fn another_version_is_not_read() {
    let cases: &[(&str, Wrong)] = &[
        ("another tag", |f, a| Served { etag: "\"two\"", ..f.clone() }.right(a)),
        ("the whole of another", |f, _| Served { etag: "\"two\"", ..f.clone() }.whole()),
        ("another length", |f, a| f.part_named(a.range.expect("a range"), "bytes 500-599/10001", After::Keep)),
        ("the whole, shorter", |f, _| Served { bytes: f.bytes[..900].to_vec(), ..f.clone() }.whole()),
        ("cut off before", |f, _| f.status("416 Range Not Satisfiable", "Content-Range: bytes */400\r\n")),
    ];
    for &(name, wrong) in cases {
        let (file, server) = wrong_at(1, false, wrong);
        let access = HttpAccess::open(&server.address(""), quick()).expect(name);
        let fault = read(&access, 500, 100).expect_err(name);
        assert_eq!((fault.kind, server.requests()), (FaultKind::Changed, 2), "{name}: {fault}");
        assert_eq!(read(&access, 500, 100).expect("it is back"), file.bytes[500..600], "{name}");
    }
}

#[test]
fn what_stays_is_not_asked_again() {
    for status in
        ["404 Not Found", "410 Gone", "403 Forbidden", "401 Unauthorized", "416 Range Not Satisfiable", "501 Never"]
    {
        let file = Served::new(SIZE);
        let server = Server::start(move |_| file.status(status, ""));
        let fault = fault(HttpAccess::open(&server.address(""), quick()));
        assert_eq!((fault.kind, server.requests()), (FaultKind::Refused, 1), "{fault}");
        assert!(fault.why.contains(&status[..3]), "{fault}");
    }
    for address in ["http://", "http:// /", "http://[::/"] {
        assert_eq!(fault(HttpAccess::open(address, quick())).kind, FaultKind::Refused, "{address}");
    }
    let port = std::net::TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a port").port();
    let nobody = fault(HttpAccess::open(&format!("http://127.0.0.1:{port}/"), quick()));
    assert_eq!(nobody.kind, FaultKind::Unreachable, "{nobody}");
}

#[test]
fn whole_files_are_kept_or_refused() {
    // From the beginning on: at most what opening asks for comes at once, more in a second request.
    for (len, requests) in [(50, 1), (64, 1), (65, 2), (4096, 2)] {
        let file = Served::new(len);
        let served = file.clone();
        let server = Server::start(move |_| served.whole());
        let access = HttpAccess::open(&server.address(""), quick()).expect("a small file");
        assert_eq!((access.size(), access.is_whole()), (len as u64, true));
        assert_eq!(read(&access, 1, len - 1).expect("kept"), file.bytes[1..]);
        assert_eq!(server.requests(), requests);
    }
    let file = Served::new(4097);
    let server = Server::start(move |_| file.whole());
    let large = fault(HttpAccess::open(&server.address(""), quick()));
    assert_eq!((large.kind, server.requests()), (FaultKind::Ranges, 1), "{large}");
    assert!(large.why.contains("4097 bytes") && large.why.contains("range requests"), "{large}");

    // Later: the same version is fetched once, by whoever comes first.
    let (file, ranges) = (Served::new(4000), AtomicUsize::new(0));
    let served = file.clone();
    let server = Server::start(move |a| match ranges.fetch_add(1, SeqCst) {
        0 => served.right(a),
        _ => served.whole(),
    });
    let access = Arc::new(HttpAccess::open(&server.address(""), quick()).expect("a file"));
    assert!(!access.is_whole());
    thread::scope(|scope| {
        for n in 0..8 {
            let (access, file) = (&access, &file);
            scope.spawn(move || {
                assert_eq!(read(access, 100 * n, 90).expect("a part"), file.bytes[100 * n as usize..][..90])
            });
        }
    });
    let wholes = server.asked().iter().filter(|a| a.range.is_none()).count();
    assert_eq!((access.is_whole(), wholes), (true, 1));
    let before = server.requests();
    assert_eq!(read(&access, 3999, 1).expect("kept"), file.bytes[3999..]);
    assert_eq!(server.requests(), before);

    let (_, server) = wrong_at(1, true, |f, _| f.whole());
    let access = HttpAccess::open(&server.address(""), quick()).expect("a file");
    let large = read(&access, 500, 100).expect_err("too large for each patch");
    assert_eq!((large.kind, server.requests()), (FaultKind::Ranges, 2), "{large}");
    assert!(access.stats().bytes < 200, "the body was left alone: {:?}", access.stats());
}

#[test]
fn bodies_without_end_take_bounded_memory() {
    let chunk = [b"1000\r\n".as_slice(), &[7; 0x1000], b"\r\n"].concat();
    let endless = chunk.repeat(64);
    let file = Served::new(10);
    let server = Server::start(move |_| file.answer("200 OK", "Transfer-Encoding: chunked\r\n", &endless, After::Hang));
    let large = fault(HttpAccess::open(&server.address(""), quick()));
    assert_eq!(large.kind, FaultKind::Ranges, "{large}");

    let file = Served::new(10);
    let lie = format!("Content-Length: {}\r\n", u64::MAX / 2);
    let server = Server::start(move |_| file.answer("200 OK", &lie, b"0123456789", After::Hang));
    let large = fault(HttpAccess::open(&server.address(""), quick()));
    assert_eq!((large.kind, server.requests()), (FaultKind::Ranges, 1), "{large}");

    // A file that is said to be huge costs nothing until it comes.
    let (_, server) = wrong_at(0, false, |f, _| f.part_named((0, 63), "bytes 0-63/18446744073709551615", After::Keep));
    let access = HttpAccess::open(&server.address(""), quick()).expect("a file");
    assert_eq!(access.size(), u64::MAX);
    assert_eq!(once(&access, 1 << 60, 10).expect_err("nothing there").kind, FaultKind::Changed);
}

#[test]
fn unchunked_lengths_may_be_unknown() {
    let file = Served::new(300);
    let body = [b"12c\r\n".as_slice(), &file.bytes, b"\r\n0\r\n\r\n"].concat();
    let served = file.clone();
    let server = Server::start(move |_| served.answer("200 OK", "Transfer-Encoding: chunked\r\n", &body, After::Keep));
    let access = HttpAccess::open(&server.address(""), quick()).expect("a file");
    assert_eq!(access.size(), 300);
    assert_eq!(read(&access, 0, 300).expect("kept"), file.bytes);
}

#[test]
fn a_server_that_wants_to_be_left_alone_is() {
    let (file, server) = wrong_at(1, false, |f, _| f.status("503 Service Unavailable", "Retry-After: 3600\r\n"));
    let options = HttpOptions { longest_pause: Duration::from_secs(2), ..quick() };
    let access = HttpAccess::open(&server.address(""), options).expect("a file");
    for _ in 0..3 {
        assert_eq!(once(&access, 500, 9).expect_err("busy").kind, FaultKind::Busy);
    }
    assert_eq!(server.requests(), 2, "only the first of the three was sent");
    assert_eq!(read(&access, 500, 9).expect("after the longest pause"), file.bytes[500..509]);
    assert_eq!(server.requests(), 3);
}

#[test]
fn redirections_are_remembered_until_they_expire() {
    let file = Served::new(SIZE);
    let served = file.clone();
    let server = Server::start(move |a| {
        let target = if a.number < 5 { "/first" } else { "/second" };
        match a.path.as_str() {
            "/start" => served.status("302 Found", &format!("Location: {target}\r\n")),
            path if path == target => served.right(a),
            _ => served.status("403 Forbidden", ""),
        }
    });
    let access = HttpAccess::open(&server.address("start"), quick()).expect("a file");
    for at in [100, 200, 300, 400] {
        assert_eq!(read(&access, at, 50).expect("a part"), file.bytes[at as usize..][..50]);
    }
    let paths: Vec<String> = server.asked().into_iter().map(|a| a.path).collect();
    let expected = ["/start", "/first", "/first", "/first", "/first", "/first", "/start", "/second"];
    assert_eq!(paths, expected);

    let file = Served::new(SIZE);
    let server = Server::start(move |_| file.status("302 Found", "Location: /again\r\n"));
    assert_eq!(fault(HttpAccess::open(&server.address(""), quick())).kind, FaultKind::Protocol, "in a circle");
}

#[test]
fn less_than_was_asked_for_is_asked_for_again() {
    let (file, server) = wrong_at(1, true, |f, a| {
        let (first, last) = a.range.expect("a range");
        f.part((first, last.min(first + 29)))
    });
    let access = HttpAccess::open(&server.address(""), quick()).expect("a file");
    assert_eq!(once(&access, 500, 100).expect("in four"), file.bytes[500..600]);
    assert_eq!(server.requests(), 1 + 4);
    let fault = once(&access, 500, 1000).expect_err("in eight");
    assert_eq!((fault.kind, server.requests()), (FaultKind::Short, 1 + 4 + 8), "{fault}");
}

#[test]
fn ends_of_files() {
    let file = Served::new(0);
    let server = Server::start(move |_| file.status("416 Range Not Satisfiable", "Content-Range: bytes */0\r\n"));
    let empty = HttpAccess::open(&server.address(""), quick()).expect("an empty file");
    assert_eq!(empty.size(), 0);
    assert!(read(&empty, 0, 0).is_ok());

    let (_, server) = wrong_at(usize::MAX, false, |f, a| f.right(a));
    let access = HttpAccess::open(&server.address(""), quick()).expect("a file");
    for (at, len) in [(SIZE as u64, 1), (SIZE as u64 - 1, 2), (u64::MAX, 1), (u64::MAX, 0), (0, SIZE + 1)] {
        assert_eq!(read(&access, at, len).expect_err("beyond the end").kind, FaultKind::Short, "{at}, {len}");
    }
    assert!(read(&access, SIZE as u64, 0).is_ok());
    assert_eq!(server.requests(), 1);
}

#[test]
fn waiting_can_be_ended() {
    let (file, server) = wrong_at(1, false, |_, _| Reply(Vec::new(), After::Hang));
    let options = HttpOptions { silence: Duration::from_secs(3600), ..quick() };
    let access = Arc::new(HttpAccess::open(&server.address(""), options).expect("a file"));
    let waiting = Arc::clone(&access);
    let kind = within_a_minute(move || {
        let reading = thread::spawn(move || once(&waiting, 500, 9).expect_err("interrupted").kind);
        while server.requests() < 2 {
            thread::sleep(Duration::from_millis(1));
        }
        access.interrupt();
        assert_eq!(read(&access, 500, 9).expect("later"), file.bytes[500..509]);
        reading.join().expect("no panic")
    });
    assert_eq!(kind, FaultKind::Unreachable);
}

#[test]
fn locations_are_files_or_addresses() {
    let (_, server) = wrong_at(usize::MAX, false, |f, a| f.right(a));
    let upper = server.address("x").replace("http", "HTTP");
    for location in [&server.address("x"), &upper] {
        assert_eq!(open(location).expect("an address").size(), SIZE as u64, "{location}");
    }
    let here = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
    assert_eq!(open(here).expect("a file").size(), std::fs::metadata(here).expect("a file").len());
    assert!(matches!(open("no/such/file"), Err(Error::Io { .. })));
    // An http server behind https: the handshake fails, and says so.
    let secure = server.address("x").replace("http", "https");
    assert!(matches!(HttpAccess::open(&secure, quick()), Err(Error::Stream(_))));
}
