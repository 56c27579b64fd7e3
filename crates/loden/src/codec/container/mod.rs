//! The stored form: a `.loden` file is a safetensors file whose metadata says how to decode it.
//!
//! # Model
//! Eight bytes of header length; a JSON header with string metadata, then name, type, shape and offsets per tensor;
//! the tensors without gaps, little endian. Each tensor has a checksum in the metadata. Everything derives from the
//! input and the parameters, so the same compression gives the same bytes. The header leaves room for the error, which is known last. `docs/format.md`
//! describes the metadata and the tensors of each method.
//!
//! # Limits
//! The header is at most 16 MiB, images at most 65536 texels per side, and a view at most 4 GiB when decoded. The
//! file is memory-mapped: it must not change while it is open.

mod write;

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use memmap2::Mmap;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::lossless::Stage;
use super::packed::unpack;
use super::parts::{Memory, Numbers, Recipe, Shared};
use crate::btf::{BtfMeta, BtfSource, Identity, SampleType};
use crate::input;
use crate::memory::Pages;
use crate::metric::Report;
use crate::params::{Param, Values};
use crate::{Error, Result};

pub use write::Writer;
pub(super) use write::finish_header;
pub(super) use write::{Description, HISTORY, write_error};

/// The version this program writes.
pub const VERSION: &str = "2";

/// The version of files whose texels are rearranged by a map.
pub const VERSION_WITH_SOURCES: &str = "3";

/// The versions that this program reads. Version 1 has no checksums, and nothing about the source but its size.
pub const READABLE: [&str; 3] = ["1", VERSION, VERSION_WITH_SOURCES];

const MAX_HEADER: u64 = 16 << 20;
const MAX_SIDE: u64 = 1 << 16;
const MAX_VIEW_NUMBERS: u64 = 1 << 30;

/// What a stored BTF was compressed from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SourceInfo {
    /// Size of the original files in bytes.
    pub bytes: u64,
    /// The number type of the source's texels.
    pub sample_type: SampleType,
    /// Pairs (view, light) that were not measured.
    pub missing: Vec<(usize, usize)>,
    /// What its files were, if it was read from files.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub identity: Option<Identity>,
}

impl SourceInfo {
    /// Describes `source`, whose files are read for their checksum.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn new(source: &dyn BtfSource) -> Result<Self> {
        Ok(Self {
            bytes: source.source_bytes(),
            sample_type: source.meta().sample_type,
            missing: source.missing().to_vec(),
            identity: source.identity()?,
        })
    }

    /// Checks that the missing pairs exist; the error names one that does not.
    pub(super) fn check(&self, meta: &BtfMeta) -> std::result::Result<(), String> {
        match self.missing.iter().find(|(v, l)| *v >= meta.views.len() || *l >= meta.lights.len()) {
            Some((view, light)) => Err(format!("there is no pair ({view}, {light})")),
            None => Ok(()),
        }
    }
}

/// A tensor to write.
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

#[derive(Debug)]
struct Stored {
    dtype: Dtype,
    shape: Vec<usize>,
    range: Range<usize>,
}

/// The bytes that hold the tensors.
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
    about: About,
}

/// The metadata.
#[derive(Debug)]
struct About {
    method: String,
    params: Map<String, Value>,
    meta: BtfMeta,
    source: SourceInfo,
    error: Option<Report>,
    /// CRC-32 of each tensor's bytes; none in packed files and those of version 1.
    checksums: Option<BTreeMap<String, u32>>,
}

impl About {
    fn read(path: &Path, metadata: &BTreeMap<String, String>) -> Result<Self> {
        let text =
            |key: &str| metadata.get(key).ok_or_else(|| Error::invalid(path, key, "this metadata entry is missing"));
        match metadata.get("loden").map(String::as_str) {
            Some(version) if READABLE.contains(&version) => {}
            Some(other) => {
                let what = format!(
                    "format version {other:?} is not supported; this program reads up to {VERSION_WITH_SOURCES}"
                );
                return Err(Error::unsupported(path, what));
            }
            None => return Err(Error::invalid(path, "loden", "a safetensors file, but not a .loden file")),
        }
        let meta: BtfMeta = parse(path, "btf", text("btf")?)?;
        check_size(path, &meta)?;
        meta.check_pairs().map_err(|error| Error::invalid(path, "btf", error.to_string()))?;
        let source: SourceInfo = parse(path, "source", text("source")?)?;
        source.check(&meta).map_err(|problem| Error::invalid(path, "source", problem))?;
        let params = parse(path, "params", text("params")?)?;
        let error = metadata.get("error").map(|text| parse(path, "error", text)).transpose()?;
        let summed =
            metadata.get("loden").is_some_and(|version| version != READABLE[0]) && !metadata.contains_key("lossless");
        let checksums = if summed { Some(parse(path, "checksums", text("checksums")?)?) } else { None };
        Ok(Self { method: text("method")?.clone(), params, meta, source, error, checksums })
    }
}

