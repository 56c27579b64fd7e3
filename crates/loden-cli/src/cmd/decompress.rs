//! `loden decompress`: images out of a compressed material.

use std::path::{Path, PathBuf};

use clap::Args;
use loden::direction::Scheme;
use loden::{Error, codec, export, job};
use serde_json::json;

use super::convert::Pictures;
use crate::flags::Angles;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Decompress {
    /// A .loden file.
    input: PathBuf,
    /// `.zip` or a folder (Bonn layout) or `.toml` (raw array) for all images; with --light and --view a `.png` or `.exr`.
    #[arg(long, short, required_unless_present = "parts")]
    output: Option<PathBuf>,
    /// Write the index image and the block of ABRDFs of quantised materials into this folder, as pictures.
    #[arg(long, value_name = "FOLDER")]
    parts: Option<PathBuf>,
    /// One image, lit from here: polar angle,azimuth in degrees; any direction, not only measured ones.
    #[arg(long, value_name = "THETA,PHI", requires = "view")]
    light: Option<Angles>,
    /// One image, seen from here.
    #[arg(long, value_name = "THETA,PHI", requires = "light")]
    view: Option<Angles>,
    /// How to interpolate between measured directions.
    #[arg(long, default_value = "triangles")]
    interpolation: SchemeFlag,
    #[command(flatten)]
    pictures: Pictures,
}

/// See [`Scheme`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum SchemeFlag {
    Triangles,
    Rings,
}

impl From<SchemeFlag> for Scheme {
    fn from(flag: SchemeFlag) -> Self {
        match flag {
            SchemeFlag::Triangles => Self::Triangles,
            SchemeFlag::Rings => Self::Rings,
        }
    }
}

impl Decompress {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let compressed = codec::open(&self.input)?;
        if let Some(folder) = &self.parts {
            let quantised = compressed.quantised().ok_or_else(|| {
                let problem =
                    format!("{} has no index image: its method is {}", self.input.display(), compressed.method());
                Error::parameter("parts", problem)
            })?;
            quantised.write_parts(folder)?;
        }
        let images = match (&self.output, self.light, self.view) {
            (None, ..) => 0,
            (Some(output), Some(light), Some(view)) => {
                let [width, height] = [compressed.meta().width, compressed.meta().height];
                let material = compressed.material(self.interpolation.into())?;
                check_picture(output)?;
                job::photograph(material.as_ref(), width, height, light.direction(), view.direction())?
                    .write(output)?;
                1
            }
            (Some(output), ..) => {
                export::export(compressed.as_ref(), output, &self.pictures.options(), terminal)?;
                compressed.meta().pairs()
            }
        };
        terminal.result(&json!({ "output": self.output, "parts": self.parts, "images": images }), || {
            let written = [(&self.output, "images"), (&self.parts, "index image and block")];
            let line = |(path, what): (&Option<PathBuf>, &str)| {
                let count = if what == "images" { format!("{images} ") } else { String::new() };
                path.as_ref().map(|path| format!("{}: {count}{what}", path.display()))
            };
            written.into_iter().filter_map(line).collect::<Vec<_>>().join("\n")
        })
    }
}

fn check_picture(output: &Path) -> loden::Result<()> {
    let extension = output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
    match extension.as_str() {
        "png" | "exr" => Ok(()),
        _ => Err(Error::parameter("output", "with --light and --view a .png or .exr is expected")),
    }
}
