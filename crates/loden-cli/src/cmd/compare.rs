//! `loden compare`: how far compressed materials are from the measurement, and what they cost.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use loden::btf::BtfSource;
use loden::codec::{self, CompressedBtf};
use loden::import::Measured;
use loden::material::Brdf;
use loden::metric::{self, Report, RoundTrip};
use loden::progress::{Progress, Task};
use loden::{Error, import};
use rayon::prelude::*;
use serde::Serialize;

use crate::flags::Assumptions;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Compare {
    /// The measurement: anything `loden info` knows.
    source: PathBuf,
    /// Compressed materials, or other measurements with the same directions; of a BRDF, other BRDFs.
    #[arg(required = true)]
    compressed: Vec<PathBuf>,
    /// Do not compress again to measure encode_s and peak_rss_bytes; both are then null.
    #[arg(long)]
    no_encode: bool,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// One compressed material against the measurement. Errors are fractions of 255: .035 is 8.9 grey levels.
#[derive(Clone, Serialize)]
pub struct Row {
    pub file: PathBuf,
    pub method: String,
    pub params: String,
    #[serde(flatten)]
    pub report: Report,
    pub bytes: u64,
    /// Raw 8-bit bytes over these.
    pub ratio_raw8: f64,
    /// Bytes of the measurement's files over these.
    pub ratio_source: f64,
    /// Seconds to compress the measurement again with the same parameters, now, on this machine.
    pub encode_s: Option<f64>,
    /// Seconds to decode every image.
    pub decode_s: f64,
    /// The most memory resident at once while compressing.
    pub peak_rss_bytes: Option<u64>,
}

impl Compare {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let source = match import::open_named(&self.source, &self.assumptions.options())?.1.images() {
            Ok(source) => source,
            Err(brdf) => return self.brdfs(brdf.as_ref(), terminal),
        };
        terminal.warn(source.warnings());
        let mut rows = Vec::new();
        for path in &self.compressed {
            rows.push(compare(source.as_ref(), path, !self.no_encode, terminal)?);
        }
        terminal.result(&rows, || table(&rows))
    }

    /// Other BRDFs at the directions in which the first was measured.
    fn brdfs(&self, brdf: &dyn Brdf, terminal: &Terminal) -> anyhow::Result<()> {
        terminal.warn(&brdf.notes().warnings);
        let samples = brdf.samples();
        let mut rows = Vec::new();
        for file in &self.compressed {
            let (importer, measured) = import::open_named(file, &import::Options::default())?;
            let Measured::Brdf(other) = measured else {
                let problem = format!("{} holds a BTF, but {} a BRDF", importer.name(), self.source.display());
                return Err(Error::unsupported(file, problem).into());
            };
            let error = metric::round_trip(&samples, other.as_ref());
            rows.push(BrdfRow { file: file.clone(), kind: importer.name(), error });
        }
        terminal.result(&rows, || {
            let cells = |row: &BrdfRow| {
                let errors = [row.error.relative_error, row.error.largest_error].map(|e| format!("{e:.6}"));
                [&[row.file.display().to_string(), row.kind.into(), row.error.samples.to_string()], &errors[..]]
                    .concat()
            };
            report::table(
                &["file", "kind", "samples", "relative", "largest"],
                &rows.iter().map(cells).collect::<Vec<_>>(),
            )
        })
    }
}

/// One BRDF against another.
#[derive(Serialize)]
struct BrdfRow {
    file: PathBuf,
    kind: &'static str,
    #[serde(flatten)]
    error: RoundTrip,
}

