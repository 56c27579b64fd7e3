//! Compressed materials as node materials for three.js, by the library's exporter.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::Path as FilePath;
use std::sync::{Arc, Mutex};

use axum::Json;
use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use loden::import::Measured;
use loden::progress::Silent;
use loden::{Error, Result, renderers};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use crate::Studio;
use crate::catalogue::{Key, key, lock};
use crate::failure::{Answer, Failure, blocking};
use crate::images::Which;

/// The files that the page asks for, and their types.
const FILES: [(&str, &str); 5] = [
    ("material.js", "text/javascript; charset=utf-8"),
    ("material.json", "application/json"),
    ("numbers.bin", "application/octet-stream"),
    ("indices.bin", "application/octet-stream"),
    ("directions.bin", "application/octet-stream"),
];

/// The page of one file that the exporter writes.
const SINGLE: &str = "index.html";

/// Exported materials, each in a folder of its own below a temporary one.
pub(crate) struct Shaders {
    folder: TempDir,
    made: Mutex<HashMap<Key, String>>,
}

impl Shaders {
    pub fn new() -> Result<Self> {
        let folder = tempfile::tempdir().map_err(Error::io(std::env::temp_dir()))?;
        Ok(Self { folder, made: Mutex::default() })
    }

    /// The name of the folder of a compressed material, which is made at first.
    fn of(&self, studio: &Studio, path: &FilePath) -> Answer<String> {
        let key = key(path)?;
        // one at a time, so that no material is made twice
        let mut made = lock(&self.made);
        if let Some(name) = made.get(&key) {
            return Ok(name.clone());
        }
        let opened = studio.catalogue.open(&studio.folders, path)?;
        let Measured::Compressed(material) = &opened.measured else {
            let problem = "only compressed materials are drawn in the browser; compress it first";
            return Err(Failure::new(StatusCode::BAD_REQUEST, problem));
        };
        let three = renderers::by_name("three")?;
        three.check(path, material)?;
        let name = Sha256::digest(format!("{key:?}")).iter().take(8).fold(String::new(), |mut name, byte| {
            // writing to a string cannot fail
            let _ = write!(name, "{byte:02x}");
            name
        });
        let folder = self.folder.path().join(&name);
        std::fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        three.write(&opened.label, material, &folder, &Silent)?;
        made.insert(key, name.clone());
        Ok(name)
    }
}

/// Exports a material for the 3D view; the answer says where it is.
pub(crate) async fn make(State(studio): State<Arc<Studio>>, Query(which): Query<Which>) -> Answer<Json<Value>> {
    blocking(move || {
        let name = studio.shaders.of(&studio, &studio.folders.find(&which.m)?)?;
        let sizes =
            FILES.iter().map(|(file, _)| std::fs::metadata(studio.shaders.folder.path().join(&name).join(file)));
        let bytes: u64 = sizes.flatten().map(|found| found.len()).sum();
        Ok(Json(json!({ "url": format!("/three/{name}/"), "bytes": bytes })))
    })
    .await
}

/// A file of an exported material.
pub(crate) async fn file(
    State(studio): State<Arc<Studio>>,
    Path((name, file)): Path<(String, String)>,
) -> Answer<Response> {
    blocking(move || {
        let missing = || Failure::missing("such file");
        let (file, kind) = FILES.iter().find(|(known, _)| *known == file).ok_or_else(missing)?;
        if !lock(&studio.shaders.made).values().any(|known| *known == name) {
            return Err(missing());
        }
        let path = studio.shaders.folder.path().join(&name).join(file);
        let content = std::fs::read(&path).map_err(Error::io(&path))?;
        Ok(([(header::CONTENT_TYPE, *kind)], content).into_response())
    })
    .await
}

/// A material as a page of one file, which opens from disk without a server.
pub(crate) async fn single(State(studio): State<Arc<Studio>>, Query(which): Query<Which>) -> Answer<Response> {
    blocking(move || {
        let path = studio.folders.find(&which.m)?;
        let name = studio.shaders.of(&studio, &path)?;
        let page = studio.shaders.folder.path().join(&name).join(SINGLE);
        let content = std::fs::read(&page).map_err(Error::io(&page))?;
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(crate::download::attached(&format!("{stem}.html"), "text/html; charset=utf-8", content))
    })
    .await
}
