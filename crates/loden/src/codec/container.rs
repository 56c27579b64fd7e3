//! The stored form: a `.loden` file is a safetensors file whose metadata says how to decode it.
//!
//! # Model
//! Eight bytes of header length, a JSON header (string metadata, then name, type, shape and offsets per tensor),
//! the tensors without gaps, little endian. Everything derives from the input and the parameters, so the same
//! compression gives the same bytes. Room is left in the header for the error, which is known last. `docs/format.md` describes the metadata and each method's tensors.
//!
//! # Limits
//! A header of 16 MiB, images of 65536 texels a side and 4 GiB of decoded numbers per view. The file is memory-mapped:
//! it must not be changed while it is open.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use half::f16;
use memmap2::Mmap;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::Codec;
use super::lossless::Stage;
use super::packed::unpack;
use super::parts::{Memory, Numbers, Recipe, Shared};
use crate::btf::{BtfMeta, BtfSource, SampleType};
use crate::input;
use crate::memory::Pages;
use crate::metric::Report;
use crate::output::OutputFile;
use crate::params::{Param, Values};
use crate::{Error, Result};

/// The version this program writes, and the only one it reads.
pub const VERSION: &str = "1";

/// Bytes of the header that are left free for the error.
const ROOM_FOR_ERROR: usize = 256;

const MAX_HEADER: u64 = 16 << 20;
const MAX_SIDE: u64 = 1 << 16;
const MAX_VIEW_NUMBERS: u64 = 1 << 30;

/// What a stored BTF was compressed from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SourceInfo {
    /// Bytes of the files it was read from.
    pub bytes: u64,
    /// The number type of the source's texels.
    pub sample_type: SampleType,
    /// Pairs (view, light) that had not been measured.
    pub missing: Vec<(usize, usize)>,
}

impl SourceInfo {
    /// Describes `source`.
    pub fn new(source: &dyn BtfSource) -> Self {
        Self {
            bytes: source.source_bytes(),
            sample_type: source.meta().sample_type,
            missing: source.missing().to_vec(),
        }
    }
}

/// A tensor to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct TensorSpec {
    /// Its name in the file.
    pub name: String,
    /// Its number type.
    pub sample_type: SampleType,
    /// Its shape, slowest dimension first.
    pub shape: Vec<usize>,
}

impl TensorSpec {
    pub(super) fn bytes(&self) -> u64 {
        self.shape.iter().map(|&n| n as u64).product::<u64>() * self.sample_type.bytes() as u64
    }
}

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
        let unknown = super::by_name(codec.name()).is_err();
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
    pub(super) fn describe(path: &Path, about: &Description, tensors: &[TensorSpec]) -> Result<Self> {
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
pub(super) fn finish_header(mut header: Vec<u8>, least: usize) -> Vec<u8> {
    header.resize(((8 + header.len() + ROOM_FOR_ERROR).next_multiple_of(64) - 8).max(least), b' ');
    header
}

/// Where a tensor lies in its container, after its type and shape were checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    range: Range<usize>,
}

#[derive(Debug)]
struct Stored {
    dtype: Dtype,
    shape: Vec<usize>,
    range: Range<usize>,
}

/// The bytes that tensors lie in.
#[derive(Debug)]
enum Data {
    File(Mmap),
    Unpacked(Pages<u8>),
}

impl Memory for Data {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::File(map) => map,
            Self::Unpacked(pages) => pages,
        }
    }
}

/// An open `.loden` file whose header has been checked.
#[derive(Debug)]
pub struct Container {
    path: PathBuf,
    data: Arc<Data>,
    file_bytes: u64,
    metadata: BTreeMap<String, String>,
    lossless: Option<&'static Stage>,
    tensors: BTreeMap<String, Stored>,
    method: String,
    params: Map<String, Value>,
    meta: BtfMeta,
    source: SourceInfo,
    error: Option<Report>,
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

impl Container {
    /// Its tensors are not needed for now: memory goes back to the system, and the file is read again where it is,
    /// unless it is packed.
    pub fn release(&self) {
        if let Data::File(map) = &*self.data {
            input::release(map, 0..map.len());
        }
    }

