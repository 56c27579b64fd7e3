//! `loden brdf eval`: values of an analytic model.

use std::path::PathBuf;

use clap::Args;
use loden::job::{self, Assignment};
use serde_json::json;

use crate::choice;
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden brdf eval ggx --set alpha-x=0.2 --set alpha-y=0.4 --queries directions.csv -o values.csv")]
pub struct Eval {
    /// Model, with parameters or without, such as `ggx:alpha-x=0.2`; `loden brdf models` lists them.
    #[arg(value_parser = choice::model())]
    model: String,
    /// Parameter of the model; may be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<Assignment>,
    /// CSV file with a pair of directions in each row: theta_i,phi_i,theta_o,phi_o in degrees, or two unit vectors.
    #[arg(long, value_name = "FILE")]
    queries: PathBuf,
    /// Rows hold unit vectors: x,y,z of wi, then of wo.
    #[arg(long)]
    vectors: bool,
    /// Where to write r,g,b,pdf: f_r in 1/sr, and the sampling density in 1/sr.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
}

impl Eval {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let mut parts = self.model.split(':');
        let name = parts.next().unwrap_or_default();
        let settings = parts.map(str::parse).chain(self.set.into_iter().map(Ok));
        let brdf = job::analytic(name, &settings.collect::<loden::Result<Vec<Assignment>>>()?)?;
        let target = Outputs::new(terminal, [&self.queries]).file(&self.output, &[])?;
        let count = job::evaluate_model(&brdf, &self.queries, self.vectors, target.path())?;
        target.finish()?;
        let value = json!({ "output": self.output, "model": self.model, "count": count });
        terminal.result(&value, || format!("{}: {}", self.output.display(), report::count(count, "value")))
    }
}
