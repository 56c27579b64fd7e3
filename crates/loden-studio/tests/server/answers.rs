//! What the server answers, compared with the library.

use loden::btf::{BtfSource, Texels};
use loden::{codec, import, job};
use serde_json::json;

use crate::running::{Running, twill};

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
