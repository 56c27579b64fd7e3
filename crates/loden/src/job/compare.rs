//! Errors and sizes of compressed materials.

use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;

use super::{Opened, open};
use crate::btf::BtfSource;
use crate::codec::{self, Codec, CompressedBtf};
use crate::import::Measured;
use crate::material::Brdf;
use crate::memory;
use crate::metric::{self, Report, RoundTrip};
use crate::params::{Given, Values};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// A material compared with the measurement. Errors are fractions of 255: 0.035 is 8.9 grey levels.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// The file of the material.
    pub file: PathBuf,
    /// Its codec, or the format of another measurement.
    pub method: String,
    /// The parameters of the codec.
    pub params: Values,
    /// The errors.
    #[serde(flatten)]
    pub report: Report,
    /// Size of the file or files.
    pub bytes: u64,
    /// Ratio of the raw 8-bit size to this size.
    pub ratio_raw8: f64,
    /// Ratio of the size of the measurement's files to this size.
    pub ratio_source: f64,
    /// Seconds to compress the measurement again with the same parameters on this machine.
    pub encode_s: Option<f64>,
    /// Seconds to decode every image.
    pub decode_s: f64,
    /// Peak resident memory while compressing.
    pub peak_rss_bytes: Option<u64>,
}

/// A BRDF compared with another.
#[derive(Debug, Clone, Serialize)]
pub struct BrdfComparison {
    /// The file of the other BRDF.
    pub file: PathBuf,
    /// Its format.
    pub kind: &'static str,
    /// The errors.
    #[serde(flatten)]
    pub error: RoundTrip,
}

/// The result of [`compare_files`], in the order of the files.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum Comparisons {
    /// Materials compared with a BTF.
    Btf(Vec<Comparison>),
    /// BRDFs compared with a BRDF.
    Brdf(Vec<BrdfComparison>),
}

/// Compares materials with the measurement `source`: compressed BTFs or other BTFs of the same directions with a BTF, BRDFs
/// with a BRDF at its measured directions. `encode` compresses again to measure time and memory.
///
/// # Errors
/// Errors of reading; [`Error::Invalid`] or [`Error::Unsupported`] naming a file that does not match the measurement;
/// [`Error::Cancelled`].
pub fn compare_files(
    source: &Path,
    others: &[PathBuf],
    options: &Given,
    encode: bool,
    progress: &dyn Progress,
) -> Result<Comparisons> {
    match open(source, options, progress)?.measured.images() {
        Ok(source) => {
            let row = |other: &PathBuf| compare(source.as_ref(), other, encode, progress);
            others.iter().map(row).collect::<Result<_>>().map(Comparisons::Btf)
        }
        Err(brdf) => {
            let row = |other: &PathBuf| compare_brdf(brdf.as_ref(), other, progress);
            others.iter().map(row).collect::<Result<_>>().map(Comparisons::Brdf)
        }
    }
}

/// Compares one file with the measurement.
///
/// # Errors
/// As [`compare_files`].
pub fn compare(source: &dyn BtfSource, path: &Path, encode: bool, progress: &dyn Progress) -> Result<Comparison> {
    let Opened { kind, measured, .. } = open(path, &Given::default(), progress)?;
    let compressed = match measured {
        Measured::Compressed(compressed) => compressed,
        Measured::Btf(other) => {
            let row = compare_sources(source, other.as_ref(), kind, progress).map_err(|e| about(path, e))?;
            return Ok(Comparison { file: path.into(), ..row });
        }
        Measured::Brdf(_) => {
            return Err(Error::unsupported(path, format!("{kind} holds a BRDF, a BTF is needed here")));
        }
    };
    warn_of_another_source(source, &compressed, path, progress)?;
    // a file of rearranged parts has no codec
    let cost = match codec::by_name(compressed.method()) {
        Ok(codec) if encode => Some(encode_again(codec, source, compressed.as_ref(), path, progress)?),
        _ => None,
    };
    let decode_s = decode_all(compressed.as_ref(), progress)?;
    let report = metric::compare(source, compressed.as_ref(), progress).map_err(|e| about(path, e))?;
    let bytes = compressed.bytes();
    Ok(Comparison {
        file: path.into(),
        method: compressed.method().into(),
        params: compressed.params().clone(),
        report,
        bytes,
        ratio_raw8: source.meta().raw8_bytes() as f64 / bytes as f64,
        ratio_source: source.source_bytes() as f64 / bytes as f64,
        encode_s: cost.map(|cost| cost.0),
        decode_s,
        peak_rss_bytes: cost.map(|cost| cost.1),
    })
}

