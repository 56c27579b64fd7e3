//! `loden decompress`: images out of a compressed material.

use std::path::{Path, PathBuf};

use clap::Args;
use loden::codec::parts::folder;
use loden::direction::Scheme;
use loden::{Error, codec, export, job};
use serde_json::json;

use super::convert::Pictures;
use crate::flags::Angles;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden decompress wool.loden -o wool.zip --png
  loden decompress wool.loden --light 30,60 --view 15,0 -o one.png")]
pub struct Decompress {
    /// Compressed BTF, .loden.
    input: PathBuf,
    /// All images: .zip, a folder (Bonn layout) or .toml (raw array). With --light and --view one picture, .png or
    /// .exr.
    #[arg(long, short, value_name = "FILE", required_unless_present = "parts")]
    output: Option<PathBuf>,
    /// Write the parts of the material into this folder: planes as .png and .exr, tables as .npy, and recipe.json;
    /// `loden compress --from-parts` reads them back.
    #[arg(long, value_name = "FOLDER")]
    parts: Option<PathBuf>,
    /// Direction of the light for one image: polar angle and azimuth in degrees, not only measured ones.
    #[arg(long, value_name = "THETA,PHI", requires = "view")]
    light: Option<Angles>,
    /// Direction of the viewer for one image.
    #[arg(long, value_name = "THETA,PHI", requires = "light")]
    view: Option<Angles>,
    /// Interpolation between measured directions.
    #[arg(long, default_value = "triangles")]
    interpolation: SchemeFlag,
    #[command(flatten)]
    pictures: Pictures,
}

/// See [`Scheme`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum SchemeFlag {
    /// Linear in triangles of a Delaunay triangulation of the directions.
    Triangles,
    /// Along and between rings of equal polar angle.
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
        let mut files = 0;
        if let Some(folder) = &self.parts {
            files = folder::write(&**compressed.parts(), &compressed.provenance()?, folder)?;
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
                export::export(compressed.as_ref(), output, self.pictures.given(), terminal)?;
                compressed.meta().pairs()
            }
        };
        let value = json!({ "output": self.output, "images": images, "parts": self.parts, "files": files });
        terminal.result(&value, || {
            let written = [(&self.output, images, "images"), (&self.parts, files, "files")];
            let line = |(path, count, what): (&Option<PathBuf>, usize, &str)| {
                path.as_ref().map(|path| format!("{}: {count} {what}", path.display()))
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
