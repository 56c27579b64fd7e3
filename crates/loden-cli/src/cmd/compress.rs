//! `loden compress`: a measured material made small.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use loden::codec::parts::folder;
use loden::codec::{self, Codec, Finish, Goal, lossless};
use loden::job::{self, CompressRequest};
use loden::memory::Memory;
use loden::params::Param;
use serde_json::json;

use crate::choice::{self, NONE};
use crate::flags::{Assumptions, Flags, Tables};
use crate::help::{self, Section};
use crate::outputs::{Outputs, Target};
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = epilogue(&EXAMPLES))]
pub struct Compress {
    /// The BTF: any file or folder that `loden info` recognises.
    #[arg(required_unless_present = "from_parts")]
    source: Option<PathBuf>,
    /// Store the parts in this folder, as written by `loden decompress --parts`, instead of compressing a source.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["source", "goal", "memory"])]
    from_parts: Option<PathBuf>,
    /// Compression method.
    #[arg(long, default_value = codec::DEFAULT, value_parser = choice::method())]
    method: String,
    /// File to write, .loden; - for standard output.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    wanted: Wanted,
    /// Pack the file by a lossless compressor, with the bytes of the numbers shuffled.
    ///
    /// A packed file is unpacked into memory when it is opened; others are memory-mapped.
    #[arg(long, value_name = "STAGE", default_value = NONE, value_parser = choice::stage(), conflicts_with = "memory")]
    lossless: String,
    /// Memory limit, such as 2G; fewer threads are used if necessary. Not supported by all methods.
    #[arg(long, value_name = "BYTES")]
    memory: Option<Memory>,
    #[command(flatten)]
    assumptions: Assumptions,
    #[command(flatten)]
    params: Flags<Codecs>,
}

const EXAMPLES: [&str; 5] = [
    "loden compress wool.zip -o wool.loden",
    "loden compress wool.zip --max-error 0.03 -o small.loden",
    "loden compress wool.zip --method pvmf --components 9 -o wool.loden",
    "loden compress wool.zip --method median-cut --bytes 200k --lossless zstd -o wool.loden",
    "loden compress --method klt --help",
];

/// The parameters of all methods, and examples.
pub fn epilogue(examples: &[&str]) -> String {
    let section = |codec: &&dyn Codec| {
        let (name, params) = (codec.name(), codec.params());
        Section { name, title: format!("Parameters of --method {name}"), params }
    };
    help::epilogue(&codec::CODECS.iter().map(section).collect::<Vec<_>>(), examples)
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
        let target =
            Outputs::new(terminal, self.source.iter().chain(&self.from_parts)).file(&self.output, &["loden"])?;
        if let Some(folder) = &self.from_parts {
            return self.store(folder, target, terminal);
        }
        let codec = codec::by_name(&self.method)?;
        let params = self.params.values(codec.params())?;
        let path = self.source.as_ref().context("a source is expected")?;
        let source = job::open_btf(path, self.assumptions.given(), terminal)?;
        let lossless = (self.lossless != NONE).then(|| lossless::by_name(&self.lossless)).transpose()?;
        let request = CompressRequest {
            codec,
            params,
            goal: self.wanted.goal(),
            finish: Finish { measure: !self.wanted.no_error, lossless },
            memory: self.memory,
        };
        let mut done = job::compress(source.as_ref(), &request, target.path(), terminal)?;
        done.output = target.finish()?;
        terminal.result(&done, || {
            let (file, size) = (done.output.display(), report::bytes(done.bytes));
            let error = done.error.map_or(String::new(), |e| format!(", mean error {:.4}", e.mean_abs_error));
            format!("{file}: {size}, 1/{:.1} of the raw 8-bit data{error}, {:.1} s", done.ratio_raw8, done.seconds)
        })
    }

    fn store(&self, folder: &Path, target: Target, terminal: &Terminal) -> anyhow::Result<()> {
        let (parts, from) = folder::read_folder(folder)?;
        let bytes = codec::parts::store(&parts, &from, target.path())?;
        target.finish()?;
        terminal.result(&json!({ "output": self.output, "from_parts": folder, "bytes": bytes }), || {
            format!("{}: {}", self.output.display(), report::bytes(bytes))
        })
    }
}

/// What the file should be like.
#[derive(Args)]
pub struct Wanted {
    /// Find the smallest file whose mean error is at most this (0.02 is 5.1 grey levels).
    ///
    /// The error is that of `loden compare`. Parameters given on the command line stay fixed; the others are searched.
    #[arg(long, value_name = "E", group = "goal")]
    max_error: Option<f64>,
    /// Find the smallest error in at most this many bytes, such as 200k or 3M (powers of 1000).
    #[arg(long, value_name = "N", group = "goal", value_parser = size)]
    bytes: Option<u64>,
    /// As --max-error, on a logarithmic scale: 1 stands for an error of 0.1, 100 for 0.002.
    #[arg(long, value_name = "1..100", group = "goal", value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: Option<u8>,
    /// Do not measure the error.
    ///
    /// Saves reading the source again and decoding the file. The file then does not state its error.
    #[arg(long)]
    pub no_error: bool,
}

impl Wanted {
    pub fn goal(&self) -> Goal {
        match (self.max_error, self.bytes, self.quality) {
            (Some(error), ..) => Goal::MaxError(error),
            (_, Some(bytes), _) => Goal::Bytes(bytes),
            (.., Some(quality)) => Goal::of_quality(quality),
            _ => Goal::Params,
        }
    }
}

/// A number of bytes; the suffixes k and M are thousands and millions.
fn size(text: &str) -> Result<u64, String> {
    let (number, factor) = match text.strip_suffix('k') {
        Some(number) => (number, 1e3),
        None => text.strip_suffix('M').map_or((text, 1.0), |number| (number, 1e6)),
    };
    let bytes = number.parse::<f64>().ok().map(|number| number * factor).filter(|bytes| (1.0..1e15).contains(bytes));
    bytes.map(|bytes| bytes as u64).ok_or_else(|| "a number of bytes is expected, such as 50000, 50k or 2.5M".into())
}
