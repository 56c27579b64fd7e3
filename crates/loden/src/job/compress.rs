//! Compression with a report.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::sweep::{file_name, flags};
use super::{Comparison, Cost, Setting, compare, encode_here};
use crate::btf::BtfSource;
use crate::codec::{self, Codec, Finish, Goal, Outcome};
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
    /// Seconds in all.
    pub seconds: f64,
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
    let start = Instant::now();
    let work = || codec::compress(codec, source, params, goal, finish, output, progress);
    let done = match *memory {
        Some(memory) => codec::within(memory, codec, source.meta(), params, goal, work)?,
        None => work()?,
    };
    Ok(compression(source, codec, output, done, start, progress))
}

/// The report of a compression that began at `start`. Its warnings go to `progress`.
pub(super) fn compression(
    source: &dyn BtfSource,
    codec: &dyn Codec,
    output: &Path,
    done: Outcome,
    start: Instant,
    progress: &dyn Progress,
) -> Compression {
    done.warnings.iter().for_each(|warning| progress.warn(warning));
    Compression {
        output: output.into(),
        method: codec.name(),
        params: done.params,
        lossless: done.lossless.unwrap_or("none"),
        bytes: done.bytes,
        ratio_raw8: source.meta().raw8_bytes() as f64 / done.bytes as f64,
        ratio_source: source.source_bytes() as f64 / done.bytes as f64,
        seconds: start.elapsed().as_secs_f64(),
        encode_s: done.encode_s,
        measure_s: done.measure_s,
        trials: done.trials,
        error: done.error,
        peak_rss_bytes: memory::peak(),
    }
}

/// Compresses a BTF by several methods and settings, into files named after these in `folder`, and compares each file
/// with the source. Settings that do not suit the source are skipped with a warning.
///
/// # Errors
/// [`Error::Parameter`] if no setting suits the source; errors of encoding and comparing.
pub fn compress_settings(
    source: &dyn BtfSource,
    settings: &[(&'static dyn Codec, Setting)],
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Comparison>> {
    let mut rows = Vec::new();
    for (codec, setting) in settings {
        let path = folder.join(file_name(*codec, setting));
        progress.stage(&format!("compressing by {} {}", codec.name(), flags(setting)));
        match encode_here(*codec, source, setting, &path, progress) {
            Ok(Cost { encode_s, peak_rss_bytes }) => {
                let row = compare(source, &path, false, progress)?;
                rows.push(Comparison { encode_s: Some(encode_s), peak_rss_bytes, ..row });
            }
            Err(error @ Error::Parameter { .. }) => progress.warn(&error.to_string()),
            Err(other) => return Err(other),
        }
    }
    if rows.is_empty() {
        return Err(Error::parameter("components", "none of the numbers suits this measurement"));
    }
    Ok(rows)
}
