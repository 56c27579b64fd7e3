//! Compression with a report.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::{Comparison, compare};
use crate::btf::BtfSource;
use crate::codec::{self, Codec, Finish, Goal};
use crate::memory::{self, Memory};
use crate::metric::Report;
use crate::params::Values;
use crate::progress::Progress;
use crate::{Error, Result};

/// A compressed file and how it was made.
#[derive(Debug, Clone, Serialize)]
pub struct Compression {
    /// The file.
    pub output: PathBuf,
    /// The codec.
    pub method: &'static str,
    /// Its parameters.
    pub params: Values,
    /// The lossless stage, or `none`.
    pub lossless: &'static str,
    /// Size of the file.
    pub bytes: u64,
    /// Ratio of the raw 8-bit size to this size.
    pub ratio_raw8: f64,
    /// Ratio of the size of the measurement's files to this size.
    pub ratio_source: f64,
    /// Seconds to encode, for all trials together.
    pub encode_s: f64,
    /// Seconds to measure the error.
    pub measure_s: f64,
    /// Number of files encoded to meet the goal.
    pub trials: usize,
    /// The error, if it was measured.
    pub error: Option<Report>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
}

/// Settings of a compression.
pub struct CompressRequest {
    /// The method.
    pub codec: &'static dyn Codec,
    /// Its parameters.
    pub params: Values,
    /// The goal of the search for parameters, if there is one.
    pub goal: Goal,
    /// Steps after encoding.
    pub finish: Finish,
    /// Memory limit; fewer threads are used if necessary.
    pub memory: Option<Memory>,
}

/// Compresses a BTF into the file `output` by [`codec::compress`], within the memory limit if one is given.
///
/// # Errors
/// As [`codec::compress`] and [`codec::within`].
pub fn compress(
    source: &dyn BtfSource,
    request: &CompressRequest,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Compression> {
    let CompressRequest { codec, params, goal, finish, memory } = request;
    let (codec, goal, finish) = (*codec, *goal, *finish);
    memory::reset_peak();
    let work = || codec::compress(codec, source, params, goal, finish, output, progress);
    let done = match *memory {
        Some(memory) => codec::within(memory, codec, source.meta(), params, goal, work)?,
        None => work()?,
    };
    done.warnings.iter().for_each(|warning| progress.warn(warning));
    Ok(Compression {
        output: output.into(),
        method: codec.name(),
        params: done.params,
        lossless: finish.lossless.map_or("none", |stage| stage.name),
        bytes: done.bytes,
        ratio_raw8: source.meta().raw8_bytes() as f64 / done.bytes as f64,
        ratio_source: source.source_bytes() as f64 / done.bytes as f64,
        encode_s: done.encode_s,
        measure_s: done.measure_s,
        trials: done.trials,
        error: done.error,
        peak_rss_bytes: memory::peak(),
    })
}

/// Compresses a BTF by `pvmf` once for each number of components possible, into files `pvmf-cN.loden` in `folder`, and
/// compares these with the source.
///
/// # Errors
/// [`Error::Parameter`] if no number of components is possible; errors of encoding and comparing.
pub fn compress_components(
    source: &dyn BtfSource,
    components: &[usize],
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Comparison>> {
    let meta = source.meta();
    let rank = meta.texels().saturating_sub(1).min(3 * meta.lights.len());
    let codec = codec::by_name("pvmf")?;
    let mut rows = Vec::new();
    for &components in components.iter().filter(|&&c| (1..=rank).contains(&c)) {
        let path = folder.join(format!("pvmf-c{components}.loden"));
        let params = Values::new(codec.params(), [("components", components.to_string().as_str())])?;
        progress.stage(&format!("compressing with {components} components"));
        memory::reset_peak();
        let start = Instant::now();
        codec.encode(source, &params, &path, progress)?;
        let (encode_s, peak) = (start.elapsed().as_secs_f64(), memory::peak());
        let row = compare(source, &path, false, progress)?;
        rows.push(Comparison { encode_s: Some(encode_s), peak_rss_bytes: Some(peak), ..row });
    }
    if rows.is_empty() {
        let problem = format!("none of {components:?} is between 1 and {rank}, the rank of this measurement");
        return Err(Error::parameter("components", problem));
    }
    Ok(rows)
}
