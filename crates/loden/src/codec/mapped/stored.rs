//! Files with a map: those of the sample, with one more tensor.

use std::io::{Read, Write};
use std::path::Path;

use flate2::read::ZlibDecoder;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::coding::{MAX_TEXELS_PER_BYTE, decoded, encoded};
use super::{Source, SourceMap};
use crate::btf::{BtfMeta, SampleType};
use crate::codec::CompressedBtf;
use crate::codec::container::{Container, TensorSpec, VERSION_WITH_SOURCES, check_size, finish_header};
use crate::codec::packed::pack;
use crate::codec::parts::Numbers;
use crate::input::guarded;
use crate::output::{OutputFile, failed};
use crate::{Error, Result};

/// Name of the tensor and of the metadata entry.
const SOURCES: &str = "sources";

/// Upper bound of the compression ratio of zlib.
const MAX_RATIO: usize = 1032;

/// The metadata entry: the size of the result.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Size {
    width: usize,
    height: usize,
    #[serde(default)]
    coding: Coding,
}

/// How the tensor holds the sources.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Coding {
    /// A zlib stream of differences, as the first files have it.
    #[default]
    Zlib,
    /// Entropy-coded continuations.
    Range,
}

impl Coding {
    /// Most texels of a stream of this many bytes.
    fn most(self, bytes: usize) -> usize {
        match self {
            Self::Zlib => bytes.saturating_mul(MAX_RATIO) / 4,
            // trailing zeros are left out
            Self::Range => (bytes + 1).saturating_mul(MAX_TEXELS_PER_BYTE),
        }
    }
}

/// The source that continues what is before a texel.
fn expected(sources: &[Source], texel: usize, width: usize) -> Source {
    match texel.checked_sub(width) {
        _ if !texel.is_multiple_of(width) => {
            let Source { x, y } = sources[texel - 1];
            Source { x: x.wrapping_add(1), y }
        }
        Some(above) => Source { x: sources[above].x, y: sources[above].y.wrapping_add(1) },
        None => Source::default(),
    }
}

/// The map of a zlib stream of 16-bit numbers: how far each source is from the one that continues its left neighbour's, in the
/// first column from the one that continues the row above. Low bytes of all columns, high bytes, then those of the rows.
fn unpacked(stream: &[u8], width: usize, height: usize) -> std::result::Result<SourceMap, String> {
    let texels = width * height;
    let mut bytes = vec![0; 4 * texels];
    let filled = guarded("zlib", || ZlibDecoder::new(stream).read_exact(&mut bytes))?;
    filled.map_err(|e| format!("does not unpack to {} bytes: {e}", 4 * texels))?;
    let mut sources = Vec::with_capacity(texels);
    for texel in 0..texels {
        let Source { x, y } = expected(&sources, texel, width);
        let number = |k: usize| u16::from_le_bytes([bytes[k * texels + texel], bytes[(k + 1) * texels + texel]]);
        sources.push(Source { x: x.wrapping_add(number(0)), y: y.wrapping_add(number(2)) });
    }
    Ok(SourceMap { width, height, sources })
}

/// The map of an open file, if it has one.
///
/// # Errors
/// [`Error::Invalid`] or [`Error::Limit`] naming the file and the field.
pub fn read(container: &Container) -> Result<Option<SourceMap>> {
    let Some(entry) = container.metadata().get(SOURCES) else { return Ok(None) };
    let (path, sample) = (container.path(), container.meta());
    let Size { width, height, coding } =
        serde_json::from_str(entry).map_err(|e| Error::invalid(path, SOURCES, e.to_string()))?;
    check_mapped(sample, width, height, path)?;
    let invalid = |problem: String| Error::invalid(path, format!("tensor {SOURCES}"), problem);
    let [bytes] = *container.shape(SOURCES).ok_or_else(|| invalid("it is missing".into()))? else {
        return Err(invalid("found several dimensions, expected one".into()));
    };
    if width * height > coding.most(bytes) {
        return Err(invalid(format!("found {bytes} bytes, too few for {width} x {height} texels")));
    }
    let numbers = container.numbers(&spec(bytes))?;
    let Numbers::U8(stream) = numbers else { return Err(invalid("found another type, expected U8".into())) };
    let map = match coding {
        Coding::Zlib => unpacked(&stream, width, height).map_err(invalid)?,
        Coding::Range => decoded(&stream, [width, height], [sample.width, sample.height])
            .ok_or_else(|| invalid(format!("is damaged, or not of {width} x {height} texels")))?,
    };
    map.check(sample.width, sample.height).map_err(|e| invalid(e.to_string()))?;
    Ok(Some(map))
}

