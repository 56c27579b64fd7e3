//! `loden brdf plot`: polar slices, the hemisphere, albedo over angle.

use std::path::{Path, PathBuf};

use clap::Args;
use loden::material::Material;
use loden::output::write_file;
use loden::{Error, plot};
use serde_json::json;

use crate::flags::Assumptions;
use crate::reflectance;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Plot {
    /// BRDF files, BTFs (averaged), or models such as `ward:alpha-x=0.1`.
    #[arg(required = true)]
    sources: Vec<String>,
    /// The folder for polar.svg, albedo.svg and one hemisphere-N.png per source.
    #[arg(long, short)]
    output: PathBuf,
    /// Polar angles of the light, degrees.
    #[arg(long, value_delimiter = ',', default_value = "20,45,70", value_name = "DEGREES")]
    lights: Vec<f32>,
    /// Pixels of a hemisphere's side.
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u16).range(8..=4096))]
    size: u16,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Plot {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        if let Some(light) = self.lights.iter().find(|t| !(0.0..90.0).contains(*t)) {
            return Err(
                Error::parameter("lights", format!("found {light}, expected degrees from 0 to below 90")).into()
            );
        }
        let mut brdfs = Vec::new();
        for source in &self.sources {
            brdfs.push((reflectance::label(source), reflectance::open(source, &self.assumptions, terminal)?));
        }
        std::fs::create_dir_all(&self.output).map_err(Error::io(&self.output))?;
        let named: Vec<plot::Named> =
            brdfs.iter().map(|(name, brdf)| (name.as_str(), brdf.as_ref() as &dyn Material)).collect();
        let mut files = vec![self.output.join("polar.svg"), self.output.join("albedo.svg")];
        write_text(&files[0], &plot::polar(&named, &self.lights))?;
        write_text(&files[1], &plot::albedo(&named))?;
        for (k, (_, brdf)) in named.iter().enumerate() {
            let path = self.output.join(format!("hemisphere-{}.png", k + 1));
            plot::hemisphere(*brdf, &self.lights, usize::from(self.size)).write_png(&path)?;
            files.push(path);
        }
        let list = files.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join("\n");
        terminal.result(&json!({ "sources": self.sources, "files": files }), || list)
    }
}

pub fn write_text(path: &Path, text: &str) -> loden::Result<()> {
    write_file(path, |out| out.write_all(text.as_bytes()))
}
