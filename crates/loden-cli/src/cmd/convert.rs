//! `loden convert`: a measurement in another form, and what that cost.

use std::path::PathBuf;

use clap::Args;
use loden::export;
use loden::job::{self, Conversion, ConvertRequest};
use loden::params::Param;

use crate::choice;
use crate::flags::{Assumptions, Flags, Tables};
use crate::help::{self, Section};
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = epilogue())]
pub struct Convert {
    /// A BTF, BRDF or model: anything that `loden info` recognises.
    source: PathBuf,
    #[arg(help = "File or folder to write; the ending chooses the format, see --to", long_help = output_help())]
    output: PathBuf,
    /// Format to write, instead of the one that the ending chooses.
    #[arg(long, value_name = "FORMAT", value_parser = choice::format())]
    to: Option<String>,
    /// Do not read the output again to measure its error.
    #[arg(long)]
    no_check: bool,
    #[command(flatten)]
    options: Flags<Exporters>,
    #[command(flatten)]
    assumptions: Assumptions,
}

fn output_help() -> String {
    let brdf = choice::brdf_formats();
    format!("{}\n\nA BRDF:\n{brdf}", choice::btf_output("File or folder to write; the ending chooses the format"))
}

fn epilogue() -> String {
    let section = |(name, params)| Section { name, title: format!("Parameters of --to {name}"), params };
    let sections: Vec<Section> =
        Exporters::tables().into_iter().filter(|(_, params)| !params.is_empty()).map(section).collect();
    help::epilogue(
        &sections,
        &[
            "loden convert wool.zip wool.toml",
            "loden convert wool.loden wool.btf --components 16",
            "loden convert gold.binary gold.bsdf",
        ],
    )
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
    const HEADING: Option<&'static str> = Some("Pictures");

    fn tables() -> Vec<(&'static str, &'static [Param])> {
        Exporters::tables().into_iter().filter(|(name, _)| *name == "ubo2003").collect()
    }
}

impl Convert {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let (outputs, format) = (Outputs::new(terminal, [&self.source]), self.to.as_deref());
        let target = match export::brdf_exporter(&self.output, format) {
            Ok(_) => outputs.brdf(&self.output, format)?,
            Err(_) => outputs.btf(&self.output, format)?,
        };
        let request = ConvertRequest {
            source: self.source,
            output: target.path().into(),
            format: self.to,
            export: self.options.given().clone(),
            import: self.assumptions.given().clone(),
            check: !self.no_check,
        };
        let mut done = job::convert(&request, terminal)?;
        match &mut done {
            Conversion::Btf(done) => done.output = target.finish()?,
            Conversion::Brdf(done) => done.output = target.finish()?,
        }
        terminal.result(&done, || text(&done))
    }
}

fn text(done: &Conversion) -> String {
    let (first, errors, lost) = match done {
        Conversion::Btf(done) => {
            let first = format!("{}: {}, {}", done.output.display(), done.format, report::count(done.images, "image"));
            (first, [("mean error of display values", done.mean_error), ("largest", done.largest_error)], &done.lost)
        }
        Conversion::Brdf(done) => {
            let first =
                format!("{}: {}, {}", done.output.display(), done.format, report::count(done.samples, "sample"));
            let relative = ("error relative to the values, cosine-weighted", done.relative_error);
            (first, [relative, ("largest", done.largest_error)], &done.lost)
        }
    };
    let errors = errors.into_iter().filter_map(|(name, error)| Some(format!("\n{name}: {:.6}", error?)));
    let lost = lost.iter().map(|what| format!("\nlost: {what}"));
    first + &errors.chain(lost).collect::<String>()
}
