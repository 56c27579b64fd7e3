//! `loden factor`: a BRDF as a product or sum of small tables.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use loden::Error;
use loden::material::Material;
use loden::params::Param;
use loden::picture::{ExrType, Picture};
use loden::separable::{self, FACTORISATIONS, Factored};
use serde::Serialize;

use crate::flags::{Assumptions, Flags, Tables};
use crate::reflectance;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Factor {
    /// A BRDF file, a BTF (averaged), or a model such as `ward:alpha-x=0.1`.
    source: String,
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

#[derive(Serialize)]
struct Row {
    source: String,
    method: String,
    params: String,
    /// The sum of |difference| cos over the sum of f cos.
    mean_rel_error: f64,
    /// 1/sr.
    rmse: f64,
    bytes: usize,
    /// A full table of pairs over these bytes.
    ratio: f64,
    seconds: f64,
    output: PathBuf,
}

impl Factor {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let method = separable::by_name(&self.method)?;
        let values = self.params.values(method.params())?;
        let source = reflectance::open(&self.source, &self.assumptions, terminal)?;
        let start = Instant::now();
        let factored = method.factor(source.as_ref(), &values, terminal)?;
        let seconds = start.elapsed().as_secs_f64();
        let found = separable::compare(source.as_ref(), &factored);
        write(&self.output, source.as_ref(), &factored)?;
        let row = Row {
            source: self.source,
            method: self.method,
            params: values.iter().map(|(name, text)| format!("{name}={text}")).collect::<Vec<_>>().join(" "),
            mean_rel_error: found.mean_rel_error,
            rmse: found.rmse,
            bytes: factored.bytes(),
            ratio: factored.ratio(),
            seconds,
            output: self.output,
        };
        terminal.result(&row, || {
            let cells = vec![
                row.method.clone(),
                row.params.clone(),
                format!("{:.4}", row.mean_rel_error),
                format!("{:.5}", row.rmse),
                report::bytes(row.bytes as u64),
                format!("{:.0}", row.ratio),
                format!("{:.2}", row.seconds),
            ];
            report::table(&["method", "parameters", "mean rel.", "rmse", "bytes", "ratio", "s"], &[cells])
        })
    }
}

fn write(folder: &Path, original: &dyn Material, factored: &Factored) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
    separable::panel(original, factored, 256).write_png(folder.join("panel.png"))?;
    for (k, grid) in factored.tables().into_iter().enumerate() {
        let picture = Picture { width: grid.size, height: grid.size, rgb: grid.texels.clone() };
        picture.write_exr(folder.join(format!("table-{}.exr", k + 1)), ExrType::Float)?;
    }
    Ok(())
}
