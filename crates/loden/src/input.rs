//! Reading folders and the bytes of files without trusting them.

mod guard;

use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use memmap2::Mmap;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

pub(crate) use guard::guarded;

use crate::btf::Identity;
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

/// The identity of a measurement, by its path and all its files.
///
/// # Errors
/// [`Error::Io`].
pub(crate) fn identity(path: &Path, files: &[PathBuf]) -> Result<Identity> {
    let root = if path.is_dir() { path } else { path.parent().unwrap_or(path) };
    let name = |file: &Path| file.strip_prefix(root).unwrap_or(file).to_string_lossy().replace('\\', "/");
    let sha256 = match files {
        [file] => sha256(file)?,
        _ => {
            let line = |file: &PathBuf| Ok((name(file), sha256(file)?));
            let mut lines = files.par_iter().map(line).collect::<Result<Vec<_>>>()?;
            lines.sort();
            let text: String = lines.iter().map(|(name, sum)| format!("{sum}  {name}\n")).collect();
            hexadecimal(&Sha256::digest(text))
        }
    };
    Ok(Identity { name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(), sha256 })
}

/// SHA-256 of a file, hexadecimal.
fn sha256(path: &Path) -> Result<String> {
    let mut file = File::open(path).map_err(Error::io(path))?;
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer).map_err(Error::io(path))? {
            0 => return Ok(hexadecimal(&hash.finalize())),
            count => hash.update(&buffer[..count]),
        }
    }
}

/// Bytes in hexadecimal digits.
pub(crate) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
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

/// A message of a deserialiser in words that users know: it names the types of this program.
pub(crate) fn in_words(message: &str) -> String {
    let mut text = message.to_owned();
    for whole in ["u8", "u16", "u32", "u64", "usize"] {
        text = text.replace(&format!("expected {whole}"), "expected a whole number that is not negative");
    }
    for whole in ["i8", "i16", "i32", "i64", "isize"] {
        text = text.replace(&format!("expected {whole}"), "expected a whole number");
    }
    let others = [
        ("expected f32", "expected a number"),
        ("expected f64", "expected a number"),
        ("expected a boolean", "expected true or false"),
        ("expected a sequence", "expected a list"),
        ("expected an array", "expected a list"),
        ("expected a tuple", "expected a list"),
        ("expected a map", "expected a table"),
        ("expected a string", "expected text in quotes"),
        ("expected path string", "expected a file name in quotes"),
        ("invalid type: ", "found the "),
        ("invalid value: ", "found the "),
        ("the sequence", "a list"),
        ("the map", "a table"),
        ("the floating point `", "the number `"),
        ("the integer `", "the number `"),
        ("the string ", "the text "),
    ];
    for (from, to) in others {
        text = text.replace(from, to);
    }
    // structures have names that only this program knows
    match text.split_once("expected struct ") {
        Some((before, name)) => format!("{before}expected a table{}", name.trim_start_matches(char::is_alphanumeric)),
        None => text,
    }
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

#[cfg(test)]
mod tests {
    use super::{identity, in_words};

    #[test]
    fn an_identity_is_what_sha256sum_prints() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at("b"), "abc").unwrap();
        std::fs::write(at("a"), "").unwrap();
        let one = identity(&at("b"), &[at("b")]).unwrap();
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!((one.name.as_str(), one.sha256.as_str()), ("b", abc));
        // sha256sum a b | sha256sum
        let both = identity(dir.path(), &[at("b"), at("a")]).unwrap();
        assert_eq!(both.sha256, "bf6e2103d6cbead28abb7d3fec372bc25d03a35b1647e83e090248eb08d0adae");
    }

    #[test]
    fn messages_name_no_types_of_the_program() {
        #[derive(Debug, serde::Deserialize)]
        #[expect(dead_code, reason = "read by the deserialiser")]
        struct Form {
            size: u32,
            angle: Option<f32>,
            names: Option<Vec<String>>,
            inner: Option<Box<Form>>,
        }
        let message = |text: &str| in_words(toml::from_str::<Form>(text).unwrap_err().message());
        let whole = "expected a whole number that is not negative";
        assert_eq!(message("size = 'a'"), format!("found the text \"a\", {whole}"));
        assert_eq!(message("size = -2"), format!("found the number `-2`, {whole}"));
        assert_eq!(message("size = 2\nangle = 'x'"), "found the text \"x\", expected a number");
        assert_eq!(message("size = 2\nnames = 3"), "found the number `3`, expected a list");
        assert_eq!(message("size = 2\nnames = [3]"), "found the number `3`, expected text in quotes");
        assert_eq!(message("size = 2\ninner = 3"), "found the number `3`, expected a table");
    }
}
