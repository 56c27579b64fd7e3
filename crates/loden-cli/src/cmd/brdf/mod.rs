//! `loden brdf`: analytic models, and pictures of reflectance.

mod eval;
mod models;
mod plot;
mod spheres;

use clap::{Args, Subcommand};

use crate::terminal::Terminal;

#[derive(Args)]
pub struct Brdf {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// List the analytic models with their parameters.
    Models(models::Models),
    /// Evaluate an analytic model at directions listed in a CSV file.
    Eval(eval::Eval),
    /// Plot polar slices, the hemisphere and the albedo of BRDFs.
    Plot(plot::Plot),
    /// Render a sphere of each BRDF, in rows.
    Spheres(spheres::Spheres),
}

impl Brdf {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        match self.command {
            Command::Models(command) => command.run(terminal),
            Command::Eval(command) => command.run(terminal),
            Command::Plot(command) => command.run(terminal),
            Command::Spheres(command) => command.run(terminal),
        }
    }
}
