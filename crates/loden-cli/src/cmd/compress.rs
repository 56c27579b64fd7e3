//! `loden compress`: a measured material made small.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use clap::builder::PossibleValuesParser;
use loden::codec::parts::folder;
use loden::codec::{self, Finish, Goal, lossless};
use loden::job;
use loden::memory::Memory;
use loden::params::Param;
use serde_json::json;

use crate::flags::{Assumptions, Flags, Tables};
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Compress {
    /// Anything `loden info` knows.
    #[arg(required_unless_present = "from_parts")]
    source: Option<PathBuf>,
    /// Make the file from the parts in this folder, as `loden decompress --parts` wrote them.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["source", "goal", "memory"])]
    from_parts: Option<PathBuf>,
    /// The compression method.
    #[arg(long, default_value = "pvmf")]
    method: String,
    /// The file to write, .loden.
    #[arg(long, short)]
    output: PathBuf,
    /// Search for the smallest file whose mean error, as `loden compare` measures it, is at most this (0.02 is 5.1 grey
    /// levels); parameters that are given stay.
    #[arg(long, value_name = "E", group = "goal")]
    max_error: Option<f64>,
    /// Search for the smallest error in at most as many bytes; 200k and 3M are thousands and millions.
    #[arg(long, value_name = "N", group = "goal", value_parser = size)]
    bytes: Option<u64>,
    /// Search as with --max-error, 0.1 for quality 1 and 0.002 for 100, by equal factors.
    #[arg(long, value_name = "1..100", group = "goal", value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: Option<u8>,
    /// Do not measure the error: it takes reading the source once more and decoding the file.
    #[arg(long)]
    no_error: bool,
    /// Pack the numbers of the file without loss, the bytes of equal weight beside each other; it is unpacked into memory
    /// when it is opened.
    #[arg(long, value_name = "STAGE", default_value = NONE, value_parser = stages(), conflicts_with = "memory")]
    lossless: String,
    /// Use no more threads than let the method stay within this memory, such as 2G; not all methods keep one.
    #[arg(long, value_name = "BYTES")]
    memory: Option<Memory>,
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
        if let Some(folder) = &self.from_parts {
            return self.store(folder, terminal);
        }
        let codec = codec::by_name(&self.method)?;
        let params = self.params.values(codec.params())?;
        let path = self.source.as_ref().context("a source is expected")?;
        let source = job::open_btf(path, self.assumptions.given(), terminal)?;
        let lossless = (self.lossless != NONE).then(|| lossless::by_name(&self.lossless)).transpose()?;
        let (source, goal, finish) = (source.as_ref(), self.goal(), Finish { measure: !self.no_error, lossless });
        let done = job::compress(codec, source, &params, goal, finish, self.memory, &self.output, terminal)?;
        terminal.result(&done, || {
            let (file, size) = (self.output.display(), report::bytes(done.bytes));
            let error = done.error.map_or(String::new(), |e| format!(", mean error {:.4}", e.mean_abs_error));
            format!("{file}: {size}, 1/{:.1} of the raw 8-bit data{error}, {:.1} s", done.ratio_raw8, done.encode_s)
        })
    }

    fn store(&self, folder: &Path, terminal: &Terminal) -> anyhow::Result<()> {
        let (parts, from) = folder::read_folder(folder)?;
        let bytes = codec::parts::store(&parts, &from, &self.output)?;
        terminal.result(&json!({ "output": self.output, "from_parts": folder, "bytes": bytes }), || {
            format!("{}: {}", self.output.display(), report::bytes(bytes))
        })
    }

    fn goal(&self) -> Goal {
        match (self.max_error, self.bytes, self.quality) {
            (Some(error), ..) => Goal::MaxError(error),
            (_, Some(bytes), _) => Goal::Bytes(bytes),
            (.., Some(quality)) => Goal::of_quality(quality),
            _ => Goal::Params,
        }
    }
}

const NONE: &str = "none";

fn stages() -> PossibleValuesParser {
    PossibleValuesParser::new([NONE].into_iter().chain(lossless::STAGES.iter().map(|stage| stage.name)))
}

/// A number of bytes with a suffix k or M for thousands and millions.
fn size(text: &str) -> Result<u64, String> {
    let (number, factor) = match text.strip_suffix('k') {
        Some(number) => (number, 1e3),
        None => text.strip_suffix('M').map_or((text, 1.0), |number| (number, 1e6)),
    };
    let bytes = number.parse::<f64>().ok().map(|number| number * factor).filter(|bytes| (1.0..1e15).contains(bytes));
    bytes.map(|bytes| bytes as u64).ok_or_else(|| "a number of bytes is expected, such as 50000, 50k or 2.5M".into())
}
