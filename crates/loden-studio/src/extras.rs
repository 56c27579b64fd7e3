//! Meshes and pictures of surroundings below the given folders, for the 3D view.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use loden::picture::Picture;
use loden::render::object::EXTENSIONS;
use loden::{Error, Result};
use serde_json::{Value, json};

use crate::Studio;
use crate::failure::{Answer, Failure, blocking};
use crate::folders::Folders;

/// Pictures that may show surroundings.
pub(crate) const PANORAMAS: [&str; 5] = ["hdr", "exr", "png", "jpg", "jpeg"];

/// Meshes that hold all of themselves and may be dropped on the page.
pub(crate) const WHOLE_MESHES: [&str; 3] = ["obj", "ply", "glb"];

/// Folders within folders that are searched, and files and folders that are looked at.
const DEPTH: usize = 4;
const LOOKED_AT: usize = 5000;

/// Pictures of a folder, at most, for them to be looked at: a folder with more is a measurement.
const PICTURES: usize = 24;

/// Meshes and pictures in the folders, by name.
pub(crate) async fn list(State(studio): State<Arc<Studio>>) -> Answer<Json<Value>> {
    blocking(move || {
        let (mut meshes, mut panoramas) = (Vec::new(), Vec::new());
        let mut left = LOOKED_AT;
        for (number, place) in studio.folders.places() {
            let mut found = Vec::new();
            walk(&place.path, if place.is_implicit { 1 } else { DEPTH }, &mut left, &mut found);
            for path in found {
                let Some(id) = studio.folders.id(number, &path).filter(|id| studio.folders.find(id).is_ok()) else {
                    continue;
                };
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                let row = json!({ "id": id, "name": name });
                let list = if has(&path, EXTENSIONS) { &mut meshes } else { &mut panoramas };
                list.push(row);
            }
        }
        Ok(Json(json!({ "meshes": meshes, "panoramas": panoramas })))
    })
    .await
}

/// Whether a file has one of these endings.
pub(crate) fn has(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_lowercase();
    endings.contains(&ending.as_str())
}

fn walk(path: &Path, depth: usize, left: &mut usize, found: &mut Vec<PathBuf>) {
    if !path.is_dir() {
        return found.extend(Some(path).filter(|path| is_one(path)).map(Path::to_owned));
    }
    let Ok(entries) = std::fs::read_dir(path) else { return };
    let mut entries: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).take(*left).collect();
    *left -= entries.len();
    entries.retain(|path| !path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.')));
    entries.sort();
    if entries.iter().filter(|path| has(path, &PANORAMAS)).count() > PICTURES {
        entries.retain(|path| !has(path, &PANORAMAS));
    }
    for entry in entries {
        match entry.is_dir() {
            true if depth > 1 => walk(&entry, depth - 1, left, found),
            true => {}
            false if is_one(&entry) => found.push(entry),
            false => {}
        }
    }
}

/// A mesh, or a picture that is twice as wide as high.
fn is_one(path: &Path) -> bool {
    has(path, EXTENSIONS)
        || has(path, &PANORAMAS) && Picture::dimensions(path).is_ok_and(|(width, height)| width == 2 * height)
}

/// Checks that a mesh file names no file outside of the given folders: buffers of glTF files may be files of their own.
pub(crate) fn check_mesh(folders: &Folders, path: &Path) -> Answer<()> {
    if !has(path, &["gltf", "glb"]) {
        return Ok(());
    }
    for uri in uris(path)?.iter().filter(|uri| !uri.starts_with("data:")) {
        // escapes could spell what the rest of the name does not show
        if uri.contains('%') {
            return Err(Failure::refused(&format!("{} names the file {uri:?}, with escapes", path.display())));
        }
        folders.check(&path.with_file_name("").join(uri))?;
    }
    Ok(())
}

/// The names of buffers in a glTF file.
fn uris(path: &Path) -> Result<Vec<String>> {
    let content = std::fs::read(path).map_err(Error::io(path))?;
    let text = match content.strip_prefix(b"glTF") {
        // version, length, then a chunk: its length, its type, JSON
        Some(rest) => {
            let length = rest.get(8..12).map_or(0, |at| u32::from_le_bytes([at[0], at[1], at[2], at[3]]));
            rest.get(16..).and_then(|json| json.get(..length as usize)).unwrap_or_default()
        }
        None => &content,
    };
    let json: Value = serde_json::from_slice(text).map_err(|error| Error::invalid(path, "JSON", error.to_string()))?;
    let buffers = json["buffers"].as_array().map_or(&[][..], Vec::as_slice);
    Ok(buffers.iter().filter_map(|buffer| Some(buffer["uri"].as_str()?.to_owned())).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_name_no_files_elsewhere() {
        let all = tempfile::tempdir().unwrap();
        let inside = all.path().join("inside");
        std::fs::create_dir(&inside).unwrap();
        for file in [inside.join("own.bin"), all.path().join("secret.bin")] {
            std::fs::write(file, [0; 64]).unwrap();
        }
        let folders = Folders::new(std::slice::from_ref(&inside), None).unwrap();
        let path = inside.join("a.gltf");
        for (uri, fine) in [
            ("own.bin", true),
            ("data:;base64,AAAA", true),
            ("../secret.bin", false),
            ("%2e%2e/secret.bin", false),
            ("/etc/passwd", false),
        ] {
            let text = json!({ "buffers": [{ "uri": uri, "byteLength": 64 }] }).to_string();
            std::fs::write(&path, &text).unwrap();
            assert_eq!(check_mesh(&folders, &path).is_ok(), fine, "{uri}");
            let chunk = [&(text.len() as u32).to_le_bytes()[..], b"JSON", text.as_bytes()].concat();
            let head = [&b"glTF"[..], &2u32.to_le_bytes(), &(chunk.len() as u32 + 12).to_le_bytes()].concat();
            let binary = inside.join("a.glb");
            std::fs::write(&binary, [head, chunk].concat()).unwrap();
            assert_eq!(check_mesh(&folders, &binary).is_ok(), fine, "{uri}");
        }
    }

    #[test]
    fn pictures_of_surroundings_are_twice_as_wide_as_high() {
        let all = tempfile::tempdir().unwrap();
        for (name, size) in [("sky.png", [8, 4]), ("image.png", [8, 8])] {
            Picture::filled(size[0], size[1], glam::Vec3::ONE).write_png(all.path().join(name)).unwrap();
        }
        std::fs::write(all.path().join("ball.obj"), "v 0 0 0").unwrap();
        let (mut found, mut left) = (Vec::new(), 100);
        walk(all.path(), 2, &mut left, &mut found);
        let names: Vec<_> = found.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!((names, left), (vec!["ball.obj", "sky.png"], 97));
    }
}
