//! `loden compress`: a measured material made small.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use loden::params::Param;
use loden::{codec, import};
use serde_json::json;

use crate::flags::{Assumptions, Flags, Tables};
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Compress {
    /// Anything `loden info` knows.
    source: PathBuf,
    /// The compression method.
    #[arg(long, default_value = "pvmf")]
    method: String,
    /// The file to write, .loden.
    #[arg(long, short)]
    output: PathBuf,
    #[command(flatten)]
    assumptions: Assumptions,
    #[command(flatten)]
    params: Flags<Codecs>,
}

/// The parameters of all codecs.
#[derive(Debug, Clone)]
pub struct Codecs;

impl Tables for Codecs {
    fn tables() -> Vec<(&'static str, &'static [Param])> {
        codec::CODECS.iter().map(|codec| (codec.name(), codec.params())).collect()
    }
}

impl Compress {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let codec = codec::by_name(&self.method)?;
        let params = self.params.values(codec.params())?;
        let source = import::open(&self.source, &self.assumptions.options())?;
        terminal.warn(source.warnings());
        report::reset_peak_rss();
        let start = Instant::now();
        let summary = codec.encode(source.as_ref(), &params, &self.output, terminal)?;
        let encode_s = start.elapsed().as_secs_f64();
        terminal.warn(&summary.warnings);
        let raw8 = source.meta().raw8_bytes() as f64 / summary.bytes as f64;
        let value = json!({
            "output": self.output,
            "method": codec.name(),
            "bytes": summary.bytes,
            "ratio_raw8": raw8,
            "ratio_source": source.source_bytes() as f64 / summary.bytes as f64,
            "encode_s": encode_s,
            "peak_rss_bytes": report::peak_rss(),
        });
        terminal.result(&value, || {
            let size = report::bytes(summary.bytes);
            format!("{}: {size}, 1/{raw8:.1} of the raw 8-bit data, {encode_s:.1} s", self.output.display())
        })
    }
}
