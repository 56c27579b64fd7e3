//! The image files of an archive: entries of a zip, or files below a folder.

use std::collections::HashSet;
use std::fs;
use std::io::{Cursor, Read};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use memmap2::Mmap;
use zip::ZipArchive;

use crate::input::{files_below, guarded, map};
use crate::picture::decode::Reading;
use crate::{Error, Result};

/// A single compressed image larger than this is refused.
const MAX_FILE: u64 = 1 << 30;

/// The images of a zip or a folder, sorted by name; other files are left out with a warning.
pub(super) struct Files {
    path: PathBuf,
    place: Place,
    /// Path inside, and for a zip the entry's index.
    names: Vec<(String, usize)>,
    bytes: u64,
    warnings: Vec<String>,
}

enum Place {
    Folder,
    Zip(ZipArchive<Cursor<Shared>>),
}

/// A memory map that can be cloned into every thread's archive reader.
#[derive(Clone)]
struct Shared(Arc<Mmap>);

impl AsRef<[u8]> for Shared {
    fn as_ref(&self) -> &[u8] {
        self.0.deref()
    }
}

impl Files {
    pub(super) fn list(path: &Path) -> Result<Self> {
        let mut all = Vec::new();
        let (place, bytes) = if path.is_dir() {
            let files = files_below(path)?;
            let bytes = files.iter().map(|file| file.bytes).sum();
            all.extend(files.into_iter().map(|file| (file.name, 0)));
            (Place::Folder, bytes)
        } else {
            let archive = open_zip(path)?;
            let name = |i: usize| match archive.name_for_index(i) {
                Some(Ok(name)) => Ok((name.into_owned(), i)),
                _ => Err(Error::invalid(path, format!("entry {i}"), "its name is not readable")),
            };
            all = (0..archive.len()).map(name).collect::<Result<_>>()?;
            all.retain(|(name, _)| !name.ends_with('/'));
            (Place::Zip(archive), fs::metadata(path).map_err(Error::io(path))?.len())
        };
        all.sort();
        let (names, others): (Vec<_>, Vec<_>) = all.into_iter().partition(|(name, _)| is_image(name));
        let mut warnings = Vec::new();
        if let Some((first, _)) = others.first() {
            warnings.push(format!("{} files that are no pictures are ignored, such as {first}", others.len()));
        }
        Ok(Self { path: path.into(), place, names, bytes, warnings })
    }

    pub(super) fn len(&self) -> usize {
        self.names.len()
    }

    pub(super) fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

impl super::super::image_set::Files for Files {
    fn path(&self) -> &Path {
        &self.path
    }

    fn name(&self, index: usize) -> &str {
        &self.names[index].0
    }

    fn bytes(&self) -> u64 {
        self.bytes
    }

    fn reading(&self) -> Reading {
        Reading { strict: true, bonn: true }
    }

    /// The checksum is verified where there is one.
    fn read(&self, index: usize) -> Result<Vec<u8>> {
        let (name, entry) = &self.names[index];
        match &self.place {
            Place::Folder => {
                let file = self.path.join(name);
                fs::read(&file).map_err(Error::io(&file))
            }
            Place::Zip(archive) => {
                let wrong = |problem: String| Error::invalid(&self.path, name, problem);
                // a clone shares the directory and the map, and has its own position
                let mut archive = archive.clone();
                let read = || {
                    let mut file = archive.by_index(*entry).map_err(|e| e.to_string())?;
                    let (packed, size) = (file.compressed_size(), file.size());
                    // deflate cannot expand more than 1032 times: a larger promise is a lie
                    if size > MAX_FILE || size > packed.saturating_mul(1032).saturating_add(1024) {
                        return Err(format!("{size} bytes promised by {packed} compressed ones"));
                    }
                    let mut bytes = Vec::with_capacity(size as usize);
                    file.read_to_end(&mut bytes).map_err(|e| e.to_string())?;
                    Ok(bytes)
                };
                guarded("zip", read).flatten().map_err(wrong)
            }
        }
    }
}

fn open_zip(path: &Path) -> Result<ZipArchive<Cursor<Shared>>> {
    let map = map(path)?;
    let invalid = |problem: String| Error::invalid(path, "zip directory", problem);
    let shared = Shared(Arc::new(map));
    let archive = guarded("zip", || ZipArchive::new(Cursor::new(shared.clone()))).map_err(invalid)?;
    let archive = archive.map_err(|e| invalid(format!("{e}; the archive may be truncated")))?;
    if archive.has_duplicate_names() {
        let name = repeated_name(&shared.0, archive.central_directory_start() as usize);
        return Err(invalid(format!("two entries have the same name: {}", name.unwrap_or_default())));
    }
    Ok(archive)
}

/// The first name in the directory of a zip that was there before.
fn repeated_name(bytes: &[u8], mut at: usize) -> Option<String> {
    let mut known = HashSet::new();
    loop {
        let header = bytes.get(at..at.checked_add(46)?)?;
        let length = |k: usize| usize::from(u16::from_le_bytes([header[k], header[k + 1]]));
        let name = bytes.get(at + 46..at + 46 + length(28))?;
        if !header.starts_with(b"PK\x01\x02") {
            return None;
        }
        if !known.insert(name) {
            return Some(String::from_utf8_lossy(name).into_owned());
        }
        at += 46 + length(28) + length(30) + length(32);
    }
}

/// Whether a file name ends like a picture; hidden files (resource forks) are none.
fn is_image(path: &str) -> bool {
    let base = path.rsplit('/').next().unwrap_or(path);
    let extension = base.rsplit_once('.').map(|(_, e)| e.to_ascii_lowercase());
    !base.starts_with('.')
        && matches!(extension.as_deref(), Some("jpg" | "jpeg" | "png" | "tif" | "tiff" | "exr" | "hdr" | "bmp"))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn a_repeated_name_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.zip");
        let mut writer = zip::ZipWriter::new(fs::File::create(&path).unwrap());
        for name in ["tl000 pl000 tv000 pv000.png", "tl015 pl000 tv000 pv000.png", "tl030 pl000 tv000 pv000.png"] {
            writer.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
            writer.write_all(b"content").unwrap();
        }
        writer.finish().unwrap();
        let mut bytes = fs::read(&path).unwrap();
        let places: Vec<usize> = (0..bytes.len() - 5).filter(|&k| bytes[k..].starts_with(b"tl030")).collect();
        places.iter().for_each(|&k| bytes[k..k + 5].copy_from_slice(b"tl015"));
        fs::write(&path, bytes).unwrap();
        let error = Files::list(&path).err().unwrap().to_string();
        assert!(error.contains("tl015 pl000 tv000 pv000.png"), "{error}");
    }
}
