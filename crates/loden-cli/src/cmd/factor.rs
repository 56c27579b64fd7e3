//! `loden factor`: a BRDF as a product or sum of small tables.

use std::path::PathBuf;

use clap::Args;
use loden::job;
use loden::params::Param;
use loden::separable::{self, FACTORISATIONS, Factorisation};

use crate::choice;
use crate::flags::{Assumptions, Flags, Tables};
use crate::help::{self, Section};
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = epilogue())]
pub struct Factor {
    /// A BRDF file, a BTF (averaged over its texels), or a model such as `ward:alpha-x=0.1`.
    source: PathBuf,
    /// Factorisation.
    #[arg(long, value_parser = choice::factorisation())]
    method: String,
    /// Folder for the material factored.loden, its tables (EXR) and panel.png.
    ///
    /// All commands that take a BRDF take factored.loden. The panel shows the original, the factors, the reconstruction and
    /// the difference.
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    params: Flags<Methods>,
    #[command(flatten)]
    assumptions: Assumptions,
}

fn epilogue() -> String {
    let section = |method: &&dyn Factorisation| {
        let (name, params) = (method.name(), method.params());
        Section { name, title: format!("Parameters of --method {name}"), params }
    };
    let examples = [
        "loden factor gold.binary --method svd --terms 3 -o gold",
        "loden render --object teapot --material gold/factored.loden -o gold.png",
        "loden factor --method hf --help",
    ];
    help::epilogue(&FACTORISATIONS.iter().map(section).collect::<Vec<_>>(), &examples)
}

/// The parameters of all factorisations.
#[derive(Debug, Clone)]
struct Methods;

impl Tables for Methods {
    fn tables() -> Vec<(&'static str, &'static [Param])> {
        FACTORISATIONS.iter().map(|f| (f.name(), f.params())).collect()
    }
}

impl Factor {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let method = separable::by_name(&self.method)?;
        let values = self.params.values(method.params())?;
        Outputs::new(terminal, [&self.source]).folder(&self.output)?;
        let done = job::factor(&self.source, method, &values, &self.output, self.assumptions.given(), terminal)?;
        terminal.result(&done, || {
            let cells = vec![
                done.method.to_owned(),
                format!("{:.4}", done.mean_rel_error),
                format!("{:.5}", done.rmse),
                report::bytes(done.bytes as u64),
                format!("{:.0}", done.ratio),
                format!("{:.2}", done.seconds),
            ];
            report::table(&["method", "mean rel.", "rmse", "bytes", "ratio", "s"], &[cells])
        })
    }
}
