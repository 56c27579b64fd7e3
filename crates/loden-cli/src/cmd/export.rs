//! `loden export`: a material for another renderer.

use std::path::PathBuf;

use clap::Args;
use loden::params::Param;
use loden::{job, renderers};

use crate::choice;
use crate::flags::{Assumptions, Flags, Tables};
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Example:
  loden compress wool.zip -o wool.loden
  loden export wool.loden --to mitsuba -o wool-mitsuba
  python wool-mitsuba/scene.py ball.exr
  loden export wool.loden --to glsl -o wool-glsl        # then open wool-glsl/index.html
  loden export gold.bsdf --to three -o gold-three
  loden export wool.loden --to renderman --textures carrier -o wool-renderman
  loden export wool.loden --to gltf -o wool-gltf        # the closest standard material: wool-gltf/ball.glb")]
pub struct Export {
    /// Material: a compressed BTF, .loden, or any BRDF.
    ///
    /// Of a BRDF, an analytic model is exported by its parameters if the renderer has it; others become a table over
    /// directions, whose error is printed.
    input: PathBuf,
    /// Renderer.
    #[arg(long, value_name = "RENDERER", value_parser = choice::renderer())]
    to: String,
    /// Folder to write.
    #[arg(long, short, value_name = "FOLDER")]
    output: PathBuf,
    #[command(flatten)]
    options: Flags<Renderers>,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// The options of all renderers.
#[derive(Debug, Clone)]
struct Renderers;

impl Tables for Renderers {
    const HEADING: Option<&'static str> = Some("Options of renderers");

    fn tables() -> Vec<(&'static str, &'static [Param])> {
        renderers::RENDERERS.iter().map(|renderer| (renderer.name(), renderer.params())).collect()
    }
}

impl Export {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let outputs = Outputs::new(terminal, [&self.input]);
        let target = outputs.whole_folder(&self.output)?;
        let renderer = renderers::by_name(&self.to)?;
        // those of another renderer are refused here, by name
        self.options.values(renderer.params())?;
        let own = self.options.given().iter();
        let options = own.fold(self.assumptions.given().clone(), |given, (name, text)| given.with(name, text));
        let made = job::export_to(&self.input, &options, renderer, target.path(), terminal)?;
        target.finish()?;
        terminal.result(&made, || {
            let (files, bytes) = (report::count(made.files, "file"), report::bytes(made.bytes));
            let lost = made.table_error.map_or(String::new(), |error| {
                format!("; as a table over directions, whose mean relative error is {error:.4}")
            });
            let far = made.approximation.map_or(String::new(), |loss| format!("; {}", loss.sentence()));
            format!("{}: {files}, {bytes}{lost}{far}; begin with README.md", self.output.display())
        })
    }
}
