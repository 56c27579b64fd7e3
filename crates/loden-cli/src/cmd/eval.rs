//! `loden eval`: a material at directions listed in a file.

use std::path::PathBuf;

use clap::Args;
use loden::job;

use super::decompress::SchemeFlag;
use crate::flags::Assumptions;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Eval {
    /// Anything `loden info` knows.
    source: PathBuf,
    /// Rows theta_i,phi_i,theta_o,phi_o[,u,v]: light and view in degrees, texture coordinates; a heading is allowed.
    #[arg(long, value_name = "CSV")]
    queries: PathBuf,
    /// The rows with r,g,b appended: f_r in 1/sr of a BRDF, the apparent value pi L / E of a BTF.
    #[arg(long, short, value_name = "CSV")]
    output: PathBuf,
    /// Append the value of each measured wavelength in place of r,g,b.
    #[arg(long)]
    spectral: bool,
    /// How to interpolate between measured directions.
    #[arg(long, default_value = "triangles")]
    interpolation: SchemeFlag,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Eval {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let options = self.assumptions.given();
        let how = (self.spectral, self.interpolation.into());
        let done = job::evaluate(&self.source, &self.queries, &self.output, how, &options, terminal)?;
        terminal.result(&done, || format!("{}: {} rows, {}", done.output.display(), done.rows, done.quantity.text()))
    }
}