/// Measures one compressed file against its source.
pub fn compare(source: &dyn BtfSource, path: &Path, encode: bool, progress: &dyn Progress) -> anyhow::Result<Row> {
    let (importer, measured) = import::open_named(path, &import::Options::default())?;
    let compressed = match measured {
        Measured::Compressed(compressed) => compressed,
        Measured::Btf(other) => return measurement(source, other.as_ref(), importer.name(), path, progress),
        Measured::Brdf(_) => {
            let problem = format!("{} holds a BRDF, a BTF is needed here", importer.name());
            return Err(Error::unsupported(path, problem).into());
        }
    };
    let measured = if encode { Some(encode_again(source, compressed.as_ref(), path, progress)?) } else { None };
    let decode_s = decode_all(compressed.as_ref(), progress)?;
    let report = metric::compare(source, compressed.as_ref(), progress).map_err(|e| about(path, e))?;
    let bytes = compressed.bytes();
    Ok(Row {
        file: path.into(),
        method: compressed.method().into(),
        params: compressed.params().iter().map(|(name, text)| format!("{name}={text}")).collect::<Vec<_>>().join(" "),
        report,
        bytes,
        ratio_raw8: source.meta().raw8_bytes() as f64 / bytes as f64,
        ratio_source: source.source_bytes() as f64 / bytes as f64,
        encode_s: measured.map(|m| m.0),
        decode_s,
        peak_rss_bytes: measured.map(|m| m.1),
    })
}

/// Compares with another measurement, which nothing is encoded for.
fn measurement(
    source: &dyn BtfSource,
    other: &dyn BtfSource,
    kind: &str,
    path: &Path,
    progress: &dyn Progress,
) -> anyhow::Result<Row> {
    let start = Instant::now();
    (0..other.meta().views.len()).into_par_iter().try_for_each(|view| other.view(view).map(drop))?;
    let decode_s = start.elapsed().as_secs_f64();
    let bytes = other.source_bytes();
    Ok(Row {
        file: path.into(),
        method: kind.into(),
        params: String::new(),
        report: metric::compare(source, other, progress).map_err(|e| about(path, e))?,
        bytes,
        ratio_raw8: source.meta().raw8_bytes() as f64 / bytes as f64,
        ratio_source: source.source_bytes() as f64 / bytes as f64,
        encode_s: None,
        decode_s,
        peak_rss_bytes: None,
    })
}

/// Says which of several compared files does not suit the measurement.
fn about(path: &Path, error: Error) -> Error {
    match error {
        Error::Parameter { name, problem } => Error::invalid(path, name, problem),
        other => other,
    }
}

fn encode_again(
    source: &dyn BtfSource,
    compressed: &dyn CompressedBtf,
    path: &Path,
    progress: &dyn Progress,
) -> anyhow::Result<(f64, u64)> {
    let codec = codec::by_name(compressed.method())?;
    // beside the file, where there was room for it once
    let folder = tempfile::tempdir_in(path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")))
        .or_else(|_| tempfile::tempdir())?;
    report::reset_peak_rss();
    let start = Instant::now();
    codec.encode(source, compressed.params(), &folder.path().join("again.loden"), progress)?;
    Ok((start.elapsed().as_secs_f64(), report::peak_rss()))
}

fn decode_all(compressed: &dyn CompressedBtf, progress: &dyn Progress) -> loden::Result<f64> {
    let meta = compressed.meta();
    let task = Task::new(progress, "decode", meta.views.len() as u64);
    let start = Instant::now();
    let decode = |texels: &mut Vec<f32>, view: usize| {
        texels.resize(meta.view_len(), 0.0);
        compressed.decode_view(view, texels)?;
        std::hint::black_box(&texels);
        task.advance(1)
    };
    (0..meta.views.len()).into_par_iter().map_init(Vec::new, decode).collect::<loden::Result<()>>()?;
    Ok(start.elapsed().as_secs_f64())
}

pub fn table(rows: &[Row]) -> String {
    let header = [
        "file", "method", "mean", "max", "rmse", "psnr", "ssim", "bytes", "raw8/", "source/", "encode s", "decode s",
        "peak",
    ];
    let cells = |row: &Row| {
        let r = &row.report;
        vec![
            row.file.display().to_string(),
            row.method.clone(),
            format!("{:.4}", r.mean_abs_error),
            format!("{:.3}", r.max_abs_error),
            format!("{:.4}", r.rmse),
            format!("{:.2}", r.psnr_db),
            format!("{:.4}", r.ssim),
            report::bytes(row.bytes),
            format!("{:.2}", row.ratio_raw8),
            format!("{:.2}", row.ratio_source),
            row.encode_s.map_or("-".into(), |s| format!("{s:.2}")),
            format!("{:.2}", row.decode_s),
            row.peak_rss_bytes.map_or("-".into(), report::bytes),
        ]
    };
    report::table(&header, &rows.iter().map(cells).collect::<Vec<_>>())
}
