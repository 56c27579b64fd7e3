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
    /// Evaluate an analytic model at given directions.
    Eval(eval::Eval),
    /// Draw polar slices, the hemisphere and the albedo of BRDFs.
    Plot(plot::Plot),
    /// Draw a row of spheres.
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
