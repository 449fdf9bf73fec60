//! nginx, with a configuration of its own in a folder of its own, on a port that nobody has.

use std::fs;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

pub struct Nginx {
    folder: PathBuf,
    port: u16,
    running: Option<Child>,
}

impl Nginx {
    /// Serves `folder`, where its own files go too.
    pub fn start(folder: &Path) -> Nginx {
        // Another process may take the port in between.
        for _ in 0..5 {
            let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a port").port();
            let mut nginx = Nginx { folder: folder.to_owned(), port, running: None };
            if nginx.restart() {
                return nginx;
            }
        }
        panic!("nginx does not start: {}", fs::read_to_string(folder.join("error.log")).unwrap_or_default());
    }

    /// Starts it again on the same port; whether it answers.
    pub fn restart(&mut self) -> bool {
        self.stop();
        let (root, port) = (self.folder.display(), self.port);
        let configuration = format!(
            "daemon off; master_process off; pid {root}/nginx.pid; error_log {root}/error.log;\n\
             events {{ worker_connections 256; }}\n\
             http {{ log_format one '$connection $status $body_bytes_sent'; access_log {root}/access.log one;\n\
             client_body_temp_path {root}/t1; proxy_temp_path {root}/t2; fastcgi_temp_path {root}/t3;\n\
             uwsgi_temp_path {root}/t4; scgi_temp_path {root}/t5; keepalive_requests 1000000; tcp_nodelay on;\n\
             server {{ listen 127.0.0.1:{port}; root {root}; }} }}\n"
        );
        fs::write(self.folder.join("nginx.conf"), configuration).expect("a configuration");
        let place =
            ["/usr/sbin/nginx", "/usr/local/sbin/nginx", "/usr/bin/nginx"].into_iter().find(|p| Path::new(p).exists());
        let started = Command::new(place.unwrap_or("nginx"))
            .args([&format!("-p{root}"), "-c", &format!("{root}/nginx.conf"), "-e", &format!("{root}/error.log")])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        let mut child = started.unwrap_or_else(|e| panic!("nginx is missing, ./x setup installs it: {e}"));
        for _ in 0..2000 {
            if child.try_wait().expect("its state").is_some() {
                return false;
            }
            if TcpStream::connect(("127.0.0.1", port)).is_ok() {
                self.running = Some(child);
                return true;
            }
            thread::sleep(Duration::from_millis(5));
        }
        let _ = child.kill().and_then(|()| child.wait());
        panic!("nginx runs, and does not answer");
    }

    /// At once; connections are cut.
    pub fn stop(&mut self) {
        if let Some(mut child) = self.running.take() {
            child.kill().and_then(|()| child.wait()).expect("nginx ends");
        }
    }

    pub fn address(&self, file: &str) -> String {
        format!("http://127.0.0.1:{}/{file}", self.port)
    }

    /// Connection and status of every request that it has written down.
    pub fn log(&self) -> Vec<(u64, u16)> {
        let log = fs::read_to_string(self.folder.join("access.log")).unwrap_or_default();
        let line = |l: &str| {
            let mut words = l.split(' ');
            Some((words.next()?.parse().ok()?, words.next()?.parse().ok()?))
        };
        log.lines().filter_map(line).collect()
    }
}

impl Drop for Nginx {
    fn drop(&mut self) {
        self.stop();
    }
}