/// Maps a file and checks the length of its header.
fn map(path: &Path) -> Result<Mmap> {
    let file = File::open(path).map_err(Error::io(path))?;
    if file.metadata().map_err(Error::io(path))?.len() == 0 {
        return Err(Error::invalid(path, "header", "the file is empty"));
    }
    // SAFETY: the map is read-only, and the format requires that nobody changes the file while it is open.
    let map = unsafe { Mmap::map(&file) }.map_err(Error::io(path))?;
    match map.get(..8).and_then(|b| b.try_into().ok()).map(u64::from_le_bytes) {
        None => Err(Error::invalid(path, "header", format!("the file is cut off after {} bytes", map.len()))),
        // the header of any safetensors file is an object
        Some(_) if map.get(8) != Some(&b'{') => Err(Error::unsupported(path, "is not a .loden file")),
        Some(length) if length > MAX_HEADER => Err(limit(path, "header length", length, MAX_HEADER)),
        Some(_) => Ok(map),
    }
}

impl Container {
    /// Returns the memory of the tensors to the system until they are next needed; they are then read from the file
    /// again. Does nothing for a packed file.
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
        let map = map(path)?;
        let (length, header) =
            SafeTensors::read_metadata(&map).map_err(|e| Error::invalid(path, "header", e.to_string()))?;
        let tensors = header.tensors().into_iter().map(|(name, info)| {
            let (start, end) = info.data_offsets;
            let range = 8 + length + start..8 + length + end;
            (name, Stored { dtype: info.dtype, shape: info.shape.clone(), range })
        });
        let mut tensors: BTreeMap<String, Stored> = tensors.collect();
        let metadata: BTreeMap<String, String> = header.metadata().clone().unwrap_or_default().into_iter().collect();
        let about = About::read(path, &metadata)?;
        let (file_bytes, mut data, mut lossless) = (map.len() as u64, Data::File(map), None);
        if let Some(entry) = metadata.get("lossless") {
            let stored = tensors.iter().map(|(name, stored)| (name.as_str(), &data.bytes()[stored.range.clone()]));
            let unpacked = unpack(path, entry, stored)?;
            let of = |(name, (dtype, shape, range))| (name, Stored { dtype, shape, range });
            tensors = unpacked.tensors.into_iter().map(of).collect();
            (data, lossless) = (Data::Unpacked(unpacked.bytes), Some(unpacked.stage));
        }
        Ok(Self { path: path.into(), data: Arc::new(data), file_bytes, metadata, lossless, tensors, about })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The size of the file in bytes.
    pub fn bytes(&self) -> u64 {
        self.file_bytes
    }

