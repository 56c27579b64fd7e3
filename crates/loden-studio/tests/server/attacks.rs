//! What the server refuses, and what does not stop it.

use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use glam::Vec3;
use loden::picture::Picture;
use serde_json::json;

use crate::running::{Reply, Running, twill};

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
        for what in ["image", "material", "thumbnail", "file", "texel", "three", "single", "origins", "row", "parts"] {
            let reply = server.get(&format!("/api/{what}?m={id}&view=0&light=0&x=0&y=0"));
            assert!([400, 404].contains(&reply.status), "{what} {id}: {}", reply.status);
        }
        for what in ["object", "mesh", "lights", "backdrop"] {
            let reply = server.get(&format!("/api/{what}?name={id}&e={id}"));
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
        ("damaged.obj", b"v 0 0\nf 1 2 99999"),
        ("square.png", &square()),
        ("elsewhere.glb", &glb("../secret.zip")),
        ("elsewhere.gltf", b"{}"),
        ("bomb.zip", &bomb()),
        ("forged.zip", &forged()),
    ] {
        let reply = server.upload(name, content);
        assert!([400, 403, 409, 422].contains(&reply.status), "{name}: {}", reply.status);
        assert!(reply.json()["error"]["message"].as_str().unwrap().len() > 10);
    }
    assert_eq!(server.files(), ["link.zip", "twill.zip"]);
    let reply = server.upload("more.zip", &std::fs::read(twill()).unwrap());
    assert_eq!((reply.status, reply.json()["id"].as_str()), (200, Some("0/more.zip")));
    assert_eq!(server.files(), ["link.zip", "more.zip", "twill.zip"]);
}

/// A picture that shows no surroundings, and a mesh whose vertices are in another file.
fn square() -> Vec<u8> {
    Picture::filled(4, 4, Vec3::ONE).to_png().unwrap()
}

fn glb(uri: &str) -> Vec<u8> {
    let text = json!({ "asset": { "version": "2.0" }, "buffers": [{ "uri": uri, "byteLength": 8 }] }).to_string();
    let chunk = [&(text.len() as u32).to_le_bytes()[..], b"JSON", text.as_bytes()].concat();
    [&b"glTF"[..], &2u32.to_le_bytes(), &(chunk.len() as u32 + 12).to_le_bytes(), &chunk].concat()
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
fn many_clients_at_once_and_slow_ones_are_served() {
    let server = Running::new();
    // heads that never end hold connections, but no one else
    let mut slow: Vec<TcpStream> = (0..20)
        .map(|_| {
            let mut stream = server.connect();
            stream.write_all(b"GET /api/jobs HTTP/1.1\r\nHost: 127").unwrap();
            stream
        })
        .collect();
    // neither do bodies that never end, nor clients that read nothing
    let head = |line: &str, more: &str| format!("{line} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{more}\r\n", server.port);
    let token = format!("X-Loden-Token: {}\r\nContent-Length: 100000\r\n", server.token);
    for k in 0..20 {
        let mut stream = server.connect();
        let text = match k % 2 {
            0 => head(&format!("POST /api/upload?name=slow{k}.zip"), &token) + "PK",
            _ => head("GET /api/file?m=0/twill.zip", ""),
        };
        stream.write_all(text.as_bytes()).unwrap();
        slow.push(stream);
    }
    let expected = server.get("/api/image?m=0/twill.zip&view=5&light=6").body;
    let (began, before) = (Instant::now(), resident());
    let seconds = if std::env::var_os("LODEN_THOROUGH").is_some() { 30 } else { 2 };
    let served: usize = std::thread::scope(|scope| {
        let client = |client: usize| {
            let (server, expected) = (&server, &expected);
            move || {
                let mut served = 0;
                while served == 0 || began.elapsed() < Duration::from_secs(seconds) {
                    let reply = server.get("/api/image?m=0/twill.zip&view=5&light=6");
                    assert_eq!((reply.status, &reply.body), (200, expected), "{client}");
                    served += 1;
                }
                served
            }
        };
        let all: Vec<_> = (0..200).map(|k| scope.spawn(client(k))).collect();
        all.into_iter().map(|one| one.join().unwrap()).sum()
    });
    assert!(served >= 400, "{served} requests in {:?}", began.elapsed());
    let grown = resident().saturating_sub(before);
    assert!(grown < 256 << 20, "{grown} bytes more after {served} requests");
    drop(slow);
    // what broke off leaves nothing
    let began = Instant::now();
    while server.files().len() > 2 && began.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(server.files(), ["link.zip", "twill.zip"]);
    assert_eq!(server.get("/api/jobs").status, 200);
}

/// Memory of this process, and so of the server, in bytes; 0 where the system does not tell.
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmRSS:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok()).unwrap_or(0) * 1024
}