/// Checks that a sample with the description `meta` can be stored with a result of this size.
///
/// # Errors
/// [`Error::Limit`] naming the file `path`.
pub fn check_mapped(meta: &BtfMeta, width: usize, height: usize, path: &Path) -> Result<()> {
    check_size(path, &BtfMeta { width, height, ..meta.clone() })
}

fn spec(bytes: usize) -> TensorSpec {
    TensorSpec { name: SOURCES.into(), sample_type: SampleType::U8, shape: vec![bytes] }
}

/// Stores a compressed BTF with its texels rearranged by `map`, and returns the size of the file in bytes. Its tensors stay as
/// they are, and the map is added; if it has a map already, the new one is applied after that. The error of the file is not
/// kept.
///
/// # Errors
/// As [`SourceMap::check`]; [`Error::Limit`] if a decoded view were too large; [`Error::Io`].
pub fn store_mapped(btf: &CompressedBtf, map: &SourceMap, path: &Path) -> Result<u64> {
    let container = btf.container();
    let composed = btf.source_map().map(|first| map.after(first)).transpose()?;
    let map = composed.as_ref().unwrap_or(map);
    map.check(container.meta().width, container.meta().height)?;
    check_mapped(container.meta(), map.width, map.height, path)?;
    let sources = encoded(map, [container.meta().width, container.meta().height]);
    let (name, shape) = (SOURCES, [sources.len()]);
    let mut tensors = container.stored();
    tensors.retain(|(name, ..)| *name != SOURCES);
    tensors.push((name, safetensors::Dtype::U8, &shape, &sources));
    let output = OutputFile::create(path)?;
    let header = header(container, &tensors, Size { width: map.width, height: map.height, coding: Coding::Range });
    let header = finish_header(header.to_string().into_bytes(), 0);
    let mut file = output.file();
    let mut write = |bytes: &[u8]| file.write_all(bytes).map_err(failed(path));
    write(&(header.len() as u64).to_le_bytes())?;
    write(&header)?;
    let mut size = 8 + header.len() as u64;
    for (.., bytes) in &tensors {
        write(bytes)?;
        size += bytes.len() as u64;
    }
    if let Some(stage) = container.lossless() {
        size = pack(output.temporary(), stage)?;
    }
    output.commit()?;
    Ok(size)
}

/// The header of a file with these tensors.
fn header(container: &Container, tensors: &[(&str, safetensors::Dtype, &[usize], &[u8])], size: Size) -> Value {
    let mut metadata = container.metadata().clone();
    for entry in ["error", "lossless"] {
        metadata.remove(entry);
    }
    let sums: Map<String, Value> =
        tensors.iter().map(|(name, .., bytes)| ((*name).into(), crc32fast::hash(bytes).into())).collect();
    metadata.insert("loden".into(), VERSION_WITH_SOURCES.into());
    metadata.insert("checksums".into(), Value::Object(sums).to_string());
    metadata.insert(SOURCES.into(), json!(size).to_string());
    let mut header = json!({ "__metadata__": metadata });
    let mut end = 0;
    for (name, dtype, shape, bytes) in tensors {
        let start = end;
        end += bytes.len();
        header[*name] = json!({ "dtype": dtype, "shape": shape, "data_offsets": [start, end] });
    }
    header
}