    /// Opens `path`.
    ///
    /// # Errors
    /// [`Error::Invalid`], [`Error::Limit`] or [`Error::Unsupported`] naming the file and the field; [`Error::Io`].
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path))?;
        if file.metadata().map_err(Error::io(path))?.len() == 0 {
            return Err(Error::invalid(path, "header", "the file is empty"));
        }
        // SAFETY: the map is read only; that no one else changes the file is this format's stated requirement.
        let map = unsafe { Mmap::map(&file) }.map_err(Error::io(path))?;
        let length = map.get(..8).and_then(|b| b.try_into().ok()).map(u64::from_le_bytes);
        let Some(length) = length else {
            return Err(Error::invalid(path, "header", format!("the file ends after {} bytes", map.len())));
        };
        if length > MAX_HEADER {
            return Err(limit(path, "header length", length, MAX_HEADER));
        }
        let (length, header) =
            SafeTensors::read_metadata(&map).map_err(|e| Error::invalid(path, "header", e.to_string()))?;
        let tensors = header.tensors().into_iter().map(|(name, info)| {
            let (start, end) = info.data_offsets;
            let range = 8 + length + start..8 + length + end;
            (name, Stored { dtype: info.dtype, shape: info.shape.clone(), range })
        });
        let mut tensors: BTreeMap<String, Stored> = tensors.collect();
        let metadata: BTreeMap<String, String> = header.metadata().clone().unwrap_or_default().into_iter().collect();
        let text =
            |key: &str| metadata.get(key).ok_or_else(|| Error::invalid(path, key, "this metadata entry is missing"));
        let version = metadata.get("loden");
        match version.map(String::as_str) {
            Some(VERSION) => {}
            Some(other) => {
                let what = format!("format version {other:?} is not supported; this program reads version {VERSION}");
                return Err(Error::unsupported(path, what));
            }
            None => return Err(Error::invalid(path, "loden", "this is a safetensors file, but not of this format")),
        }
        let meta: BtfMeta = parse(path, "btf", text("btf")?)?;
        check_size(path, &meta)?;
        let source: SourceInfo = parse(path, "source", text("source")?)?;
        if let Some((view, light)) =
            source.missing.iter().find(|(v, l)| *v >= meta.views.len() || *l >= meta.lights.len())
        {
            return Err(Error::invalid(path, "source", format!("there is no pair ({view}, {light})")));
        }
        let params = parse(path, "params", text("params")?)?;
        let error = metadata.get("error").map(|text| parse(path, "error", text)).transpose()?;
        let method = text("method")?.clone();
        let (file_bytes, mut data, mut lossless) = (map.len() as u64, Data::File(map), None);
        if let Some(entry) = metadata.get("lossless") {
            let stored = tensors.iter().map(|(name, stored)| (name.as_str(), &data.bytes()[stored.range.clone()]));
            let unpacked = unpack(path, entry, stored)?;
            let of = |(name, (dtype, shape, range))| (name, Stored { dtype, shape, range });
            tensors = unpacked.tensors.into_iter().map(of).collect();
            (data, lossless) = (Data::Unpacked(unpacked.bytes), Some(unpacked.stage));
        }
        Ok(Self {
            path: path.into(),
            data: Arc::new(data),
            file_bytes,
            metadata,
            lossless,
            tensors,
            method,
            params,
            meta,
            source,
            error,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The size of the file.
    pub fn bytes(&self) -> u64 {
        self.file_bytes
    }

    /// The metadata as stored.
    pub(super) fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// The lossless stage that it was packed by.
    pub fn lossless(&self) -> Option<&'static Stage> {
        self.lossless
    }

    /// Name, type, shape and bytes of the tensors, in order of their places.
    pub(super) fn stored(&self) -> Vec<(&str, Dtype, &[usize], &[u8])> {
        let mut all: Vec<_> = self.tensors.iter().collect();
        all.sort_by_key(|(_, stored)| stored.range.start);
        let part = |range: &Range<usize>| &self.data.bytes()[range.clone()];
        all.into_iter().map(|(name, t)| (name.as_str(), t.dtype, &t.shape[..], part(&t.range))).collect()
    }

    /// The name of the codec that wrote it.
    pub fn method(&self) -> &str {
        &self.method
    }

    /// The source's size, directions and conventions; its sample type is in [`Container::source`].
    pub fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    /// What it was compressed from.
    pub fn source(&self) -> &SourceInfo {
        &self.source
    }

    /// How far its images were from the source, if that was measured.
    pub fn error(&self) -> Option<&Report> {
        self.error.as_ref()
    }

    /// The stored parameters, values as text, unchecked.
    pub fn params_text(&self) -> &Map<String, Value> {
        &self.params
    }

    /// The recipe in the metadata, if there is one; unchecked.
    ///
    /// # Errors
    /// [`Error::Invalid`] if it is not the text of one.
    pub fn recipe(&self) -> Result<Option<Recipe>> {
        self.metadata.get("recipe").map(|text| parse(&self.path, "recipe", text)).transpose()
    }

    /// The stored parameters, checked against the codec's table.
    ///
    /// # Errors
    /// [`Error::Invalid`] if one is missing, unknown or out of range.
    pub fn params(&self, table: &'static [Param]) -> Result<Values> {
        let invalid = |problem: String| Error::invalid(&self.path, "params", problem);
        if let Some(param) = table.iter().find(|p| !self.params.contains_key(p.name)) {
            return Err(invalid(format!("{} is missing", param.name)));
        }
        let mut values = Values::defaults(table);
        for (name, value) in &self.params {
            let text = value.as_str().ok_or_else(|| invalid(format!("{name} is not a string")))?;
            values.set(name, text).map_err(|e| invalid(e.to_string()))?;
        }
        Ok(values)
    }

    /// The shape of the tensor `name`, if there is one.
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.tensors.get(name).map(|stored| &stored.shape[..])
    }

    /// The tensor `name`, which must have this type and shape and, if of floating point, only finite numbers.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the tensor.
    pub fn tensor(&self, name: &str, dtype: SampleType, shape: &[usize]) -> Result<Tensor> {
        let invalid = |problem: String| Error::invalid(&self.path, format!("tensor {name}"), problem);
        let stored = self.tensors.get(name).ok_or_else(|| invalid("it is missing".into()))?;
        if stored.dtype != safetensors_dtype(dtype) {
            return Err(invalid(format!("found type {:?}, expected {:?}", stored.dtype, safetensors_dtype(dtype))));
        }
        if stored.shape != shape {
            return Err(invalid(format!("found shape {:?}, expected {shape:?}", stored.shape)));
        }
        let tensor = Tensor { range: stored.range.clone() };
        if self.u8(&tensor).as_ptr().align_offset(dtype.bytes()) != 0 {
            return Err(invalid(format!("its offset is not a multiple of {} bytes", dtype.bytes())));
        }
        let finite = match dtype {
            SampleType::U8 => true,
            SampleType::F16 => all(self.f16(&tensor), |v| v.to_bits() & 0x7c00 != 0x7c00),
            SampleType::F32 => all(self.f32(&tensor), |v| v.is_finite()),
        };
        if finite { Ok(tensor) } else { Err(invalid("it holds a number that is not finite".into())) }
    }

    /// The numbers of a tensor, which share the file's map.
    ///
    /// # Errors
    /// As [`Container::tensor`].
    pub fn numbers(&self, spec: &TensorSpec) -> Result<Numbers> {
        let Tensor { range } = self.tensor(&spec.name, spec.sample_type, &spec.shape)?;
        let memory = || self.data.clone();
        Ok(match spec.sample_type {
            SampleType::U8 => Numbers::U8(Shared::new(memory(), range)),
            SampleType::F16 => Numbers::F16(Shared::new(memory(), range)),
            SampleType::F32 => Numbers::F32(Shared::new(memory(), range)),
        })
    }

    /// The bytes of a tensor of this container.
    pub fn u8(&self, tensor: &Tensor) -> &[u8] {
        &self.data.bytes()[tensor.range.clone()]
    }

    /// The numbers of a tensor of this container that was checked to be of type f16.
    pub fn f16(&self, tensor: &Tensor) -> &[f16] {
        bytemuck::cast_slice(self.u8(tensor))
    }

    /// The numbers of a tensor of this container that was checked to be of type f32.
    pub fn f32(&self, tensor: &Tensor) -> &[f32] {
        bytemuck::cast_slice(self.u8(tensor))
    }
}

