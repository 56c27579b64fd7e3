//! `loden compare`: how far compressed materials are from the measurement, and what they cost.

use std::path::PathBuf;

use clap::Args;
use loden::job::{self, BrdfComparison, Comparison, Comparisons};

use crate::flags::Assumptions;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden compare wool.zip wool-c4.loden wool-c9.loden
  loden compare wool.zip wool.loden --encode --json
  loden compare gold.binary gold.bsdf")]
pub struct Compare {
    /// The measurement: any BTF or BRDF that `loden info` recognises.
    source: PathBuf,
    /// Compressed materials, or other measurements with the same directions; for a BRDF, other BRDFs.
    #[arg(required = true, value_name = "OTHERS")]
    compressed: Vec<PathBuf>,
    /// Compress again with the same parameters, to measure time and memory of the encoder on this machine.
    #[arg(long)]
    encode: bool,
    /// The default, for scripts that say so.
    #[arg(long, hide = true, conflicts_with = "encode")]
    no_encode: bool,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Compare {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let rows = job::compare_files(&self.source, &self.compressed, self.assumptions.given(), self.encode, terminal)?;
        terminal.result(&rows, || match &rows {
            Comparisons::Btf(rows) => table(rows),
            Comparisons::Brdf(rows) => brdf_table(rows),
        })
    }
}

pub fn table(rows: &[Comparison]) -> String {
    let header = [
        "file",
        "method",
        "mean",
        "max",
        "rmse",
        "psnr",
        "ssim",
        "bytes",
        "raw:this",
        "files:this",
        "encode s",
        "decode s",
        "memory",
    ];
    let cells = |row: &Comparison| {
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

fn brdf_table(rows: &[BrdfComparison]) -> String {
    let cells = |row: &BrdfComparison| {
        let errors = [row.error.relative_error, row.error.largest_error].map(|e| format!("{e:.6}"));
        [&[row.file.display().to_string(), row.kind.into(), row.error.samples.to_string()], &errors[..]].concat()
    };
    report::table(&["file", "kind", "samples", "relative", "largest"], &rows.iter().map(cells).collect::<Vec<_>>())
}
