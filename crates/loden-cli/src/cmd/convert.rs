//! `loden convert`: a measurement in another form.

use std::path::PathBuf;

use clap::Args;
use loden::export::{self, ImageFormat};
use loden::import;
use serde_json::json;

use crate::flags::Assumptions;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Convert {
    /// Anything `loden info` knows.
    source: PathBuf,
    /// `.zip` or a folder (Bonn layout), or `.toml` (raw array, the quickest to read).
    output: PathBuf,
    #[command(flatten)]
    pictures: Pictures,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// How pictures are stored.
#[derive(Args)]
pub struct Pictures {
    /// Store lossless PNG instead of JPEG.
    #[arg(long)]
    png: bool,
    /// JPEG quality.
    #[arg(long, default_value_t = 95, value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: u8,
}

impl Pictures {
    pub fn options(&self) -> export::Options {
        export::Options { image: if self.png { ImageFormat::Png } else { ImageFormat::Jpeg(self.quality) } }
    }
}

impl Convert {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let source = import::open(&self.source, &self.assumptions.options())?;
        terminal.warn(source.warnings());
        export::export(source.as_ref(), &self.output, &self.pictures.options(), terminal)?;
        let pairs = source.meta().pairs();
        terminal.result(&json!({ "output": self.output, "images": pairs }), || {
            format!("{}: {pairs} images", self.output.display())
        })
    }
}
