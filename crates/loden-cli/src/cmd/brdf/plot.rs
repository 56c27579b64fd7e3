//! `loden brdf plot`: polar slices, the hemisphere, albedo over angle.

use std::path::PathBuf;

use clap::Args;
use loden::job;
use serde_json::json;

use crate::flags::Assumptions;
use crate::outputs::Outputs;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden brdf plot gold.binary ggx:alpha-x=0.1 -o plots")]
pub struct Plot {
    /// BRDF files, BTFs (averaged over their texels), or models such as `ward:alpha-x=0.1`.
    #[arg(required = true)]
    sources: Vec<PathBuf>,
    /// Folder for polar.svg, albedo.svg and one hemisphere-N.png per source.
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// Polar angles of the light, degrees, separated by commas.
    #[arg(long, value_delimiter = ',', default_value = "20,45,70", value_name = "DEGREES")]
    lights: Vec<f32>,
    /// Size of a hemisphere in pixels.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u16).range(8..=4096))]
    size: u16,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Plot {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        Outputs::new(terminal, &self.sources).folder(&self.output)?;
        let files =
            job::plot(&self.sources, &self.output, &self.lights, self.size.into(), self.assumptions.given(), terminal)?;
        let list = files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join("\n");
        terminal.result(&json!({ "sources": self.sources, "files": files }), || list)
    }
}