    /// The metadata, as stored.
    pub(super) fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// The lossless stage the file is packed with.
    pub fn lossless(&self) -> Option<&'static Stage> {
        self.lossless
    }

    /// Name, type, shape and bytes of all tensors, in file order.
    pub(super) fn stored(&self) -> Vec<(&str, Dtype, &[usize], &[u8])> {
        let mut all: Vec<_> = self.tensors.iter().collect();
        all.sort_by_key(|(_, stored)| stored.range.start);
        let part = |range: &Range<usize>| &self.data.bytes()[range.clone()];
        all.into_iter().map(|(name, t)| (name.as_str(), t.dtype, &t.shape[..], part(&t.range))).collect()
    }

    /// The name of the codec that wrote it.
    pub fn method(&self) -> &str {
        &self.about.method
    }

    /// Size, directions and conventions of the source; [`Container::source`] has its sample type.
    pub fn meta(&self) -> &BtfMeta {
        &self.about.meta
    }

    /// What the file was compressed from.
    pub fn source(&self) -> &SourceInfo {
        &self.about.source
    }

    /// The error measured at compression, if any.
    pub fn error(&self) -> Option<&Report> {
        self.about.error.as_ref()
    }

    /// The stored parameters as text, unchecked.
    pub fn params_text(&self) -> &Map<String, Value> {
        &self.about.params
    }

    /// The recipe in the metadata, if any, unchecked.
    ///
    /// # Errors
    /// [`Error::Invalid`] if it cannot be parsed.
    pub fn recipe(&self) -> Result<Option<Recipe>> {
        self.metadata.get("recipe").map(|text| parse(&self.path, "recipe", text)).transpose()
    }

    /// The stored parameters, checked against the table of the codec. One that the codec did not have when the file was
    /// written has its default.
    ///
    /// # Errors
    /// [`Error::Invalid`] if one is unknown or out of range.
    pub fn params(&self, table: &'static [Param]) -> Result<Values> {
        let invalid = |problem: String| Error::invalid(&self.path, "params", problem);
        let mut values = Values::defaults(table);
        for (name, value) in &self.about.params {
            let text = value.as_str().ok_or_else(|| invalid(format!("{name} is not a string")))?;
            values.set(name, text).map_err(|e| invalid(e.to_string()))?;
        }
        Ok(values)
    }

    /// The shape of the tensor `name`, if it exists.
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.tensors.get(name).map(|stored| &stored.shape[..])
    }

    /// The numbers of a tensor, sharing the map of the file. The tensor must have this type and shape, and
    /// floating-point numbers must be finite.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the tensor.
    pub fn numbers(&self, TensorSpec { name, sample_type, shape }: &TensorSpec) -> Result<Numbers> {
        let invalid = |problem: String| Error::invalid(&self.path, format!("tensor {name}"), problem);
        let stored = self.tensors.get(name).ok_or_else(|| invalid("it is missing".into()))?;
        let dtype = safetensors_dtype(*sample_type);
        if stored.dtype != dtype {
            return Err(invalid(format!("found type {:?}, expected {dtype:?}", stored.dtype)));
        }
        if stored.shape != *shape {
            return Err(invalid(format!("found shape {:?}, expected {shape:?}", stored.shape)));
        }
        let bytes = sample_type.bytes();
        if let Some(checksums) = &self.about.checksums {
            match checksums.get(name) {
                Some(sum) if crc32fast::hash(&self.data.bytes()[stored.range.clone()]) == *sum => {}
                Some(_) => return Err(invalid("its bytes are damaged: the checksum does not agree".into())),
                None => return Err(invalid("it has no checksum".into())),
            }
        }
        if self.data.bytes()[stored.range.clone()].as_ptr().align_offset(bytes) != 0 {
            return Err(invalid(format!("its offset is not a multiple of {bytes} bytes")));
        }
        let (memory, range) = (self.data.clone(), stored.range.clone());
        let numbers = match sample_type {
            SampleType::U8 => Numbers::U8(Shared::new(memory, range)),
            SampleType::F16 => Numbers::F16(Shared::new(memory, range)),
            SampleType::F32 => Numbers::F32(Shared::new(memory, range)),
        };
        let finite = match &numbers {
            Numbers::F16(values) => all(values, |v| v.to_bits() & 0x7c00 != 0x7c00),
            Numbers::F32(values) => all(values, |v| v.is_finite()),
            _ => true,
        };
        if finite { Ok(numbers) } else { Err(invalid("it contains a number that is not finite".into())) }
    }
}

/// Whether all values pass; works in branch-free blocks so that testing a large file costs little.
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
    serde_json::from_str(text).map_err(|e| Error::invalid(path, field, input::in_words(&e.to_string())))
}

pub(super) fn limit(path: &Path, field: &str, found: u64, limit: u64) -> Error {
    Error::Limit { path: path.into(), field: field.into(), found, limit }
}

/// Checks that no product of the sizes overflows and that a decoded view is not too large.
pub(super) fn check_size(path: &Path, meta: &BtfMeta) -> Result<()> {
    for (field, side) in [("width", meta.width), ("height", meta.height)] {
        match side as u64 {
            0 => return Err(Error::invalid(path, field, "found 0, expected at least 1")),
            side if side > MAX_SIDE => return Err(limit(path, field, side, MAX_SIDE)),
            _ => {}
        }
    }
    // every direction takes bytes in the header or belongs to a known set, so these products cannot overflow
    let view = meta.view_len() as u64;
    if view > MAX_VIEW_NUMBERS { Err(limit(path, "numbers in a decoded view", view, MAX_VIEW_NUMBERS)) } else { Ok(()) }
}
