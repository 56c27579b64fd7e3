//! `loden brdf spheres`: BRDFs side by side.

use std::path::PathBuf;

use clap::Args;
use loden::job;
use loden::progress::Progress;
use serde_json::json;

use crate::flags::Assumptions;
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden brdf spheres gold.binary ward ggx:alpha-x=0.3 -o spheres.png")]
pub struct Spheres {
    /// BRDF files, BTFs (averaged over their texels), or models such as `ward:alpha-x=0.1`.
    ///
    /// A file of several materials gives a sphere for each, unless --index chooses one.
    #[arg(required = true)]
    sources: Vec<PathBuf>,
    /// Picture to write, .png or .exr.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Size of a sphere in pixels.
    #[arg(long, value_name = "N", default_value_t = 160, value_parser = clap::value_parser!(u16).range(8..=4096))]
    size: u16,
    /// Spheres per row.
    #[arg(long, value_name = "N", default_value_t = 10)]
    columns: usize,
    /// Factor on all pixels.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    exposure: f32,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Spheres {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let target = Outputs::new(terminal, &self.sources).file(&self.output, &["png", "exr"])?;
        let (picture, count) =
            job::spheres(&self.sources, self.size.into(), self.columns, self.assumptions.given(), terminal)?;
        let picture = picture.scaled(self.exposure);
        picture.write_noted(target.path(), terminal.command())?;
        target.finish()?;
        let value =
            json!({ "output": self.output, "spheres": count, "width": picture.width, "height": picture.height });
        terminal.result(&value, || format!("{}: {}", self.output.display(), report::count(count, "sphere")))
    }
}
