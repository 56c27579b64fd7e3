//! Files that the browser saves.

use std::fs::File;
use std::io::{Cursor, Read, Write};
use std::path::Path as FilePath;
use std::sync::Arc;

use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use loden::Error;
use zip::write::SimpleFileOptions;

use crate::Studio;
use crate::failure::{Answer, Failure, blocking};
use crate::images::Which;

/// The largest download, bytes: it is made in memory.
const LARGEST: u64 = 1 << 30;

/// An answer that the browser saves under this name.
pub(crate) fn attached(name: &str, kind: &str, content: Vec<u8>) -> Response {
    let plain: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() || "-_. ".contains(c) { c } else { '_' }).collect();
    let disposition = format!("attachment; filename=\"{plain}\"");
    ([(header::CONTENT_TYPE, kind.to_owned()), (header::CONTENT_DISPOSITION, disposition)], content).into_response()
}

/// A material's file as it is.
pub(crate) async fn material(State(studio): State<Arc<Studio>>, Query(which): Query<Which>) -> Answer<Response> {
    blocking(move || {
        let path = studio.folders.find(&which.m)?;
        if !path.is_file() {
            return Err(Failure::new(StatusCode::BAD_REQUEST, "the material is a folder, which is not downloaded"));
        }
        let content = read(&path)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(attached(&name, "application/octet-stream", content))
    })
    .await
}

/// What a finished job wrote: a file as it is, a folder as a zip file.
pub(crate) async fn result(State(studio): State<Arc<Studio>>, Path(id): Path<u64>) -> Answer<Response> {
    blocking(move || {
        let job = studio.jobs.find(id)?;
        let path = job.output.clone().filter(|path| job.is_done() && path.exists());
        let path = path.ok_or_else(|| Failure::missing(&format!("file of job {id}")))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        match path.is_file() {
            true => Ok(attached(&name, "application/octet-stream", read(&path)?)),
            false => Ok(attached(&format!("{name}.zip"), "application/zip", zipped(&path, &name)?)),
        }
    })
    .await
}

fn read(path: &FilePath) -> Answer<Vec<u8>> {
    let mut content = Vec::new();
    let file = File::open(path).map_err(Error::io(path))?;
    file.take(LARGEST + 1).read_to_end(&mut content).map_err(Error::io(path))?;
    if content.len() as u64 > LARGEST {
        return Err(Failure::new(StatusCode::BAD_REQUEST, format!("{} is too large to be downloaded", path.display())));
    }
    Ok(content)
}

/// The files of a folder below a folder of this name.
fn zipped(folder: &FilePath, name: &str) -> Answer<Vec<u8>> {
    let failed = |error: zip::result::ZipError| Error::io(folder)(std::io::Error::other(error));
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let mut files: Vec<_> =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_file()).collect();
    files.sort();
    for file in files {
        let inside = format!("{name}/{}", file.file_name().unwrap_or_default().to_string_lossy());
        archive.start_file(inside, SimpleFileOptions::default()).map_err(failed)?;
        archive.write_all(&read(&file)?).map_err(Error::io(folder))?;
    }
    Ok(archive.finish().map_err(failed)?.into_inner())
}
