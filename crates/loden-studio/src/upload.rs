//! Files dropped on the page: kept in the folder for what is made, if they are materials, meshes or pictures of surroundings.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::body::Body;
use axum::extract::{Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use http_body_util::BodyExt;
use loden::Error;
use loden::import::Measured;
use loden::output::OutputFile;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::time::timeout;

use crate::Studio;
use crate::extras::{PANORAMAS, WHOLE_MESHES, has};
use crate::failure::{Answer, Failure, blocking};

/// Files that hold all of a material, of a mesh or of a picture of surroundings. Those that name other files would read whatever these names say.
const ENDINGS: &[&str] = &[
    "zip",
    "btf",
    "loden",
    "bsdf",
    "pbsdf",
    "binary",
    "astm",
    "brdf",
    "dat",
    "bin",
    "pt",
    "csv",
    "safetensors",
    "mat",
    // for the 3D view
    "obj",
    "ply",
    "glb",
    "hdr",
    "exr",
    "png",
    "jpg",
    "jpeg",
];

/// The longest pause of a client.
const PAUSE: Duration = Duration::from_secs(30);

/// Texels of an image, at most: a small file can unpack to a large one.
const TEXELS: usize = 1 << 24;

/// The largest mesh file: its content is held in memory.
const MESH: u64 = 512 << 20;

#[derive(Deserialize)]
pub(crate) struct Called {
    name: String,
}

/// Stores the body of a request as a file and opens it.
pub(crate) async fn upload(
    State(studio): State<Arc<Studio>>,
    Query(called): Query<Called>,
    headers: HeaderMap,
    body: Body,
) -> Answer<Json<Value>> {
    let limit = studio.upload_limit;
    let too_large = || {
        let problem = format!("the file is larger than {limit} bytes, the limit of this server");
        Failure::new(StatusCode::PAYLOAD_TOO_LARGE, problem)
    };
    let stated = headers.get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
    if stated.is_some_and(|length| length > limit) {
        return Err(too_large());
    }
    let path = studio.folders.new_output(&called.name, ENDINGS)?;
    let file = OutputFile::create(&path)?;
    let (mut received, mut body) = (0u64, body);
    loop {
        let slow = |_| Failure::new(StatusCode::REQUEST_TIMEOUT, "the upload paused for too long");
        let Some(frame) = timeout(PAUSE, body.frame()).await.map_err(slow)? else { break };
        let broken = |_| Failure::new(StatusCode::BAD_REQUEST, "the upload broke off");
        let Ok(data) = frame.map_err(broken)?.into_data() else { continue };
        received += data.len() as u64;
        if received > limit {
            return Err(too_large());
        }
        file.file().write_all(&data).map_err(Error::io(&path))?;
    }
    file.commit()?;
    blocking(move || {
        let checked = check(&studio, &path);
        if checked.is_err() {
            // what is no material is of no use here
            let _ = std::fs::remove_file(&path);
        }
        checked.map(Json)
    })
    .await
}

fn check(studio: &Studio, path: &Path) -> Answer<Value> {
    let id = studio.folders.id(studio.folders.output_number(), path).ok_or_else(|| Failure::missing("such file"))?;
    if has(path, &WHOLE_MESHES) {
        let found = std::fs::metadata(path).map_err(Error::io(path))?.len();
        if found > MESH {
            return Err(Error::Limit { path: path.into(), field: "bytes".into(), found, limit: MESH }.into());
        }
        studio.object(&id)?;
        return Ok(json!({ "id": id, "kind": "mesh" }));
    }
    if has(path, &PANORAMAS) {
        studio.panorama(&id)?;
        return Ok(json!({ "id": id, "kind": "panorama" }));
    }
    let opened = studio.catalogue.open(&studio.folders, path)?;
    let texels = match &opened.measured {
        Measured::Btf(source) => source.meta().texels(),
        Measured::Compressed(compressed) => compressed.meta().texels(),
        Measured::Brdf(_) => 0,
    };
    if texels > TEXELS {
        return Err(large(path, texels).into());
    }
    Ok(json!({ "id": id, "kind": opened.kind }))
}

fn large(path: &Path, found: usize) -> Error {
    Error::Limit { path: path.into(), field: "texels".into(), found: found as u64, limit: TEXELS as u64 }
}
