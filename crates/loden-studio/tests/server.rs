//! The server as its clients meet it: what it answers, and what it refuses.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use loden::btf::{BtfSource, Texels};
use loden::progress::{Progress, Silent};
use loden::{acquire, codec, import, job};
use loden_studio::{Config, serve};
use serde_json::{Value, json};
use tempfile::TempDir;

/// Largest upload in these tests, bytes.
const LIMIT: u64 = 16 << 20;

/// A small measurement.
fn twill() -> &'static Path {
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
struct Running {
    all: TempDir,
    port: u16,
    token: String,
    stop: Arc<Stop>,
    thread: Option<JoinHandle<loden::Result<()>>>,
}

struct Reply {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Reply {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&self.body)))
    }

    fn read(mut stream: TcpStream) -> Self {
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
    fn new() -> Self {
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

    fn folder(&self) -> PathBuf {
        self.all.path().join("inside")
    }

    fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder()).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    /// A request with these lines in its head, besides the host unless they name one.
    fn ask(&self, method: &str, path: &str, lines: &[&str], body: &[u8]) -> Reply {
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

    fn get(&self, path: &str) -> Reply {
        self.ask("GET", path, &[], &[])
    }

    fn send(&self, method: &str, path: &str, value: &Value) -> Reply {
        let token = format!("X-Loden-Token: {}", self.token);
        self.ask(method, path, &["Content-Type: application/json", &token], value.to_string().as_bytes())
    }

    fn upload(&self, name: &str, content: &[u8]) -> Reply {
        self.ask("POST", &format!("/api/upload?name={name}"), &[&format!("X-Loden-Token: {}", self.token)], content)
    }

    /// The job when it has ended.
    fn ended(&self, id: u64) -> Value {
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

#[test]
fn images_are_the_stored_values() {
    let server = Running::new();
    let source = import::open(twill(), &Default::default()).unwrap();
    let list = server.get("/api/materials").json();
    let ids: Vec<&str> = list["materials"].as_array().unwrap().iter().map(|one| one["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["0/twill.zip"]);
    for (view, light) in [(0, 0), (40, 17), (80, 80)] {
        let reply = server.get(&format!("/api/image?m=0/twill.zip&view={view}&light={light}"));
        assert_eq!(reply.status, 200);
        assert!(reply.head.contains("x-size: 8x8"), "{}", reply.head);
        let Texels::U8(values) = source.image(view, light).unwrap() else { panic!("8 bits are expected") };
        assert_eq!(reply.body, *values);
        let texel = server.get(&format!("/api/texel?m=0/twill.zip&view={view}&light={light}&x=5&y=2")).json();
        let expected = f32::from(values[3 * (2 * 8 + 5)]) / 255.0;
        assert!((texel["value"][0].as_f64().unwrap() - f64::from(expected)).abs() < 1e-6, "{texel}");
        assert_eq!(texel["lights"].as_array().unwrap().len(), 81);
    }
    for wrong in
        ["view=81&light=0", "view=0&light=81", "view=-1&light=0", "view=0", "view=0&light=99999999999999999999"]
    {
        let status = server.get(&format!("/api/image?m=0/twill.zip&{wrong}")).status;
        assert!([400, 404].contains(&status), "{wrong}: {status}");
    }
}

#[test]
fn paths_outside_are_not_found() {
    let server = Running::new();
    let absolute = server.all.path().join("secret.zip");
    for id in [
        "0/../secret.zip",
        "0/%2e%2e/secret.zip",
        "0/..%2fsecret.zip",
        "0%2f..%2fsecret.zip",
        "0/%252e%252e/secret.zip",
        "0/link.zip",
        "0//etc/passwd",
        "1/twill.zip",
        "",
        "0/twill.zip%00",
        absolute.to_str().unwrap(),
    ] {
        for what in ["image", "material", "thumbnail", "file", "texel", "three", "single"] {
            let reply = server.get(&format!("/api/{what}?m={id}&view=0&light=0&x=0&y=0"));
            assert!([400, 404].contains(&reply.status), "{what} {id}: {}", reply.status);
        }
    }
    for path in
        ["/../../etc/passwd", "/%2e%2e/app.js", "/three/../../x", "/three/0000000000000000/material.js", "/nothing"]
    {
        assert!([400, 404].contains(&server.get(path).status), "{path}");
    }
    assert_eq!(server.get("/api/file?m=0/twill.zip").body, std::fs::read(twill()).unwrap());
}

#[test]
fn others_are_refused() {
    let server = Running::new();
    let port = server.port;
    for lines in [
        vec!["Host: evil.example".to_owned()],
        vec![format!("Host: evil.example:{port}")],
        vec![format!("Host: 127.0.0.1:{}", port ^ 1)],
        vec!["Origin: http://evil.example".into()],
        vec!["Sec-Fetch-Site: cross-site".into()],
    ] {
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        let reply = server.ask("GET", "/api/materials", &lines, &[]);
        assert_eq!(reply.status, 403, "{lines:?}");
        assert!(!String::from_utf8_lossy(&reply.body).contains("twill"));
    }
    let body =
        json!({ "kind": "acquire", "sample": "twill", "params": {}, "size": 8, "spp": 1, "seed": 0, "name": "a.zip" });
    let kind = "Content-Type: application/json";
    for token in ["X-Other: 1", "X-Loden-Token: ", "X-Loden-Token: 00"] {
        assert_eq!(server.ask("POST", "/api/jobs", &[kind, token], body.to_string().as_bytes()).status, 403);
        assert_eq!(server.ask("POST", "/api/upload?name=a.zip", &[token], b"PK").status, 403);
    }
    assert!(server.get("/api/jobs").json().as_array().unwrap().is_empty());
    assert_eq!(server.files(), ["link.zip", "twill.zip"]);
    let page = server.get("/");
    for line in
        ["content-security-policy: default-src 'none'", "x-content-type-options: nosniff", "frame-ancestors 'none'"]
    {
        assert!(page.head.contains(line), "{}", page.head);
    }
    assert!(!page.head.contains("unsafe-inline") && !page.head.contains("access-control"));
}

#[test]
fn uploads_are_limited_and_only_materials_stay() {
    let server = Running::new();
    let token = format!("X-Loden-Token: {}", server.token);
    // only the length of ten gigabytes is sent
    let reply = server.ask("POST", "/api/upload?name=big.zip", &[&token, "Content-Length: 10000000000"], &[]);
    assert_eq!(reply.status, 413, "{}", reply.head);
    // without a length
    let mut stream = server.connect();
    let head = format!(
        "POST /api/upload?name=big.zip HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{token}\r\nTransfer-Encoding: chunked\r\nConnection: close\r\n\r\n",
        server.port
    );
    stream.write_all(head.as_bytes()).unwrap();
    let chunk = [b"10000\r\n".as_slice(), &[0; 0x10000], b"\r\n"].concat();
    // the server answers before it has read all
    stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    while stream.write_all(&chunk).is_ok() && stream.peek(&mut [0]).is_err() {}
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let reply = Reply::read(stream);
    assert_eq!(reply.status, 413, "{}", reply.head);
    // no materials, names that lead elsewhere, names that are taken, kinds that name other files
    for (name, content) in [
        ("damaged.zip", b"PK\x03\x04 and nothing else".as_slice()),
        ("damaged.loden", b"{}"),
        ("..%2fout.zip", b"PK"),
        ("%2ftmp%2fout.zip", b"PK"),
        (".hidden.zip", b"PK"),
        ("twill.zip", b"PK"),
        ("set.toml", b"loden_images = 1"),
        ("bomb.zip", &bomb()),
        ("forged.zip", &forged()),
    ] {
        let reply = server.upload(name, content);
        assert!([400, 409, 422].contains(&reply.status), "{name}: {}", reply.status);
        assert!(reply.json()["error"]["message"].as_str().unwrap().len() > 10);
    }
    assert_eq!(server.files(), ["link.zip", "twill.zip"]);
    let reply = server.upload("more.zip", &std::fs::read(twill()).unwrap());
    assert_eq!((reply.status, reply.json()["id"].as_str()), (200, Some("0/more.zip")));
    assert_eq!(server.files(), ["link.zip", "more.zip", "twill.zip"]);
}

/// Archives in the Bonn layout of one picture: zeros that pack a thousand times smaller, and a head that claims a large picture.
fn bomb() -> Vec<u8> {
    archive(&vec![0; 128 << 20])
}

fn forged() -> Vec<u8> {
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    png.extend([0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff, 8, 2, 0, 0, 0, 0, 0, 0, 0]);
    archive(&png)
}

fn archive(content: &[u8]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    zip.start_file("tl000 pl000 tv000 pv000.png", zip::write::SimpleFileOptions::default()).unwrap();
    zip.write_all(content).unwrap();
    zip.finish().unwrap().into_inner()
}

#[test]
fn jobs_run_and_are_cancelled() {
    let server = Running::new();
    let request = json!({
        "kind": "compress", "material": "0/twill.zip", "method": "pvmf", "params": { "components": "3" }, "goal": null, "name": "a.loden",
    });
    let started = server.send("POST", "/api/jobs", &request);
    assert_eq!(started.status, 200, "{}", String::from_utf8_lossy(&started.body));
    // the name is taken while the job runs and afterwards
    assert_eq!(server.send("POST", "/api/jobs", &request).status, 409);
    let done = server.ended(started.json()["id"].as_u64().unwrap());
    assert_eq!(done["phase"], "done", "{done}");
    assert!(done["command"].as_str().unwrap().contains("--method pvmf --components 3 -o "), "{done}");
    assert_eq!(server.send("POST", "/api/jobs", &request).status, 409);
    let compressed = codec::open(server.folder().join("a.loden")).unwrap();
    let shown = server.get("/api/material?m=0/a.loden").json();
    assert_eq!(shown["error"].as_f64(), compressed.error().map(|report| report.mean_abs_error));
    assert_eq!(shown["source"], "twill.zip");
    let texels = compressed.image(3, 7).unwrap().to_f32().into_owned();
    let expected = job::stored_picture(compressed.meta(), &texels).to_srgb8();
    assert_eq!(server.get("/api/image?m=0/a.loden&view=3&light=7").body, expected);
    let difference = server.get("/api/difference?m=0/twill.zip&with=0/a.loden&view=3&light=7");
    assert!(difference.status == 200 && difference.head.contains("x-mean: 0.0"), "{}", difference.head);
    let planes = server.get("/api/parts?m=0/a.loden").json();
    assert!(planes.as_array().unwrap().iter().any(|plane| plane["count"] == 3), "{planes}");
    assert_eq!(server.get("/api/part?m=0/a.loden&plane=0&component=2").body.len(), 3 * 64);
    assert_eq!(server.get("/api/part?m=0/a.loden&plane=0&component=3").status, 404);
    // long work is cancelled and leaves nothing
    let long = json!({ "kind": "acquire", "sample": "twill", "params": {}, "size": 64, "spp": 2000, "seed": 0, "name": "b.zip" });
    let id = server.send("POST", "/api/jobs", &long).json()["id"].as_u64().unwrap();
    assert_eq!(server.send("DELETE", &format!("/api/jobs/{id}"), &json!({})).status, 409);
    server.send("POST", &format!("/api/jobs/{id}/cancel"), &json!({}));
    assert_eq!(server.ended(id)["phase"], "cancelled");
    assert_eq!(server.files(), ["a.loden", "link.zip", "twill.zip"]);
    // a list survives, an entry goes when it is told to
    assert_eq!(server.send("DELETE", &format!("/api/jobs/{id}"), &json!({})).status, 200);
    assert_eq!(server.get("/api/jobs").json().as_array().unwrap().len(), 1);
    for wrong in [
        json!({ "kind": "compress", "material": "0/../secret.zip", "method": "pvmf", "params": {}, "goal": null, "name": "c.loden" }),
        json!({ "kind": "compress", "material": "0/twill.zip", "method": "none", "params": {}, "goal": null, "name": "c.loden" }),
        json!({ "kind": "compress", "material": "0/twill.zip", "method": "pvmf", "params": { "components": "-1" }, "goal": null, "name": "c.loden" }),
        json!({ "kind": "compress", "material": "0/twill.zip", "method": "pvmf", "params": {}, "goal": null, "name": "../c.loden" }),
        json!({ "kind": "shell", "command": "true" }),
    ] {
        let status = server.send("POST", "/api/jobs", &wrong).status;
        assert!((400..500).contains(&status), "{wrong}: {status}");
    }
}

#[test]
fn many_clients_at_once_and_slow_ones_are_served() {
    let server = Running::new();
    // heads that never end hold connections, but no one else
    let slow: Vec<TcpStream> = (0..20)
        .map(|_| {
            let mut stream = server.connect();
            stream.write_all(b"GET /api/jobs HTTP/1.1\r\nHost: 127").unwrap();
            stream
        })
        .collect();
    let expected = server.get("/api/image?m=0/twill.zip&view=5&light=6").body;
    std::thread::scope(|scope| {
        for client in 0..200 {
            let (server, expected) = (&server, &expected);
            scope.spawn(move || {
                assert_eq!(server.get("/api/image?m=0/twill.zip&view=5&light=6").body, *expected, "{client}");
            });
        }
    });
    drop(slow);
    assert_eq!(server.get("/api/jobs").status, 200);
}