/// Warns if the file was not compressed from the files of `source`.
fn warn_of_another_source(
    source: &dyn BtfSource,
    compressed: &CompressedBtf,
    path: &Path,
    progress: &dyn Progress,
) -> Result<()> {
    let Some(of) = &compressed.source().identity else { return Ok(()) };
    if let Some(found) = source.identity()?.filter(|found| found.sha256 != of.sha256) {
        let (path, of, found) = (path.display(), &of.name, &found.name);
        progress.warn(&format!(
            "{path} was compressed from another source: the content of its {of} is not that of {found}"
        ));
    }
    Ok(())
}

/// Compares another BRDF at the measured directions of the first.
///
/// # Errors
/// As [`compare_files`].
pub fn compare_brdf(brdf: &dyn Brdf, path: &Path, progress: &dyn Progress) -> Result<BrdfComparison> {
    let Opened { kind, measured, .. } = open(path, &Given::default(), progress)?;
    match measured {
        Measured::Brdf(other) => {
            let error = metric::round_trip(&brdf.samples(), other.as_ref());
            Ok(BrdfComparison { file: path.into(), kind, error })
        }
        _ => Err(Error::unsupported(path, format!("{kind} holds a BTF, a BRDF is needed here"))),
    }
}

/// Compares with another BTF that is not compressed, of the kind `kind`; the row has no file.
///
/// # Errors
/// Errors of reading; [`Error::Parameter`] if the two do not match; [`Error::Cancelled`].
pub fn compare_sources(
    source: &dyn BtfSource,
    other: &dyn BtfSource,
    kind: &str,
    progress: &dyn Progress,
) -> Result<Comparison> {
    let start = Instant::now();
    (0..other.meta().views.len()).into_par_iter().try_for_each(|view| other.view(view).map(drop))?;
    let decode_s = start.elapsed().as_secs_f64();
    let bytes = other.source_bytes();
    Ok(Comparison {
        file: PathBuf::new(),
        method: kind.into(),
        params: Values::defaults(&[]),
        report: metric::compare(source, other, progress)?,
        bytes,
        ratio_raw8: source.meta().raw8_bytes() as f64 / bytes as f64,
        ratio_source: source.source_bytes() as f64 / bytes as f64,
        encode_s: None,
        decode_s,
        peak_rss_bytes: None,
    })
}

/// Names the one of several files that does not match the measurement.
fn about(path: &Path, error: Error) -> Error {
    match error {
        Error::Parameter { name, problem } => Error::invalid(path, name, problem),
        other => other,
    }
}

/// Time in seconds and peak memory of compressing again.
fn encode_again(
    codec: &dyn Codec,
    source: &dyn BtfSource,
    compressed: &CompressedBtf,
    path: &Path,
    progress: &dyn Progress,
) -> Result<(f64, u64)> {
    // beside the file: there was room for it before
    let beside = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = tempfile::tempdir_in(beside).or_else(|_| tempfile::tempdir()).map_err(Error::io(beside))?;
    memory::reset_peak();
    let start = Instant::now();
    codec.encode(source, compressed.params(), &folder.path().join("again.loden"), progress)?;
    Ok((start.elapsed().as_secs_f64(), memory::peak()))
}

/// Seconds to decode every image.
fn decode_all(compressed: &CompressedBtf, progress: &dyn Progress) -> Result<f64> {
    let meta = compressed.meta();
    let task = Task::new(progress, "decode", meta.views.len() as u64);
    let start = Instant::now();
    let decode = |texels: &mut Vec<f32>, view: usize| {
        texels.resize(meta.view_len(), 0.0);
        compressed.decode_view(view, texels)?;
        std::hint::black_box(&texels);
        task.advance(1)
    };
    (0..meta.views.len()).into_par_iter().map_init(Vec::new, decode).collect::<Result<()>>()?;
    Ok(start.elapsed().as_secs_f64())
}