/// Whether all values pass; blocks without a branch, so that the test of a large file is not felt.
fn all<T: Copy>(values: &[T], test: impl Fn(T) -> bool) -> bool {
    values.chunks(1024).all(|block| block.iter().fold(true, |ok, &v| ok & test(v)))
}

fn safetensors_dtype(sample_type: SampleType) -> Dtype {
    match sample_type {
        SampleType::U8 => Dtype::U8,
        SampleType::F16 => Dtype::F16,
        SampleType::F32 => Dtype::F32,
    }
}

fn parse<T: for<'a> Deserialize<'a>>(path: &Path, field: &str, text: &str) -> Result<T> {
    serde_json::from_str(text).map_err(|e| Error::invalid(path, field, e.to_string()))
}

pub(super) fn limit(path: &Path, field: &str, found: u64, limit: u64) -> Error {
    Error::Limit { path: path.into(), field: field.into(), found, limit }
}

/// Holds sizes where no product of them overflows and a decoded view is of bearable size.
pub(super) fn check_size(path: &Path, meta: &BtfMeta) -> Result<()> {
    for (field, side) in [("width", meta.width), ("height", meta.height)] {
        match side as u64 {
            0 => return Err(Error::invalid(path, field, "found 0, expected at least 1")),
            side if side > MAX_SIDE => return Err(limit(path, field, side, MAX_SIDE)),
            _ => {}
        }
    }
    // a direction takes bytes in the header or is of a known set: these products of limited numbers do not overflow
    let view = meta.view_len() as u64;
    if view > MAX_VIEW_NUMBERS { Err(limit(path, "numbers in a decoded view", view, MAX_VIEW_NUMBERS)) } else { Ok(()) }
}
