//! `loden brdf eval`: values of an analytic model.

use std::path::PathBuf;

use clap::Args;
use loden::job::{self, Assignment};
use serde_json::json;

use crate::terminal::Terminal;

#[derive(Args)]
pub struct Eval {
    /// The model; `loden brdf models` lists them.
    model: String,
    /// A parameter of the model; may be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<Assignment>,
    /// Directions, a CSV file: theta_i, phi_i, theta_o, phi_o in degrees, or with --vectors wi and wo as x, y, z.
    #[arg(long, value_name = "FILE")]
    queries: PathBuf,
    /// The queries are unit vectors.
    #[arg(long)]
    vectors: bool,
    /// Where to write the values, a CSV file: f_r in 1/sr as r, g, b, and the density of samples.
    #[arg(long, short)]
    output: PathBuf,
}

impl Eval {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let brdf = job::analytic(&self.model, &self.set)?;
        let count = job::evaluate_model(&brdf, &self.queries, self.vectors, &self.output)?;
        let value = json!({ "output": self.output, "model": self.model, "count": count });
        terminal.result(&value, || format!("{}: {count} values", self.output.display()))
    }
}
