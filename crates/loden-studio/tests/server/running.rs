//! A server in this process, and a client that can send anything.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use loden::progress::{Progress, Silent};
use loden::{acquire, job};
use loden_studio::{Config, serve};
use serde_json::Value;
use tempfile::TempDir;

/// Largest upload in these tests, bytes.
pub const LIMIT: u64 = 16 << 20;

/// A small measurement.
pub fn twill() -> &'static Path {
    static MADE: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("twill.zip");
        let options = acquire::Options { size: 8, spp: 1, ..acquire::Options::default() };
        job::built_in("twill", &options, &path, &Silent).unwrap();
        (folder, path)
    });
    &made.1
}

struct Stop(AtomicBool);

impl Progress for Stop {
    fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// A server with a folder of its own, in which is the measurement; outside of it is another file.
pub struct Running {
    pub all: TempDir,
    pub port: u16,
    pub token: String,
    stop: Arc<Stop>,
    thread: Option<JoinHandle<loden::Result<()>>>,
}

pub struct Reply {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Reply {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&self.body)))
    }

    pub fn read(mut stream: TcpStream) -> Self {
        let mut bytes = Vec::new();
        // a server that refuses may close before it has read all
        let _ = stream.read_to_end(&mut bytes);
        let at = bytes.windows(4).position(|w| w == b"\r\n\r\n").expect("a head");
        let head = String::from_utf8_lossy(&bytes[..at]).to_ascii_lowercase();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Self { status, head, body: bytes[at + 4..].to_vec() }
    }
}

impl Running {
    pub fn new() -> Self {
        let all = tempfile::tempdir().unwrap();
        let inside = all.path().join("inside");
        std::fs::create_dir(&inside).unwrap();
        std::fs::copy(twill(), inside.join("twill.zip")).unwrap();
        std::fs::copy(twill(), all.path().join("secret.zip")).unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(all.path().join("secret.zip"), inside.join("link.zip")).unwrap();
        let config = Config { materials: vec![inside], output: None, port: 0, upload_limit: LIMIT };
        let stop = Arc::new(Stop(AtomicBool::new(false)));
        let (told, address) = mpsc::channel();
        let stopper = stop.clone();
        let thread = std::thread::spawn(move || {
            serve(&config, &*stopper, &mut |address: &str| told.send(address.to_owned()).unwrap())
        });
        let address = address.recv().unwrap();
        let port = address.trim_end_matches('/').rsplit(':').next().unwrap().parse().unwrap();
        let mut running = Self { all, port, token: String::new(), stop, thread: Some(thread) };
        let page = String::from_utf8(running.get("/").body).unwrap();
        running.token = page.split("name=\"loden-token\" content=\"").nth(1).unwrap()[..64].to_owned();
        running
    }

    pub fn folder(&self) -> PathBuf {
        self.all.path().join("inside")
    }

    pub fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder()).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    pub fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    /// A request with these lines in its head, besides the host unless they name one.
    pub fn ask(&self, method: &str, path: &str, lines: &[&str], body: &[u8]) -> Reply {
        let mut stream = self.connect();
        let mut head = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\n");
        if !lines.iter().any(|line| line.starts_with("Host:")) {
            head += &format!("Host: 127.0.0.1:{}\r\n", self.port);
        }
        if !body.is_empty() {
            head += &format!("Content-Length: {}\r\n", body.len());
        }
        lines.iter().for_each(|line| head += &format!("{line}\r\n"));
        stream.write_all(format!("{head}\r\n").as_bytes()).unwrap();
        let _ = stream.write_all(body);
        Reply::read(stream)
    }

    pub fn get(&self, path: &str) -> Reply {
        self.ask("GET", path, &[], &[])
    }

    pub fn send(&self, method: &str, path: &str, value: &Value) -> Reply {
        let token = format!("X-Loden-Token: {}", self.token);
        self.ask(method, path, &["Content-Type: application/json", &token], value.to_string().as_bytes())
    }

    pub fn upload(&self, name: &str, content: &[u8]) -> Reply {
        self.ask("POST", &format!("/api/upload?name={name}"), &[&format!("X-Loden-Token: {}", self.token)], content)
    }

    /// The job when it has ended.
    pub fn ended(&self, id: u64) -> Value {
        let began = Instant::now();
        loop {
            let jobs = self.get("/api/jobs").json();
            let job = jobs.as_array().unwrap().iter().find(|job| job["id"] == id).unwrap().clone();
            if job["phase"] != "queued" && job["phase"] != "running" {
                return job;
            }
            assert!(began.elapsed() < Duration::from_secs(60), "{job}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.0.store(true, Ordering::Relaxed);
        let ended = self.thread.take().unwrap().join();
        if !std::thread::panicking() {
            ended.unwrap().unwrap();
        }
    }
}
