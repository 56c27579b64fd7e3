//! New materials: the same that the library makes, and pictures of them while they are made.

use glam::Vec3;
use loden::btf::BtfSource;
use loden::codec::{self, CompressedBtf};
use loden::direction::from_angles;
use loden::generate::{Keep, Match};
use loden::job::{self, BlendRequest, ExchangeRequest};
use loden::params::Given;
use loden::picture::Picture;
use loden::progress::Silent;
use serde_json::{Value, json};

use crate::running::Running;

/// The server with a material in rows, made from the measurement by the page's own request.
fn with_rows() -> Running {
    let server = Running::new();
    let request = json!({
        "kind": "compress", "material": "0/twill.zip", "method": "kmeans", "params": { "clusters": "6" }, "goal": null, "name": "rows.loden",
    });
    server.made(&request);
    server
}

impl Running {
    /// Runs a job that must succeed.
    fn made(&self, request: &Value) -> Value {
        let started = self.send("POST", "/api/jobs", request);
        assert_eq!(started.status, 200, "{}", String::from_utf8_lossy(&started.body));
        let done = self.ended(started.json()["id"].as_u64().unwrap());
        assert_eq!(done["phase"], "done", "{done}");
        done
    }

    fn opened(&self, name: &str) -> std::sync::Arc<CompressedBtf> {
        codec::open(self.folder().join(name)).unwrap()
    }
}

/// The image that the page shows of a material: from the front, lit from the side.
fn front(source: &dyn BtfSource) -> Vec<u8> {
    let (view, light) = source.meta().nearest_pair(from_angles(45f32.to_radians(), 120f32.to_radians()), Vec3::Z);
    job::stored_picture(source.meta(), &source.image(view, light).unwrap().to_f32()).to_srgb8()
}

const NEUTRAL: &str = r#"{ "hue": 0, "saturation": 1, "gloss": 1, "highlights": 1, "contrast": 1, "exposure": 0 }"#;

fn edit(on: &Value, more: &Value) -> Value {
    let mut request: Value = serde_json::from_str(NEUTRAL).unwrap();
    for (name, value) in more.as_object().unwrap() {
        request[name] = value.clone();
    }
    request["material"] = json!("0/rows.loden");
    request["on"] = on.clone();
    request
}

#[test]
fn painted_texels_change_and_the_preview_is_what_the_file_shows() {
    let server = with_rows();
    // the left half of 8 x 8 texels
    let runs: Vec<usize> = std::iter::once(0).chain([4; 16]).collect();
    let mask = json!({ "mask": { "width": 8, "height": 8, "runs": runs } });
    let mut request = edit(&mask, &json!({ "exposure": 1.0, "hue": 90.0 }));
    let preview = server.send("POST", "/api/preview", &request);
    assert_eq!(preview.status, 200, "{}", String::from_utf8_lossy(&preview.body));
    request["kind"] = json!("edit");
    request["name"] = json!("half.loden");
    let done = server.made(&request);
    let mask = server.folder().join("half-mask.png");
    let command = format!("--recolor hue=90,saturation=1 --exposure 1 --mask {} -o ", mask.display());
    assert!(done["command"].as_str().unwrap().contains(&command), "{done}");
    assert_eq!(
        Picture::read(&mask, &mut Vec::new()).unwrap().to_srgb8()[..15],
        [[255; 12].as_slice(), &[0; 3]].concat()
    );
    let (before, after) = (server.opened("rows.loden"), server.opened("half.loden"));
    let (before, after) = (front(&*before), front(&*after));
    assert_eq!(preview.body, after);
    for (texel, (a, b)) in before.chunks_exact(3).zip(after.chunks_exact(3)).enumerate() {
        assert_eq!(a != b, texel % 8 < 4, "texel {texel}: {a:?} {b:?}");
    }
    // wrong masks are refused before anything is written
    for runs in [json!([64]), json!([0, 63]), json!([0, 65]), json!([-1, 65])] {
        request["on"]["mask"]["runs"] = runs.clone();
        request["name"] = json!("wrong.loden");
        let status = server.send("POST", "/api/jobs", &request).status;
        assert!([400, 422].contains(&status), "{runs}: {status}");
    }
    // a mask of another size fails in the job, and leaves nothing
    request["on"] = json!({ "mask": { "width": 4, "height": 4, "runs": [0, 16] } });
    let id = server.send("POST", "/api/jobs", &request).json()["id"].as_u64().unwrap();
    assert_eq!(server.ended(id)["phase"], "failed");
    assert_eq!(server.files(), ["half-mask.png", "half.loden", "link.zip", "rows.loden", "twill.zip"]);
}

#[test]
fn rows_and_colours_choose_what_a_texel_shows() {
    let server = with_rows();
    let before = server.opened("rows.loden");
    let texel = server.get("/api/row?m=0/rows.loden&x=3&y=5").json();
    let color = texel["color"].as_str().unwrap();
    let rows = edit(&json!({ "rows": [texel["row"]] }), &json!({ "exposure": 0.5 }));
    let colors = edit(&json!({ "colors": { "center": color, "radius": 1.0 } }), &json!({ "exposure": 0.5 }));
    let original = front(&*before);
    for request in [rows, colors] {
        let shown = server.send("POST", "/api/preview", &request);
        assert_eq!(shown.status, 200, "{}", String::from_utf8_lossy(&shown.body));
        let changed = original.chunks_exact(3).zip(shown.body.chunks_exact(3)).filter(|(a, b)| a != b).count();
        assert_eq!(changed as u64, texel["texels"].as_u64().unwrap(), "{request}");
    }
    assert_eq!(server.get("/api/row?m=0/rows.loden&x=8&y=0").status, 404);
    assert_eq!(server.get("/api/row?m=0/twill.zip&x=0&y=0").status, 400);
    for on in [
        json!({ "rows": [6] }),
        json!({ "colors": { "center": "red", "radius": 1 } }),
        json!({ "colors": { "center": "ff00ff", "radius": 1 } }),
    ] {
        assert_eq!(server.send("POST", "/api/preview", &edit(&on, &json!({ "gloss": 2.0 }))).status, 400, "{on}");
    }
}

