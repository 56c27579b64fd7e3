//! Files that a scene names: search paths, archives inside zip files, and limits.

use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;

use crate::{Error, Result};

/// Maximum number of entries of a folder among which archives are searched.
const MAX_FOLDERS: usize = 1 << 12;

/// Maximum size of a file, uncompressed, in bytes.
const MAX_BYTES: u64 = 1 << 30;

/// The folders in which files of a kind are searched, in order.
#[derive(Debug, Clone, Default)]
pub(super) struct SearchPath(Vec<PathBuf>);

impl SearchPath {
    /// Sets the folders from a list separated by `:`, relative to `folder`, that of the file that sets them. `&` is the
    /// list so far; `@`, the renderer's own list, is empty.
    pub(super) fn set(&mut self, list: &str, folder: &Path) {
        let mut folders = Vec::new();
        for part in split(&expand(list)) {
            match part.as_str() {
                "" | "@" => {}
                "&" => folders.append(&mut self.0),
                part => folders.push(folder.join(part)),
            }
        }
        self.0 = folders;
    }

    /// Finds a file: in the search path, in the folder of the file that names it, in the working folder; one that is
    /// named with folders also in those above the file.
    pub(super) fn find(&self, name: &str, folder: &Path) -> Option<PathBuf> {
        let name = expand(name).replace('\\', "/");
        let folders = self.0.iter().map(PathBuf::as_path).chain([folder, Path::new("")]);
        let found = folders.map(|other| other.join(&name)).find(|path| exists(path));
        // What another machine wrote with its own folders may lie beside the scene; what was written by a program that
        // ran elsewhere may lie above it.
        let bare = || Some(folder.join(Path::new(&name).file_name()?)).filter(|path| exists(path));
        let above = || folder.ancestors().skip(1).map(|other| other.join(&name)).find(|path| exists(path));
        let is_absolute = Path::new(&name).is_absolute() || name.get(1..3) == Some(":/");
        found
            .or_else(|| match is_absolute {
                true => bare(),
                false if name.contains('/') => above(),
                false => None,
            })
            // what is no file is named as such when it is read
            .or_else(|| Some(folder.join(&name)).filter(|path| path.exists()))
    }
}

/// The only file of this bare name in the folders directly within `folder`.
pub(super) fn below(name: &str, folder: &Path) -> Option<PathBuf> {
    if name.contains(['/', '\\', '!']) {
        return None;
    }
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(here).ok()?.take(MAX_FOLDERS).flatten();
    let mut found = entries.map(|entry| entry.path().join(name)).filter(|path| path.is_file());
    let first = found.next()?;
    found.next().is_none().then_some(first)
}

/// Splits at `:`, but not after the letter of a drive.
fn split(list: &str) -> Vec<String> {
    let mut parts: Vec<String> = Vec::new();
    for part in list.split([':', ';']) {
        let drive = parts.last().is_some_and(|last| last.len() == 1 && last.as_bytes()[0].is_ascii_alphabetic());
        match parts.last_mut() {
            Some(last) if drive && part.starts_with(['/', '\\']) => *last = format!("{last}:{part}"),
            _ => parts.push(part.trim().into()),
        }
    }
    parts
}

/// Replaces `${NAME}` and `$NAME` by variables of the environment; unknown ones stay.
fn expand(text: &str) -> String {
    let mut done = String::new();
    let mut rest = text;
    while let Some(start) = rest.find('$') {
        let after = &rest[start + 1..];
        let (name, length) = match after.strip_prefix('{') {
            Some(braced) => {
                let end = braced.find('}').unwrap_or(braced.len());
                (&braced[..end], (end + 2).min(after.len()))
            }
            None => {
                let end = after.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(after.len());
                (&after[..end], end)
            }
        };
        done += &rest[..start];
        match std::env::var(name) {
            Ok(value) if !name.is_empty() => done += &value,
            _ => done += &rest[start..start + 1 + length],
        }
        rest = &after[length..];
    }
    done + rest
}

/// Whether a path names something, maybe inside a zip file.
fn exists(path: &Path) -> bool {
    inside_zip(path).map_or_else(|| path.is_file(), |(zip, _)| zip.is_file())
}

/// The zip file and the entry that `file.zip!entry` names.
fn inside_zip(path: &Path) -> Option<(PathBuf, String)> {
    let text = path.to_str()?;
    let (zip, entry) = text.split_once('!')?;
    (!zip.is_empty() && !path.is_file()).then(|| (zip.into(), entry.trim_start_matches('/').into()))
}

/// The bytes of a file or an entry of a zip file, decompressed if they are gzip.
///
/// # Errors
/// [`Error::Io`]; [`Error::Invalid`] for what is no regular file and for damaged compression; [`Error::Limit`] above
/// 1 GiB.
pub(super) fn load(path: &Path) -> Result<Vec<u8>> {
    let bytes = match inside_zip(path) {
        Some((zip, entry)) => load_entry(path, &zip, &entry)?,
        None => {
            let kind = std::fs::metadata(path).map_err(Error::io(path))?;
            if !kind.is_file() {
                return Err(Error::invalid(path, "archive", "it is no regular file"));
            }
            limited(path, std::fs::File::open(path).map_err(Error::io(path))?)?
        }
    };
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    limited(path, MultiGzDecoder::new(&bytes[..])).map_err(|error| match error {
        Error::Io { source, .. } => Error::invalid(path, "gzip", source.to_string()),
        other => other,
    })
}

fn load_entry(path: &Path, zip: &Path, entry: &str) -> Result<Vec<u8>> {
    let damaged = |e: zip::result::ZipError| Error::invalid(zip, format!("entry {entry:?}"), e.to_string());
    let file = std::fs::File::open(zip).map_err(Error::io(zip))?;
    let mut archive = zip::ZipArchive::new(std::io::BufReader::new(file)).map_err(damaged)?;
    limited(path, archive.by_name(entry).map_err(damaged)?)
}

fn limited(path: &Path, from: impl Read) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    from.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(Error::io(path))?;
    let found = bytes.len() as u64;
    if found > MAX_BYTES {
        return Err(Error::Limit { path: path.into(), field: "uncompressed size".into(), found, limit: MAX_BYTES });
    }
    Ok(bytes)
}
