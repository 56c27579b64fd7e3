//! `loden convert`: a measurement in another form, and what that cost.

use std::path::PathBuf;

use clap::Args;
use loden::btf::BtfSource;
use loden::export;
use loden::import::{self, Measured};
use loden::material::Brdf;
use loden::params::{Given, Param};
use loden::progress::Progress;
use loden::{job, metric};
use serde_json::{Map, Value, json};

use crate::flags::{Assumptions, Flags, Tables};
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Convert {
    /// Anything `loden info` knows.
    source: PathBuf,
    /// A BTF: `.zip` or a folder (Bonn layout), `.toml` (raw array, the quickest to read), `.btf`. A BRDF: `.bsdf`
    /// (Mitsuba 3, pbrt), `.binary` (MERL), `.astm`, `.exr` (one slice).
    output: PathBuf,
    /// The format by name, where the ending does not tell: raw, dfmf, fmf, bdi, ubo2003; rgl, merl, astm, slice.
    #[arg(long, value_name = "NAME")]
    to: Option<String>,
    /// Do not read the output again to say how far it is from the source.
    #[arg(long)]
    no_check: bool,
    #[command(flatten)]
    options: Flags<Exporters>,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// All exporters of BTFs.
#[derive(Debug, Clone)]
struct Exporters;

impl Tables for Exporters {
    fn tables() -> Vec<(&'static str, &'static [Param])> {
        export::EXPORTERS.iter().map(|exporter| (exporter.name(), exporter.params())).collect()
    }
}

/// How pictures are stored, for commands that write BTFs.
pub type Pictures = Flags<PictureExporter>;

/// The exporter of pictures.
#[derive(Debug, Clone)]
pub struct PictureExporter;

impl Tables for PictureExporter {
    fn tables() -> Vec<(&'static str, &'static [Param])> {
        Exporters::tables().into_iter().filter(|(name, _)| *name == "ubo2003").collect()
    }
}

impl Convert {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let result = match job::open(&self.source, self.assumptions.given(), terminal)?.measured.images() {
            Ok(source) => self.btf(source.as_ref(), terminal)?,
            Err(brdf) => self.brdf(brdf.as_ref())?,
        };
        terminal.result(&result, || text(&result))
    }

    fn btf(&self, source: &dyn BtfSource, terminal: &Terminal) -> anyhow::Result<Map<String, Value>> {
        let exporter = export::by_name(&self.output, self.to.as_deref())?;
        export::export_as(exporter, source, &self.output, self.options.given(), terminal)?;
        let mut result = Map::new();
        result.insert("output".into(), json!(self.output));
        result.insert("format".into(), json!(exporter.name()));
        result.insert("images".into(), json!(source.meta().pairs()));
        result.insert("lost".into(), json!(export::losses(exporter, source)));
        if !self.no_check {
            let back = import::open(&self.output, &Given::default())?;
            match metric::compare(source, back.as_ref(), terminal) {
                Ok(report) => {
                    result.insert("mean_error".into(), json!(report.mean_abs_error));
                    result.insert("largest_error".into(), json!(report.max_abs_error));
                }
                // pictures have the cosine in them whatever the source has
                Err(loden::Error::Parameter { problem, .. }) => terminal.warn(&format!("not compared: {problem}")),
                Err(other) => return Err(other.into()),
            }
        }
        Ok(result)
    }

    fn brdf(&self, brdf: &dyn Brdf) -> anyhow::Result<Map<String, Value>> {
        let exporter = export::brdf_exporter(&self.output, self.to.as_deref())?;
        self.options.values(&[])?;
        let samples = brdf.samples();
        exporter.write(brdf, &samples, &self.output)?;
        let mut result = Map::new();
        result.insert("output".into(), json!(self.output));
        result.insert("format".into(), json!(exporter.name()));
        result.insert("samples".into(), json!(samples.len()));
        result.insert("lost".into(), json!(exporter.losses(brdf)));
        if !self.no_check
            && let Ok((_, Measured::Brdf(back))) = import::open_named(&self.output, &Given::default())
        {
            let found = metric::round_trip(&samples, back.as_ref());
            result.insert("relative_error".into(), json!(found.relative_error));
            result.insert("largest_error".into(), json!(found.largest_error));
        }
        Ok(result)
    }
}

fn text(result: &Map<String, Value>) -> String {
    let word = |key: &str| result.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
    let count = result.get("images").map(|n| format!("{n} images"));
    let count = count.unwrap_or_else(|| format!("{} samples", result.get("samples").unwrap_or(&Value::Null)));
    let mut text = format!("{}: {}, {count}\n", word("output"), word("format"));
    for (key, name) in [
        ("mean_error", "mean error of display values"),
        ("relative_error", "error relative to the values, cosine-weighted"),
        ("largest_error", "largest"),
    ] {
        if let Some(error) = result.get(key).and_then(Value::as_f64) {
            text += &format!("{name}: {error:.6}\n");
        }
    }
    for lost in result.get("lost").and_then(Value::as_array).into_iter().flatten() {
        text += &format!("lost: {}\n", lost.as_str().unwrap_or_default());
    }
    text
}
