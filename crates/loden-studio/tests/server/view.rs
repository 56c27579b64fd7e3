//! The 3D view: meshes and surroundings from files.

use glam::Vec3;
use loden::job::{self, Limits, Render, Subject};
use loden::picture::Picture;
use loden::progress::Silent;
use serde_json::{Value, json};

use crate::running::Running;

/// A tetrahedron, not about the origin.
const MESH: &str = "v 5 0 0\nv 7 0 0\nv 6 0 2\nv 6 2 1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n\
                    f 1/1 2/2 3/3\nf 1/1 4/4 2/2\nf 2/2 4/4 3/3\nf 3/3 4/4 1/1\n";

fn with_files() -> Running {
    let server = Running::new();
    assert_eq!(server.upload("solid.obj", MESH.as_bytes()).json(), json!({ "id": "0/solid.obj", "kind": "mesh" }));
    let mut sky = Picture::filled(16, 8, Vec3::splat(0.2));
    sky.rgb[2 * 16 + 8] = Vec3::splat(1.0);
    let reply = server.upload("sky.png", &sky.to_png().unwrap());
    assert_eq!(reply.json(), json!({ "id": "0/sky.png", "kind": "panorama" }));
    let request = json!({
        "kind": "compress", "material": "0/twill.zip", "method": "pvmf", "params": { "components": "2" }, "goal": null, "name": "a.loden",
    });
    let id = server.send("POST", "/api/jobs", &request).json()["id"].as_u64().unwrap();
    assert_eq!(server.ended(id)["phase"], "done");
    server
}

fn look(more: &Value) -> Value {
    let mut look = json!({
        "material": "0/a.loden", "object": "sphere", "position": [0, 0.5, 4], "target": [0, 0, 0], "light": [40, 120], "lighting": "lamp",
        "scale": 2, "size": [24, 16],
    });
    for (name, value) in more.as_object().unwrap() {
        look[name] = value.clone();
    }
    look
}

#[test]
fn meshes_and_surroundings_are_listed_drawn_and_rendered() {
    let server = with_files();
    let extras = server.get("/api/extras").json();
    assert_eq!(extras["meshes"], json!([{ "id": "0/solid.obj", "name": "solid.obj" }]));
    assert_eq!(extras["panoramas"], json!([{ "id": "0/sky.png", "name": "sky.png" }]));
    // moved to the origin and scaled to radius 1
    let object = server.get("/api/object?name=0/solid.obj").json();
    assert!((object["radius"].as_f64().unwrap() - 1.0).abs() < 0.01, "{object}");
    let mesh = server.get("/api/mesh?name=0/solid.obj").body;
    let vertices = u32::from_le_bytes(mesh[..4].try_into().unwrap()) as usize;
    let number = |k: usize| f32::from_le_bytes(mesh[8 + 4 * k..12 + 4 * k].try_into().unwrap());
    let farthest = (0..vertices).map(|k| Vec3::new(number(3 * k), number(3 * k + 1), number(3 * k + 2)).length());
    assert!((farthest.fold(0.0, f32::max) - 1.0).abs() < 0.01);
    // the scene file draws the same mesh where the page has it
    let scene = server.send("POST", "/api/scene", &look(&json!({ "object": "0/solid.obj" })));
    let text = String::from_utf8(scene.body).unwrap();
    assert!(text.contains("kind = \"mesh\"") && text.contains("solid.obj"), "{text}");
    let covered = |text: &str| {
        let path = server.all.path().join("scene.toml");
        std::fs::write(&path, text).unwrap();
        let subject = Subject::Scene { file: path, texture_samples: None, world: None, shadows: None };
        let render = Render {
            subject,
            size: None,
            spp: Some(4),
            depth: None,
            seed: 0,
            denoise: false,
            limits: Limits::default(),
            memory: None,
            scratch: ".".into(),
        };
        let picture = job::render(&render, &Silent).unwrap().rendered.picture;
        picture.rgb.iter().filter(|c| (c.x - 0.0232).abs() > 1e-4).count()
    };
    assert!((15..250).contains(&covered(&text)), "{} of 384 pixels", covered(&text));
    // surroundings in the place of the lamp
    let scene = server.send("POST", "/api/scene", &look(&json!({ "surroundings": "0/sky.png", "turn": 30 })));
    let text = String::from_utf8(scene.body).unwrap();
    assert!(text.contains("[environment]\nfile = ") && text.contains("rotation = 30.0"), "{text}");
    assert!(!text.contains("[[light]]") && !text.contains("background"), "{text}");
    assert_eq!(covered(&text), 384);
    for wrong in [
        json!({ "surroundings": "0/twill.zip" }),
        json!({ "surroundings": "0/../sky.png" }),
        json!({ "object": "0/a.loden" }),
    ] {
        let status = server.send("POST", "/api/scene", &look(&wrong)).status;
        assert!([400, 404].contains(&status), "{wrong}: {status}");
    }
    let job = json!({ "kind": "picture", "look": look(&json!({ "surroundings": "0/sky.png" })), "spp": 4 });
    let id = server.send("POST", "/api/jobs", &job).json()["id"].as_u64().unwrap();
    let done = server.ended(id);
    assert_eq!((&done["phase"], &done["pictures"]), (&json!("done"), &json!(2)), "{done}");
}

#[test]
fn lights_stand_for_surroundings() {
    let server = with_files();
    let lights = server.get("/api/lights?e=0/sky.png&count=5").json();
    let lights = lights.as_array().unwrap();
    assert_eq!(lights.len(), 5);
    let sum: f64 = lights.iter().map(|light| light["irradiance"][0].as_f64().unwrap()).sum();
    let even = 0.2 * 4.0 * std::f64::consts::PI;
    assert!(sum > even && sum < 1.2 * even, "{sum} is not a little more than {even}");
    let backdrop = server.get("/api/backdrop?e=0/sky.png");
    assert!(backdrop.head.contains("content-type: image/png") && backdrop.body.starts_with(b"\x89PNG"));
    assert_eq!(server.get("/api/backdrop?e=0/solid.obj").status, 404);
}
