//! Writing a container.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Mutex;

use serde_json::{Map, Value, json};

use super::{MAX_HEADER, SourceInfo, TensorSpec, VERSION, limit, safetensors_dtype};
use crate::btf::{BtfMeta, BtfSource};
use crate::codec::parts::Recipe;
use crate::codec::{Codec, by_name};
use crate::metric::Report;
use crate::output::{OutputFile, failed};
use crate::params::Values;
use crate::{Error, Result};

/// The metadata entry of [`Description::history`].
pub const HISTORY: &str = "history";

/// Bytes left free in the header for the error.
const ROOM_FOR_ERROR: usize = 256;

/// Metadata of a file, apart from its packing and its error.
#[derive(Debug, Clone, PartialEq)]
pub struct Description<'a> {
    /// The codec, or whatever else wrote the file.
    pub method: &'a str,
    /// The parameters as text.
    pub params: Map<String, Value>,
    /// Size, directions and conventions, with the number type of the source.
    pub meta: &'a BtfMeta,
    /// What the file was made from.
    pub source: &'a SourceInfo,
    /// The recipe, if the method is not a built-in codec.
    pub recipe: Option<&'a Recipe>,
    /// What was done to the parts since they were compressed, oldest first.
    pub history: &'a [Value],
}

/// Writes a container piece by piece, in any order and from any thread.
#[derive(Debug)]
pub struct Writer {
    output: OutputFile,
    written: Mutex<u64>,
    /// Name, offset in the file and size of each tensor.
    places: Vec<(String, u64, u64)>,
    total: u64,
    /// The header, with checksums that are as long as any.
    header: Value,
    room: usize,
}

impl Writer {
    /// Begins the file `path` of a codec whose tensors are the planes and tables of `recipe`. If the codec is not
    /// built in, the recipe is stored too, so that this program can still open the file.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the recipe does not suit the source; [`Error::Io`] if the file cannot be written.
    pub fn create(
        path: &Path,
        codec: &dyn Codec,
        params: &Values,
        source: &dyn BtfSource,
        recipe: &Recipe,
    ) -> Result<Self> {
        recipe.check(source.meta())?;
        let tensors = recipe.tensors(source.meta());
        let unknown = by_name(codec.name()).is_err();
        Self::begin(path, codec, params, source, unknown.then_some(recipe), &tensors)
    }

    /// Begins the file `path` of a codec whose tensors differ from those of its recipe. Tensors with wider numbers
    /// must come first, so that all are aligned.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn of_tensors(
        path: &Path,
        codec: &dyn Codec,
        params: &Values,
        source: &dyn BtfSource,
        tensors: &[TensorSpec],
    ) -> Result<Self> {
        Self::begin(path, codec, params, source, None, tensors)
    }

    fn begin(
        path: &Path,
        codec: &dyn Codec,
        params: &Values,
        source: &dyn BtfSource,
        recipe: Option<&Recipe>,
        tensors: &[TensorSpec],
    ) -> Result<Self> {
        let (params, info) = (text_of(params), SourceInfo::new(source)?);
        let (method, meta) = (codec.name(), source.meta());
        Self::describe(path, &Description { method, params, meta, source: &info, recipe, history: &[] }, tensors)
    }

    /// Begins the file `path` with this metadata and the tensors in the given order.
    pub(in crate::codec) fn describe(path: &Path, about: &Description, tensors: &[TensorSpec]) -> Result<Self> {
        let text = |value: &Value| Value::String(value.to_string());
        let encode = |e: serde_json::Error| Error::io(path)(e.into());
        let mut header = Map::new();
        let mut metadata = json!({
            "loden": VERSION,
            "program": concat!("loden ", env!("CARGO_PKG_VERSION")),
            "method": about.method,
            "params": text(&Value::Object(about.params.clone())),
            "btf": text(&serde_json::to_value(about.meta).map_err(encode)?),
            "source": text(&serde_json::to_value(about.source).map_err(encode)?),
        });
        if let Some(recipe) = about.recipe {
            metadata["recipe"] = text(&serde_json::to_value(recipe).map_err(encode)?);
        }
        if !about.history.is_empty() {
            metadata[HISTORY] = text(&Value::Array(about.history.to_vec()));
        }
        let longest = tensors.iter().map(|tensor| (tensor.name.clone(), u32::MAX.into())).collect();
        metadata["checksums"] = text(&Value::Object(longest));
        header.insert("__metadata__".into(), metadata);
        let mut end = 0;
        let mut places = Vec::new();
        for tensor in tensors {
            let (start, size) = (end, tensor.bytes());
            end += size;
            places.push((tensor.name.clone(), start, size));
            let dtype = safetensors_dtype(tensor.sample_type);
            let entry = json!({"dtype": dtype, "shape": tensor.shape, "data_offsets": [start, end]});
            header.insert(tensor.name.clone(), entry);
        }
        let header = Value::Object(header);
        let room = finish_header(header.to_string().into_bytes(), 0).len();
        places.iter_mut().for_each(|(_, start, _)| *start += 8 + room as u64);
        let total = 8 + room as u64 + end;
        Ok(Self { written: Mutex::new(0), output: OutputFile::create(path)?, places, total, header, room })
    }

    /// Whether the file has a tensor `name`.
    pub fn has(&self, tensor: &str) -> bool {
        self.places.iter().any(|(name, ..)| name == tensor)
    }

    /// Writes `bytes` at the byte `offset` of a tensor.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the tensor does not exist or the bytes exceed it; [`Error::Io`].
    pub fn write(&self, tensor: &str, offset: u64, bytes: &[u8]) -> Result<()> {
        let place = self.places.iter().find(|(name, ..)| name == tensor);
        let (_, start, size) = place.ok_or_else(|| Error::parameter(tensor, "no such tensor"))?;
        if offset + bytes.len() as u64 > *size {
            let problem = format!("{} bytes at {offset} exceed its size of {size}", bytes.len());
            return Err(Error::parameter(tensor, problem));
        }
        let mut written = self.written.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let mut file = self.output.file();
        file.seek(SeekFrom::Start(start + offset)).map_err(failed(self.output.path()))?;
        file.write_all(bytes).map_err(failed(self.output.path()))?;
        *written += bytes.len() as u64;
        Ok(())
    }

    /// Writes the header with the checksums, moves the finished file to its place and returns its size in bytes.
    ///
    /// # Errors
    /// [`Error::Parameter`] if bytes are missing; [`Error::Io`] if the file cannot be read again, written or renamed.
    pub fn commit(self) -> Result<u64> {
        let written = *self.written.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let expected = self.total - 8 - self.room as u64;
        if written != expected {
            return Err(Error::parameter("tensors", format!("found {written} bytes, expected {expected}")));
        }
        let Self { output, places, total, mut header, room, .. } = self;
        header["__metadata__"]["checksums"] = Value::String(checksums(output.temporary(), &places)?.to_string());
        let header = finish_header(header.to_string().into_bytes(), room);
        let mut file = output.file();
        let length = (room as u64).to_le_bytes();
        let write =
            file.seek(SeekFrom::Start(0)).and_then(|_| file.write_all(&length)).and_then(|()| file.write_all(&header));
        write.map_err(failed(output.path()))?;
        output.commit()?;
        Ok(total)
    }
}

