//! `loden decompress`: images out of a compressed material.

use std::path::{Path, PathBuf};

use clap::Args;
use loden::codec::CompressedBtf;
use loden::codec::parts::folder;
use loden::progress::Progress;
use loden::{codec, export, job};
use serde_json::json;

use super::convert::Pictures;
use crate::choice;
use crate::flags::{Angles, Between};
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden decompress wool.loden -o wool.zip --png
  loden decompress wool.loden --light 30,60 --view 15,0 -o one.png")]
pub struct Decompress {
    /// Compressed BTF, .loden.
    input: PathBuf,
    #[arg(long, short, value_name = "FILE", required_unless_present = "parts", help = "BTF to write: .zip, .btf, .toml or a folder; for one light and view a picture", long_help = choice::btf_output("BTF to write; for one light and view a picture, .png or .exr"))]
    output: Option<PathBuf>,
    /// Write the parts of the material into this folder: planes as .png and .exr, tables as .npy, and recipe.json;
    /// `loden compress --from-parts` reads them back.
    #[arg(long, value_name = "FOLDER")]
    parts: Option<PathBuf>,
    /// Direction of the light for one image: polar angle and azimuth in degrees, not only measured ones.
    #[arg(long, value_name = "THETA,PHI", requires = "view", allow_hyphen_values = true)]
    light: Option<Angles>,
    /// Direction of the viewer for one image.
    #[arg(long, value_name = "THETA,PHI", requires = "light", allow_hyphen_values = true)]
    view: Option<Angles>,
    #[command(flatten)]
    between: Between,
    #[command(flatten)]
    pictures: Pictures,
}

impl Decompress {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let outputs = Outputs::new(terminal, [&self.input]);
        let folder = self.parts.as_ref().map(|parts| outputs.whole_folder(parts)).transpose()?;
        let one = self.light.zip(self.view);
        let target = match (&self.output, one) {
            (None, _) => None,
            (Some(output), Some(_)) => Some(outputs.file(output, &["png", "exr"])?),
            (Some(output), None) => Some(outputs.btf(output, None)?),
        };
        let compressed = codec::open(&self.input)?;
        let (mut files, mut images) = (0, 0);
        if let Some(folder) = folder {
            files = folder::write(&**compressed.parts(), &compressed.provenance()?, folder.path())?;
            folder.finish()?;
        }
        if let Some(target) = target {
            images = self.images(compressed.as_ref(), one, target.path(), terminal)?;
            target.finish()?;
        }
        let value = json!({ "output": self.output, "images": images, "parts": self.parts, "files": files });
        terminal.result(&value, || {
            let written = [(&self.output, images, "image"), (&self.parts, files, "file")];
            let line = |(path, count, what): (&Option<PathBuf>, usize, &str)| {
                path.as_ref().map(|path| format!("{}: {}", path.display(), report::count(count, what)))
            };
            written.into_iter().filter_map(line).collect::<Vec<_>>().join("\n")
        })
    }

    /// Writes all images, or the one for a light and a view.
    fn images(
        &self,
        compressed: &CompressedBtf,
        one: Option<(Angles, Angles)>,
        path: &Path,
        terminal: &Terminal,
    ) -> anyhow::Result<usize> {
        let meta = compressed.meta();
        let Some((light, view)) = one else {
            export::export(compressed, path, self.pictures.given(), terminal)?;
            return Ok(meta.pairs());
        };
        let material = compressed.material(self.between.interpolation())?;
        let [wi, wo] = [light, view].map(Angles::direction);
        let picture = job::photograph(material.as_ref(), meta.width, meta.height, wi, wo)?;
        picture.write_noted(path, terminal.command())?;
        Ok(1)
    }
}
