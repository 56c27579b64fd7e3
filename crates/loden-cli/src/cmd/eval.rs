//! `loden eval`: a material at directions listed in a file.

use std::path::PathBuf;

use clap::Args;
use loden::job;

use crate::flags::{Assumptions, Between};
use crate::outputs::Outputs;
use crate::report;
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
    #[command(flatten)]
    between: Between,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Eval {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let how = (self.spectral, self.between.interpolation());
        let target = Outputs::new(terminal, [&self.source, &self.queries]).file(&self.output, &[])?;
        let import = self.assumptions.given();
        let mut done = job::evaluate(&self.source, &self.queries, target.path(), how, import, terminal)?;
        done.output = target.finish()?;
        terminal.result(&done, || {
            let rows = report::count(done.rows, "row");
            format!("{}: {rows}, {}", done.output.display(), done.quantity.text())
        })
    }
}