/// CRC-32 of each tensor, read again: pieces are written in any order.
fn checksums(path: &Path, places: &[(String, u64, u64)]) -> Result<Value> {
    let mut file = File::open(path).map_err(Error::io(path))?;
    let mut sums = Map::new();
    let mut buffer = vec![0; 1 << 20];
    for (name, start, size) in places {
        file.seek(SeekFrom::Start(*start)).map_err(Error::io(path))?;
        let (mut left, mut sum) = (*size, crc32fast::Hasher::new());
        while left > 0 {
            let piece = &mut buffer[..left.min(1 << 20) as usize];
            file.read_exact(piece).map_err(Error::io(path))?;
            sum.update(piece);
            left -= piece.len() as u64;
        }
        sums.insert(name.clone(), sum.finalize().into());
    }
    Ok(Value::Object(sums))
}

/// Parameters as stored in the metadata.
fn text_of(params: &Values) -> Map<String, Value> {
    params.iter().map(|(name, text)| (name.into(), text.into())).collect()
}

/// A header of at least `least` bytes with room for the error, padded with spaces to a multiple of 64 to align the
/// tensors.
pub(in crate::codec) fn finish_header(mut header: Vec<u8>, least: usize) -> Vec<u8> {
    header.resize(((8 + header.len() + ROOM_FOR_ERROR).next_multiple_of(64) - 8).max(least), b' ');
    header
}

/// Stores the error in the header of the complete file `path`.
///
/// # Errors
/// [`Error::Invalid`] if it is not a `.loden` file or its header has no room; [`Error::Io`].
pub fn write_error(path: &Path, report: &Report) -> Result<()> {
    let mut file = File::options().read(true).write(true).open(path).map_err(Error::io(path))?;
    let mut length = [0; 8];
    file.read_exact(&mut length).map_err(Error::io(path))?;
    let length = u64::from_le_bytes(length);
    if length > MAX_HEADER {
        return Err(limit(path, "header length", length, MAX_HEADER));
    }
    let mut header = vec![0; length as usize];
    file.read_exact(&mut header).map_err(Error::io(path))?;
    let invalid = |e: serde_json::Error| Error::invalid(path, "header", e.to_string());
    let mut value: Value = serde_json::from_slice(&header).map_err(invalid)?;
    let report = serde_json::to_string(report).map_err(invalid)?;
    match value.get_mut("__metadata__").and_then(Value::as_object_mut) {
        Some(metadata) => drop(metadata.insert("error".into(), Value::String(report))),
        None => return Err(Error::invalid(path, "__metadata__", "it is missing")),
    }
    let mut bytes = value.to_string().into_bytes();
    if bytes.len() > header.len() {
        return Err(Error::invalid(path, "header", "the header has no room for the error"));
    }
    bytes.resize(header.len(), b' ');
    file.seek(SeekFrom::Start(8)).and_then(|_| file.write_all(&bytes)).map_err(failed(path))
}
