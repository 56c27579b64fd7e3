//! Reading a file's bytes without trusting it.

use std::fs::File;
use std::ops::Range;
use std::path::Path;

use memmap2::Mmap;

use crate::{Error, Result};

/// Maps a whole file into memory.
pub(crate) fn map(path: &Path) -> Result<Mmap> {
    let file = File::open(path).map_err(Error::io(path))?;
    // SAFETY: the map is read-only; if another program shortens the file meanwhile, the system ends us with a
    // bus error, which no reader of memory-mapped files can exclude.
    unsafe { Mmap::map(&file) }.map_err(Error::io(path))
}

/// Gives the pages of a part of a map back; they are read again when they are touched.
pub(crate) fn release(map: &Mmap, range: Range<usize>) {
    // SAFETY: pages of a read-only shared map of a file come back with the same content when touched again.
    // That it fails is of no consequence: the pages then stay until the system wants them.
    #[cfg(unix)]
    let _ = unsafe { map.unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, range.start, range.len()) };
    #[cfg(not(unix))]
    let _ = (map, range);
}

/// A whole text file of at most `limit` bytes; what is not UTF-8 is replaced, as old headers are Latin-1.
pub(super) fn text(path: &Path, limit: u64) -> Result<String> {
    let found = std::fs::metadata(path).map_err(Error::io(path))?.len();
    if found > limit {
        return Err(Error::Limit { path: path.into(), field: "size".into(), found, limit });
    }
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Little-endian numbers from a file's bytes, one after the other; an error names the field that is cut off.
pub(super) struct Cursor<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, bytes, at: 0 }
    }

    /// How many bytes were read.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    /// How many bytes are left.
    pub(super) fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    pub(super) fn invalid(&self, field: impl Into<String>, problem: impl Into<String>) -> Error {
        Error::invalid(self.path, field, problem)
    }

    pub(super) fn take(&mut self, field: &str, count: u64) -> Result<&'a [u8]> {
        if count > self.left() as u64 {
            let problem = format!("{count} bytes from byte {} on, but the file ends at {}", self.at, self.bytes.len());
            return Err(self.invalid(field, problem));
        }
        let part = &self.bytes[self.at..self.at + count as usize];
        self.at += count as usize;
        Ok(part)
    }

    pub(super) fn array<const N: usize>(&mut self, field: &str) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(field, N as u64)?);
        Ok(bytes)
    }

    pub(super) fn u8(&mut self, field: &str) -> Result<u8> {
        self.array::<1>(field).map(|[byte]| byte)
    }

    pub(super) fn u16(&mut self, field: &str) -> Result<u16> {
        self.array(field).map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self, field: &str) -> Result<u32> {
        self.array(field).map(u32::from_le_bytes)
    }

    pub(super) fn i32(&mut self, field: &str) -> Result<i32> {
        self.array(field).map(i32::from_le_bytes)
    }

    pub(super) fn u64(&mut self, field: &str) -> Result<u64> {
        self.array(field).map(u64::from_le_bytes)
    }

    pub(super) fn f32(&mut self, field: &str) -> Result<f32> {
        let value = self.array(field).map(f32::from_le_bytes)?;
        if value.is_finite() { Ok(value) } else { Err(self.invalid(field, format!("{value} is not finite"))) }
    }

    pub(super) fn f32s<const N: usize>(&mut self, field: &str) -> Result<[f32; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f32(field)?;
        }
        Ok(values)
    }

    /// A field of `count` bytes that holds text up to the first zero byte.
    pub(super) fn text(&mut self, field: &str, count: u64) -> Result<String> {
        let bytes = self.take(field, count)?;
        let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
        Ok(String::from_utf8_lossy(&bytes[..end]).into_owned())
    }
}
