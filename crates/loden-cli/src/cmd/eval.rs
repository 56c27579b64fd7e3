//! `loden eval`: a material at directions listed in a file.

use std::path::PathBuf;

use clap::Args;
use loden::job;

use super::decompress::SchemeFlag;
use crate::flags::Assumptions;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden eval gold.bsdf --queries directions.csv -o values.csv")]
pub struct Eval {
    /// Material: anything that `loden info` recognises.
    source: PathBuf,
    /// Directions, a row each: theta_i,phi_i,theta_o,phi_o[,u,v].
    ///
    /// Polar angle and azimuth of light and viewer in degrees, and texture coordinates. A heading is allowed.
    #[arg(long, value_name = "CSV")]
    queries: PathBuf,
    /// Where to write the rows with r,g,b appended.
    ///
    /// Values are f_r in 1/sr for a BRDF, and the apparent value pi L / E for a BTF.
    #[arg(long, short, value_name = "CSV")]
    output: PathBuf,
    /// Append the value at each measured wavelength instead of r,g,b.
    #[arg(long)]
    spectral: bool,
    /// Interpolation between measured directions.
    #[arg(long, default_value = "triangles")]
    interpolation: SchemeFlag,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Eval {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let how = (self.spectral, self.interpolation.into());
        let done = job::evaluate(&self.source, &self.queries, &self.output, how, self.assumptions.given(), terminal)?;
        terminal.result(&done, || format!("{}: {} rows, {}", done.output.display(), done.rows, done.quantity.text()))
    }
}
