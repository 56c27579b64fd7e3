//! `loden export`: a compressed material for another renderer.

use std::path::PathBuf;

use clap::Args;
use loden::{job, renderers};

use crate::choice;
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Example:
  loden compress wool.zip -o wool.loden
  loden export wool.loden --to mitsuba -o wool-mitsuba
  python wool-mitsuba/scene.py ball.exr
  loden export wool.loden --to glsl -o wool-glsl        # then open wool-glsl/index.html")]
pub struct Export {
    /// Compressed BTF, .loden.
    input: PathBuf,
    /// Renderer.
    #[arg(long, value_name = "RENDERER", value_parser = choice::renderer())]
    to: String,
    /// Folder to write.
    #[arg(long, short, value_name = "FOLDER")]
    output: PathBuf,
}

impl Export {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let outputs = Outputs::new(terminal, [&self.input]);
        let target = outputs.whole_folder(&self.output)?;
        let made = job::export_to(&self.input, renderers::by_name(&self.to)?, target.path(), terminal)?;
        target.finish()?;
        terminal.result(&made, || {
            let (files, bytes) = (report::count(made.files, "file"), report::bytes(made.bytes));
            format!("{}: {files}, {bytes}; begin with README.md", self.output.display())
        })
    }
}
