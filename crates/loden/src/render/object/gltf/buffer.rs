//! Bytes of glTF files: the binary container, buffers beside the file, and embedded ones.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::json::{Buffer, Root};
use crate::{Error, Result};

/// Reads the document, and the binary chunk if the file has one.
pub(super) fn split(path: &Path) -> Result<(Root, Option<Vec<u8>>)> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let (json, binary) = if bytes.starts_with(b"glTF") { chunks(path, &bytes)? } else { (&bytes[..], None) };
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    let root: Root = serde_json::from_slice(json).map_err(|e| Error::invalid(path, "glTF document", e.to_string()))?;
    if root.asset.version.starts_with('1') {
        return Err(Error::unsupported(path, "glTF 1 is not supported, expected glTF 2"));
    }
    Ok((root, binary.map(<[u8]>::to_vec)))
}

/// The JSON and the binary chunk of a binary file.
fn chunks<'a>(path: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>)> {
    let truncated = || Error::invalid(path, "glTF container", "the file ends too early");
    let word = |at: usize| {
        let four: Option<[u8; 4]> = bytes.get(at..at + 4).and_then(|four| four.try_into().ok());
        four.map(u32::from_le_bytes).ok_or_else(truncated)
    };
    if word(4)? != 2 {
        return Err(Error::unsupported(
            path,
            format!("version {} of binary glTF is not supported, expected 2", word(4)?),
        ));
    }
    let chunk = |at: usize| {
        let length = word(at)? as usize;
        let content = bytes.get(at + 8..).and_then(|rest| rest.get(..length)).ok_or_else(truncated)?;
        Ok::<_, Error>((word(at + 4)?, content))
    };
    let (kind, json) = chunk(12)?;
    if kind.to_le_bytes() != *b"JSON" {
        return Err(Error::invalid(path, "glTF container", "its first chunk is not JSON"));
    }
    // chunks are padded to four bytes
    let next = 20 + json.len().next_multiple_of(4);
    let binary = match bytes.get(next..) {
        Some(rest) if rest.len() >= 8 => Some(chunk(next)?).filter(|(kind, _)| kind.to_le_bytes() == *b"BIN\0"),
        _ => None,
    };
    Ok((json, binary.map(|(_, content)| content)))
}

/// The content of a buffer that is embedded in the document or a file beside it.
pub(super) fn load(path: &Path, index: usize, buffer: &Buffer) -> Result<Vec<u8>> {
    let field = format!("buffer {index}");
    let Some(uri) = &buffer.uri else { return Err(Error::invalid(path, field, "it has no content")) };
    Ok(file(path, &field, uri, buffer.byte_length as u64)?.1)
}

/// The name and the content of a file that an address names, or of embedded data. A file has `least` bytes or more,
/// which are not read unless `least` is 0.
pub(super) fn file(path: &Path, field: &str, uri: &str, least: u64) -> Result<(PathBuf, Vec<u8>)> {
    if let Some(data) = uri.strip_prefix("data:") {
        let wrong = || Error::invalid(path, field, "its content is not valid base64");
        let (_, text) = data.split_once(";base64,").ok_or_else(wrong)?;
        return Ok((path.into(), base64(text.as_bytes()).ok_or_else(wrong)?));
    }
    let has_scheme = |(scheme, _): (&str, &str)| scheme.len() > 1 && scheme.bytes().all(|b| b.is_ascii_alphanumeric());
    if uri.split_once(':').is_some_and(has_scheme) {
        let uri: String = uri.chars().take(80).collect();
        return Err(Error::unsupported(path, format!("{field}: {uri:?} is neither a file nor embedded")));
    }
    let file = beside(path, uri);
    let invalid = |problem: String| Error::invalid(&file, format!("{field} of {}", path.display()), problem);
    let metadata = std::fs::metadata(&file).map_err(Error::io(&file))?;
    if !metadata.is_file() {
        return Err(invalid("it is not a file".into()));
    }
    if metadata.len() < least {
        return Err(invalid(format!("found {} bytes, expected {least}", metadata.len())));
    }
    let mut bytes = Vec::new();
    let content = std::fs::File::open(&file).map_err(Error::io(&file))?;
    let most = if least == 0 { u64::MAX } else { least };
    content.take(most).read_to_end(&mut bytes).map_err(Error::io(&file))?;
    Ok((file, bytes))
}

/// The file that a relative address names: as it is written, else with its percent signs decoded and slashes for
/// backslashes.
fn beside(path: &Path, uri: &str) -> PathBuf {
    let literal = path.with_file_name("").join(uri);
    if literal.exists() {
        return literal;
    }
    let mut decoded = Vec::new();
    let mut rest = uri.as_bytes();
    while let [first, others @ ..] = rest {
        let escaped = || u8::from_str_radix(std::str::from_utf8(others.get(..2)?).ok()?, 16).ok();
        match (*first, escaped()) {
            (b'%', Some(byte)) => {
                decoded.push(byte);
                rest = &others[2..];
            }
            (byte, _) => {
                decoded.push(if byte == b'\\' { b'/' } else { byte });
                rest = others;
            }
        }
    }
    path.with_file_name("").join(String::from_utf8_lossy(&decoded).as_ref())
}

/// Decodes base64, in the usual or the URL alphabet; white space and padding are skipped.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0u32, 0);
    for &c in text.iter().filter(|c| !c.is_ascii_whitespace() && **c != b'=') {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_decoded() {
        assert_eq!(base64(b"bG9kZW4=").unwrap(), b"loden");
        assert_eq!(base64(b"bG9k\nZW4").unwrap(), b"loden");
        assert_eq!(base64(b"+/-_").unwrap(), [0xfb, 0xff, 0xbf]);
        assert_eq!(base64(b"b*"), None);
    }

    #[test]
    fn addresses_name_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gltf");
        assert_eq!(beside(&path, "my%20mesh.bin"), folder.path().join("my mesh.bin"));
        assert_eq!(beside(&path, r"parts\a%2.bin"), folder.path().join("parts/a%2.bin"));
        std::fs::write(folder.path().join("a%20b.bin"), "").unwrap();
        assert_eq!(beside(&path, "a%20b.bin"), folder.path().join("a%20b.bin"));
    }
}