#[test]
fn mixtures_are_those_of_the_library_and_steps_show_both_ends() {
    let server = with_rows();
    let other = json!({
        "kind": "compress", "material": "0/twill.zip", "method": "kmeans", "params": { "clusters": "3" }, "goal": null, "name": "other.loden",
    });
    server.made(&other);
    let (first, second) = (server.folder().join("rows.loden"), server.folder().join("other.loden"));
    let done = server.made(&json!({ "kind": "blend", "first": "0/rows.loden", "second": "0/other.loden", "amount": 0.25, "mask": null, "name": "mixed.loden" }));
    assert!(done["command"].as_str().unwrap().starts_with("loden generate blend "), "{done}");
    let output = server.all.path().join("ours.loden");
    let request = BlendRequest {
        first: first.clone(),
        second: second.clone(),
        options: Given::default(),
        amount: 0.25,
        mask: None,
        clusters: 256,
        output: output.clone(),
    };
    job::blend(&request, &Silent).unwrap();
    assert_eq!(std::fs::read(&output).unwrap(), std::fs::read(server.folder().join("mixed.loden")).unwrap());
    let done = server.made(&json!({ "kind": "steps", "first": "0/rows.loden", "second": "0/other.loden", "count": 3 }));
    assert_eq!((&done["result"]["columns"], &done["pictures"]), (&json!(3), &json!(3)));
    assert_eq!(done["command"].as_str().unwrap().lines().count(), 2);
    let shown = shown(&server, &done);
    assert_eq!((shown.width, shown.height), (3 * 8 + 2 * 4, 8));
    let before = server.opened("rows.loden");
    let bytes = shown.to_srgb8();
    assert_eq!(bytes[..24], front(&*before)[..24]);
    assert_eq!(server.send("POST", "/api/jobs", &json!({ "kind": "blend", "first": "0/rows.loden", "second": "0/other.loden", "amount": 1.5, "mask": null, "name": "a.loden" })).status, 400);
}

/// The last picture of a job.
fn shown(server: &Running, job: &Value) -> Picture {
    let reply = server.get(&format!("/api/jobs/{}/picture", job["id"]));
    assert_eq!(reply.status, 200);
    let path = server.all.path().join("picture.png");
    std::fs::write(&path, &reply.body).unwrap();
    Picture::read(&path, &mut Vec::new()).unwrap()
}

#[test]
fn a_grid_has_every_exchange() {
    let server = with_rows();
    let done = server.made(&json!({ "kind": "grid", "materials": ["0/rows.loden", "0/twill.zip"], "shading": false }));
    assert_eq!((&done["result"]["columns"], &done["pictures"]), (&json!(2), &json!(3)));
    let output = server.all.path().join("ours.loden");
    let request = ExchangeRequest {
        structure: server.folder().join("rows.loden"),
        reflectance: server.folder().join("twill.zip"),
        options: Given::default(),
        by: Match::Transport,
        epsilon: None,
        split: false,
        keep: Keep::Nothing,
        clusters: 256,
        output: output.clone(),
    };
    job::exchange(&request, &Silent).unwrap();
    let ours = codec::open(&output).unwrap();
    let picture = shown(&server, &done);
    let cell = (picture.width - 4) / 2;
    // the second cell of the first row: its pattern, the other reflectance
    let row: Vec<u8> = picture.to_srgb8()[3 * (cell + 4)..3 * (cell + 4 + 8)].to_vec();
    assert_eq!(row, front(&*ours)[..24]);
    assert_eq!(server.files(), ["link.zip", "rows.loden", "twill.zip"]);
    for materials in [json!([]), json!(["0/rows.loden"]), json!(vec!["0/rows.loden"; 6])] {
        assert_eq!(
            server
                .send("POST", "/api/jobs", &json!({ "kind": "grid", "materials": materials, "shading": true }))
                .status,
            400
        );
    }
}

#[test]
fn a_synthesis_is_seen_while_it_grows_and_tells_where_its_texels_come_from() {
    let server = with_rows();
    let request = json!({
        "kind": "synthesize", "material": "0/rows.loden", "method": "efros-leung", "params": {}, "size": [24, 20], "tileable": false, "seed": 1,
        "name": "large.loden",
    });
    let done = server.made(&request);
    assert!(done["pictures"].as_u64().unwrap() >= 1, "{done}");
    let made = server.opened("large.loden");
    let map = made.source_map().unwrap();
    let origins = server.get("/api/origins?m=0/large.loden");
    assert!(origins.head.contains("x-size: 24x20"), "{}", origins.head);
    let expected: Vec<u8> = map.sources.iter().flat_map(|s| [s.x, s.y]).flat_map(u16::to_le_bytes).collect();
    assert_eq!(origins.body, expected);
    assert_eq!(server.get("/api/origins?m=0/rows.loden").status, 404);
    assert_eq!(server.get("/api/material?m=0/large.loden").json()["rearranged"], true);
}
