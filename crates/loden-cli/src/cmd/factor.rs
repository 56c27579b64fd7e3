//! `loden factor`: a BRDF as a product or sum of small tables.

use std::path::PathBuf;

use clap::Args;
use loden::job;
use loden::params::Param;
use loden::separable::{self, FACTORISATIONS};

use crate::flags::{Assumptions, Flags, Tables};
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Factor {
    /// A BRDF file, a BTF (averaged), or a model such as `ward:alpha-x=0.1`.
    source: PathBuf,
    #[arg(long, help = method_help())]
    method: String,
    /// The folder for the tables (EXR) and the picture panel.png: original, factors, reconstruction, difference.
    #[arg(long, short)]
    output: PathBuf,
    #[command(flatten)]
    params: Flags<Methods>,
    #[command(flatten)]
    assumptions: Assumptions,
}

fn method_help() -> String {
    let names: Vec<_> = FACTORISATIONS.iter().map(|f| f.name()).collect();
    format!("The factorisation: {}", names.join(", "))
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
        let options = self.assumptions.given();
        let done = job::factor(&self.source, method, &values, &self.output, &options, terminal)?;
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
