//! Files with losslessly packed tensors.
//!
//! # Model
//! A complete file is rewritten. Each tensor becomes a sequence of blocks, each of [`BLOCK`] bytes of its numbers
//! (the last may be shorter), shuffled and packed separately. The metadata entry `lossless` names the stage, and the
//! type and shape of each tensor. Each block has a checksum of its packed bytes. Codecs see nothing of this: the
//! container unpacks the tensors when it is opened.
//!
//! # Limits
//! An open file holds all its numbers in memory.
//!
//! # References
//! welch1984, deutsch1996

use std::collections::BTreeMap;
use std::io::{Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;
use safetensors::Dtype;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::container::{Container, finish_header, limit};
use super::lossless::{Stage, by_name};
use crate::memory::Pages;
use crate::output::{self, OutputFile};
use crate::{Error, Result};

/// Unpacked bytes per block, a whole number of any type.
const BLOCK: usize = 4 << 20;

/// Upper bound of the compression ratio of any stage: zstd stores 128 KiB of one repeated byte in 4 bytes.
const MAX_RATIO: u64 = 1 << 15;

/// Limit on the bytes of all tensors together.
const MAX_UNPACKED: u64 = 8 << 30;

/// Length, checksum, bytes.
pub fn block(bytes: &[u8]) -> Vec<u8> {
    let (length, sum) = (bytes.len() as u32, crc32fast::hash(bytes));
    [&length.to_le_bytes(), &sum.to_le_bytes(), bytes].concat()
}

/// The blocks of a stream; the error describes the damage.
pub fn blocks(mut stream: &[u8]) -> std::result::Result<Vec<&[u8]>, String> {
    let mut blocks = Vec::new();
    while !stream.is_empty() {
        let n = blocks.len();
        let number = |at: usize| stream.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
        let (Some(length), Some(sum)) = (number(0), number(4)) else { return Err(format!("block {n} is cut off")) };
        let Some(bytes) = stream.get(8..8 + length as usize) else {
            return Err(format!("block {n} needs {length} bytes, found {}", stream.len() - 8));
        };
        if crc32fast::hash(bytes) != sum {
            return Err(format!("wrong checksum of block {n}"));
        }
        blocks.push(bytes);
        stream = &stream[8 + length as usize..];
    }
    Ok(blocks)
}

/// The metadata entry.
#[derive(Debug, Serialize, Deserialize)]
struct Packed {
    stage: String,
    tensors: BTreeMap<String, Form>,
}

/// Description of an unpacked tensor.
#[derive(Debug, Serialize, Deserialize)]
struct Form {
    dtype: Dtype,
    shape: Vec<usize>,
}

/// Rewrites the complete file `path`, packed by `stage`, unless that makes it larger. Returns the size of the packed file
/// in bytes.
///
/// # Errors
/// Errors of opening it; [`Error::Io`].
pub fn pack(path: &Path, stage: &Stage) -> Result<u64> {
    let container = Container::open(path)?;
    let failed = || Error::unsupported(path, format!("{} failed to pack it", stage.name));
    let tensors = container.stored();
    let forms = tensors.iter().map(|&(name, dtype, shape, _)| (name.into(), Form { dtype, shape: shape.to_vec() }));
    let entry = json!(Packed { stage: stage.name.into(), tensors: forms.collect() }).to_string();
    // the size of the header is known only at the end: reserve room for the largest numbers
    let header = |places: &[Range<u64>]| {
        let mut header = json!({ "__metadata__": container.metadata() });
        // packed blocks have checksums of their own
        if let Some(metadata) = header["__metadata__"].as_object_mut() {
            metadata.remove("checksums");
        }
        header["__metadata__"]["lossless"] = Value::String(entry.clone());
        for (&(name, ..), place) in tensors.iter().zip(places) {
            let offsets = [place.start, place.end];
            header[name] = json!({ "dtype": "U8", "shape": [place.end - place.start], "data_offsets": offsets });
        }
        header.to_string().into_bytes()
    };
    let room = finish_header(header(&vec![u64::MAX / 2..u64::MAX; tensors.len()]), 0).len();
    let output = OutputFile::create(path)?;
    let mut file = output.file();
    file.seek(SeekFrom::Start(8 + room as u64)).map_err(output::failed(path))?;
    let (mut places, mut end) = (Vec::new(), 0);
    for &(_, dtype, _, bytes) in &tensors {
        let start = end;
        let parts: Vec<&[u8]> = bytes.chunks(BLOCK).collect();
        for some in parts.chunks(rayon::current_num_threads()) {
            let packed: Option<Vec<Vec<u8>>> = some
                .par_iter()
                .map(|part| stage.pack(part, dtype.bitsize() / 8).map(|packed| block(&packed)))
                .collect();
            for packed in packed.ok_or_else(failed)? {
                file.write_all(&packed).map_err(output::failed(path))?;
                end += packed.len() as u64;
            }
        }
        places.push(start..end);
    }
    let header = finish_header(header(&places), room);
    file.seek(SeekFrom::Start(0)).map_err(output::failed(path))?;
    file.write_all(&(room as u64).to_le_bytes()).map_err(output::failed(path))?;
    file.write_all(&header).map_err(output::failed(path))?;
    drop(tensors);
    drop(container);
    let size = 8 + room as u64 + end;
    if size < std::fs::metadata(path).map_err(Error::io(path))?.len() {
        output.commit()?;
    }
    Ok(size)
}

/// Content of a packed file.
pub struct Unpacked {
    /// The stage it is packed with.
    pub stage: &'static Stage,
    /// Type, shape and range in `bytes` of each tensor.
    pub tensors: BTreeMap<String, (Dtype, Vec<usize>, Range<usize>)>,
    /// The numbers; each tensor is aligned to 64 bytes.
    pub bytes: Pages<u8>,
}

/// Unpacks the tensors of the file `path` with the metadata entry `entry`; `stored` are their names and packed bytes.
///
/// # Errors
/// [`Error::Invalid`] or [`Error::Limit`] naming the tensor, before any memory is allocated.
pub fn unpack<'a>(path: &Path, entry: &str, stored: impl Iterator<Item = (&'a str, &'a [u8])>) -> Result<Unpacked> {
    let invalid = |problem: String| Error::invalid(path, "lossless", problem);
    let Packed { stage, mut tensors } = serde_json::from_str(entry).map_err(|e| invalid(e.to_string()))?;
    let stage = by_name(&stage).map_err(|e| invalid(e.to_string()))?;
    // Check all sizes before allocating
    let (mut found, mut work, mut end) = (BTreeMap::new(), Vec::new(), 0u64);
    for (name, bytes) in stored {
        let field = format!("tensor {name}");
        let Form { dtype, shape } =
            tensors.remove(name).ok_or_else(|| invalid(format!("it does not describe tensor {name}")))?;
        let number = [Dtype::U8, Dtype::F16, Dtype::F32].contains(&dtype).then(|| dtype.bitsize() as u64 / 8);
        let number = number.ok_or_else(|| Error::invalid(path, &field, format!("found type {dtype:?}")))?;
        let size = shape.iter().try_fold(number, |size, &n| size.checked_mul(n as u64)).unwrap_or(u64::MAX);
        let most = MAX_RATIO.saturating_mul(bytes.len() as u64).min(MAX_UNPACKED.saturating_sub(end));
        if size > most {
            return Err(limit(path, &format!("{field}: unpacked size"), size, most));
        }
        let blocks = blocks(bytes).map_err(|problem| Error::invalid(path, &field, problem))?;
        let count = size.div_ceil(BLOCK as u64);
        if blocks.len() as u64 != count {
            let problem = format!("found {} blocks, expected {count} for {size} bytes", blocks.len());
            return Err(Error::invalid(path, &field, problem));
        }
        let range = end as usize..(end + size) as usize;
        end = (end + size).next_multiple_of(64);
        found.insert(name.to_owned(), (dtype, shape, range.clone()));
        work.push((field, range, blocks, dtype.bitsize() / 8));
    }
    if let Some(name) = tensors.keys().next() {
        return Err(invalid(format!("there is no tensor {name}")));
    }
    // Unpack the blocks
    let mut bytes = Pages::zeros(end as usize)?;
    for (field, range, blocks, size) in work {
        bytes[range].par_chunks_mut(BLOCK).zip(blocks).enumerate().try_for_each(|(n, (out, packed))| {
            let problem = format!("block {n} does not unpack to {} bytes", out.len());
            stage.unpack(packed, size, out).ok_or_else(|| Error::invalid(path, &field, problem))
        })?;
    }
    Ok(Unpacked { stage, tensors: found, bytes })
}
