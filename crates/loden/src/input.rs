//! Reading folders and the bytes of files without trusting them.

mod guard;

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

use memmap2::Mmap;

pub(crate) use guard::guarded;

use crate::{Error, Result};

/// Maps a whole file into memory.
pub(crate) fn map(path: &Path) -> Result<Mmap> {
    let file = File::open(path).map_err(Error::io(path))?;
    // SAFETY: the map is read-only; if another program shortens the file meanwhile, the system ends this
    // process with a bus error, which no reader of memory-mapped files can prevent.
    unsafe { Mmap::map(&file) }.map_err(Error::io(path))
}

/// Releases the pages of part of a map; they are read again when touched.
pub(crate) fn release(map: &Mmap, range: Range<usize>) {
    // SAFETY: pages of a read-only shared map of a file come back with the same content when touched again.
    // Failure is harmless: the pages stay until the system reclaims them.
    #[cfg(unix)]
    let _ = unsafe { map.unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, range.start, range.len()) };
    #[cfg(not(unix))]
    let _ = (map, range);
}

/// Maximum depth of nested folders: a link to a parent would never end.
const MAX_DEPTH: usize = 32;

/// A file below a folder.
pub(crate) struct Below {
    /// Path relative to the folder, separated by slashes.
    pub name: String,
    /// Length in bytes; links are followed.
    pub bytes: u64,
}

/// All files below a folder, sorted by name; links are followed.
///
/// # Errors
/// [`Error::Io`] if a folder cannot be read; [`Error::Invalid`] if a name is not UTF-8.
pub(crate) fn files_below(folder: &Path) -> Result<Vec<Below>> {
    fn walk(folder: &Path, below: &str, depth: usize, found: &mut Vec<Below>) -> Result<()> {
        for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
            let path = entry.map_err(Error::io(folder))?.path();
            let name = path.file_name().and_then(|name| name.to_str());
            let name = name.ok_or_else(|| Error::invalid(&path, "name", "not valid UTF-8"))?;
            let name = if below.is_empty() { name.to_owned() } else { format!("{below}/{name}") };
            let metadata = std::fs::metadata(&path).map_err(Error::io(&path))?;
            if !metadata.is_dir() {
                found.push(Below { name, bytes: metadata.len() });
            } else if depth < MAX_DEPTH {
                walk(&path, &name, depth + 1, found)?;
            }
        }
        Ok(())
    }
    let mut found = Vec::new();
    walk(folder, "", 0, &mut found)?;
    found.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(found)
}

/// The files below a folder, or the file itself.
///
/// # Errors
/// As [`files_below`].
pub(crate) fn files_of(path: &Path) -> Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.into()]);
    }
    Ok(files_below(path)?.into_iter().map(|file| path.join(file.name)).collect())
}

/// Reads a text file of at most `limit` bytes. Bytes that are not UTF-8 are replaced: old headers are Latin-1.
pub(crate) fn text(path: &Path, limit: u64) -> Result<String> {
    let found = std::fs::metadata(path).map_err(Error::io(path))?.len();
    if found > limit {
        return Err(Error::Limit { path: path.into(), field: "size".into(), found, limit });
    }
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    Ok(String::from_utf8_lossy(without_bom(&bytes)).into_owned())
}

/// The bytes of a text without the byte-order mark that some programs write.
pub(crate) fn without_bom(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// Reads little-endian numbers from a file's bytes in sequence; an error names the truncated field.
pub(crate) struct Cursor<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, bytes, at: 0 }
    }

    /// Number of bytes read.
    pub(crate) fn at(&self) -> usize {
        self.at
    }

    /// Number of bytes left.
    pub(crate) fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    pub(crate) fn invalid(&self, field: impl Into<String>, problem: impl Into<String>) -> Error {
        Error::invalid(self.path, field, problem)
    }

    pub(crate) fn take(&mut self, field: &str, count: u64) -> Result<&'a [u8]> {
        if count > self.left() as u64 {
            let problem = format!("found {} bytes from byte {}, expected {count}", self.left(), self.at);
            return Err(self.invalid(field, problem));
        }
        let part = &self.bytes[self.at..self.at + count as usize];
        self.at += count as usize;
        Ok(part)
    }

    pub(crate) fn array<const N: usize>(&mut self, field: &str) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(field, N as u64)?);
        Ok(bytes)
    }

    pub(crate) fn u8(&mut self, field: &str) -> Result<u8> {
        self.array::<1>(field).map(|[byte]| byte)
    }

    pub(crate) fn u16(&mut self, field: &str) -> Result<u16> {
        self.array(field).map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self, field: &str) -> Result<u32> {
        self.array(field).map(u32::from_le_bytes)
    }

    pub(crate) fn i32(&mut self, field: &str) -> Result<i32> {
        self.array(field).map(i32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self, field: &str) -> Result<u64> {
        self.array(field).map(u64::from_le_bytes)
    }

    pub(crate) fn f32(&mut self, field: &str) -> Result<f32> {
        let value = self.array(field).map(f32::from_le_bytes)?;
        if value.is_finite() {
            Ok(value)
        } else {
            Err(self.invalid(field, format!("found {value}, expected a finite number")))
        }
    }

    pub(crate) fn f32s<const N: usize>(&mut self, field: &str) -> Result<[f32; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f32(field)?;
        }
        Ok(values)
    }

    /// A field of `count` bytes that holds text up to the first zero byte.
    pub(crate) fn text(&mut self, field: &str, count: u64) -> Result<String> {
        let bytes = self.take(field, count)?;
        let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
        Ok(String::from_utf8_lossy(&bytes[..end]).into_owned())
    }
}
