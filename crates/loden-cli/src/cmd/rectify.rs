//! `loden rectify`: raw photographs made into a BTF.

use std::path::PathBuf;

use clap::Args;
use loden::job::{self, Rectified};
use loden::rectify::Options;

use super::convert::Pictures;
use crate::choice;
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden rectify photographs/photographs.toml -o sample.zip")]
pub struct Rectify {
    /// TOML file that describes the photographs (docs/rectify.md).
    manifest: PathBuf,
    #[arg(long, short, value_name = "FILE", help = "BTF to write: .zip, .btf, .toml or a folder", long_help = choice::btf_output("BTF to write"))]
    output: PathBuf,
    /// Texels per side of the images.
    #[arg(long, value_name = "N", default_value_t = Options::default().size)]
    size: usize,
    /// Refuse photographs in which the edges of the frame deviate from straight lines by more than this (pixels, RMS).
    ///
    /// A refused photograph is replaced by the one with the nearest light of the same view.
    #[arg(long, default_value_t = Options::default().max_error, value_name = "PIXELS")]
    max_error: f64,
    #[command(flatten)]
    pictures: Pictures,
}

impl Rectify {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let options = Options { size: self.size, max_error: self.max_error };
        let target = Outputs::new(terminal, [&self.manifest]).btf(&self.output, None)?;
        let mut done = job::rectify(&self.manifest, target.path(), &options, self.pictures.given(), terminal)?;
        done.output = target.finish()?;
        terminal.result(&done, || text(&done))
    }
}

fn text(done: &Rectified) -> String {
    let mut text =
        format!("{}: {}, {:.1} s\n", done.output.display(), report::count(done.images, "image"), done.seconds);
    if let (Some(median), Some(largest)) = (done.median_error_px, done.largest_error_px) {
        text += &format!("edges of the frame: median error {median:.3} pixels, largest {largest:.3}\n");
    }
    if done.saturated > 0 {
        text += &format!("saturated pixels in {}\n", report::count(done.saturated, "photograph"));
    }
    if done.refused > 0 {
        text += &format!("refused: {}; each is replaced by the nearest light of its view\n", done.refused);
    }
    text
}
