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
use crate::output::OutputFile;
use crate::params::Values;
use crate::{Error, Result};

/// Bytes of the header that are left free for the error.
const ROOM_FOR_ERROR: usize = 256;

/// What the metadata of a file says, beside how its numbers are packed and how large the error is.
#[derive(Debug, Clone, PartialEq)]
pub struct Description<'a> {
    /// The codec, or what else wrote it.
    pub method: &'a str,
    /// The parameters, values as text.
    pub params: Map<String, Value>,
    /// Size, directions and conventions, with the number type of the source.
    pub meta: &'a BtfMeta,
    /// What it was made from.
    pub source: &'a SourceInfo,
    /// The recipe, where the method is not a codec of this program.
    pub recipe: Option<&'a Recipe>,
}

/// Writes a container piece by piece, in any order, from any thread.
#[derive(Debug)]
pub struct Writer {
    output: OutputFile,
    written: Mutex<u64>,
    /// Name, offset in the file and size, per tensor.
    places: Vec<(String, u64, u64)>,
    total: u64,
}

impl Writer {
    /// Begins the file `path` of a codec whose tensors are the planes and tables of `recipe`. The file of a codec that this
    /// program does not know holds the recipe, too, so that it can be opened by it.
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

    /// Begins the file `path` of a codec whose tensors are not those of its recipe. Numbers of more bytes must come first,
    /// so that all are aligned.
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
        let (params, info) = (text_of(params), SourceInfo::new(source));
        let (method, meta) = (codec.name(), source.meta());
        Self::describe(path, &Description { method, params, meta, source: &info, recipe }, tensors)
    }

    /// Begins the file `path` with this metadata. Tensors lie in the given order.
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
        let header = finish_header(Value::Object(header).to_string().into_bytes(), 0);
        places.iter_mut().for_each(|(_, start, _)| *start += 8 + header.len() as u64);
        let output = OutputFile::create(path)?;
        let mut file = output.file();
        file.write_all(&(header.len() as u64).to_le_bytes()).map_err(Error::io(path))?;
        file.write_all(&header).map_err(Error::io(path))?;
        let total = 8 + header.len() as u64 + end;
        Ok(Self { written: Mutex::new(8 + header.len() as u64), output, places, total })
    }

    /// Whether the file has a tensor of this name.
    pub fn has(&self, tensor: &str) -> bool {
        self.places.iter().any(|(name, ..)| name == tensor)
    }

    /// Writes `bytes` at byte `offset` of a tensor.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no such tensor, or the piece does not lie in it; [`Error::Io`].
    pub fn write(&self, tensor: &str, offset: u64, bytes: &[u8]) -> Result<()> {
        let place = self.places.iter().find(|(name, ..)| name == tensor);
        let (_, start, size) = place.ok_or_else(|| Error::parameter(tensor, "the file has no such tensor"))?;
        if offset + bytes.len() as u64 > *size {
            let problem = format!("{} bytes at {offset} are beyond its {size}", bytes.len());
            return Err(Error::parameter(tensor, problem));
        }
        let mut written = self.written.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let mut file = self.output.file();
        file.seek(SeekFrom::Start(start + offset)).map_err(Error::io(self.output.path()))?;
        file.write_all(bytes).map_err(Error::io(self.output.path()))?;
        *written += bytes.len() as u64;
        Ok(())
    }

    /// Puts the file in place and returns its size in bytes.
    ///
    /// # Errors
    /// [`Error::Parameter`] if pieces are missing; [`Error::Io`] if the file cannot be renamed.
    pub fn commit(self) -> Result<u64> {
        let written = self.written.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        if written != self.total {
            return Err(Error::parameter("tensors", format!("found {written} bytes, expected {}", self.total)));
        }
        self.output.commit()?;
        Ok(self.total)
    }
}

/// Parameters as the metadata has them.
fn text_of(params: &Values) -> Map<String, Value> {
    params.iter().map(|(name, text)| (name.into(), text.into())).collect()
}

/// A header with room for the error, of `least` bytes at least: spaces up to a multiple of 64 align the first tensor.
pub(in crate::codec) fn finish_header(mut header: Vec<u8>, least: usize) -> Vec<u8> {
    header.resize(((8 + header.len() + ROOM_FOR_ERROR).next_multiple_of(64) - 8).max(least), b' ');
    header
}

/// Adds the error to the header of the complete file `path`.
///
/// # Errors
/// [`Error::Invalid`] if it is no such file, or has no room in its header; [`Error::Io`].
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
        return Err(Error::invalid(path, "header", "there is no room for the error"));
    }
    bytes.resize(header.len(), b' ');
    file.seek(SeekFrom::Start(8)).and_then(|_| file.write_all(&bytes)).map_err(Error::io(path))
}
