//! `loden generate`: new materials from several old ones.

use std::path::PathBuf;

use clap::builder::RangedU64ValueParser;
use clap::{Args, Subcommand};
use loden::generate::{Edit, Keep, MAX_VARIANTS, Match, Recolor};
use loden::job::{self, BlendRequest, ExchangeRequest, FamilyRequest, Look, Variant};
use loden::progress::Progress;

use super::edit::clusters;
use crate::choice;
use crate::flags::Assumptions;
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Generate {
    #[command(subcommand)]
    command: Kind,
}

#[derive(Subcommand)]
enum Kind {
    /// Put the reflectance of one material on the pattern of another
    ///
    /// Texels keep their places, and get rows of the other material: an index image of one, a block of the other. Materials
    /// without rows, such as those compressed by klt, are clustered first, and a warning gives the error of that.
    Exchange(Exchange),
    /// Mix two materials, everywhere or by a mask
    ///
    /// Keeps the pattern of the first. Rows move towards those of the second that optimal transport matches them with, and
    /// highlights move rather than fade. At 0 the first is left as it is; at 1 the result is that of `generate exchange`.
    Blend(Blend),
    /// Make variants of a material: other colours, gloss, contrast
    ///
    /// Every variant is what `loden edit` makes of the material by numbers that are drawn at random, and its file lists them. The
    /// properties are spread evenly over their ranges. A sheet shows the material and its variants on an object.
    Family(Family),
}

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden generate blend dry.loden wet.loden --amount 0.3 -o damp.loden
  loden generate blend new.loden worn.loden --amount 1 --mask edges.png -o used.loden")]
struct Blend {
    /// The material whose pattern is kept.
    first: PathBuf,
    /// The material that is mixed in.
    second: PathBuf,
    /// How much of the second, 0 to 1.
    #[arg(long, value_name = "AMOUNT", default_value_t = 0.5)]
    amount: f32,
    /// Multiply the amount by the brightness of a picture of the size of the first material.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// Clusters of a material that has no rows.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clusters())]
    clusters: u32,
    /// File to write, .loden; - for standard output.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    assumptions: Assumptions,
}

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden generate exchange --structure twill.loden --reflectance leather.loden -o new.loden
  loden generate exchange --structure twill.loden --reflectance leather.loden --keep shading -o new.loden
  loden generate exchange --structure a.zip --reflectance b.zip --match brightness --clusters 64 -o new.loden")]
struct Exchange {
    /// The material whose pattern is taken.
    #[arg(long, value_name = "MATERIAL")]
    structure: PathBuf,
    /// The material whose reflectance is taken.
    #[arg(long, value_name = "MATERIAL")]
    reflectance: PathBuf,
    /// How rows are matched: by number, by brightness, one to one by what they look like, or by optimal transport, in which
    /// rows count as often as they occur.
    #[arg(long = "match", default_value = Match::Transport.name(), value_name = "HOW", value_parser = choice::words(Match::ALL.iter().map(|by| by.name())))]
    by: String,
    /// Regularise the transport: mass spreads over rows whose squared differences are within this of the best.
    #[arg(long, value_name = "EPSILON")]
    regularise: Option<f64>,
    /// Split a row over all rows that the transport sends its texels to: every row of the other material occurs as often as there. Without it,
    /// all texels of a row go to one.
    #[arg(long)]
    split: bool,
    /// What the pattern keeps besides itself: its shadows and interreflections, or nothing.
    #[arg(long, default_value = Keep::Nothing.name(), value_name = "WHAT", value_parser = choice::words(Keep::ALL.iter().map(|keep| keep.name())))]
    keep: String,
    /// Clusters of a material that has no rows.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clusters())]
    clusters: u32,
    /// File to write, .loden; - for standard output.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    assumptions: Assumptions,
}

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden generate family hat.loden -n 12 -o hats
  loden generate family hat.loden -n 8 --spread 0.5 --seed 3 --object teapot -o hats")]
struct Family {
    /// The material; one without rows, such as one compressed by klt, is clustered first.
    input: PathBuf,
    /// Number of variants.
    #[arg(long, short = 'n', value_name = "N", default_value_t = 12, value_parser = RangedU64ValueParser::<u32>::new().range(1..=MAX_VARIANTS as u64))]
    count: u32,
    /// Chooses one of many families; the same seed gives the same bytes.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// How different the variants are, 0 to 2: at 1, hues turn by up to 90 degrees, and gloss changes by up to 1.6 times.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    spread: f32,
    /// The object that wears the material on the sheet: a built-in one, or an .obj, .ply, .gltf or .glb file.
    #[arg(long, value_name = "OBJECT", default_value = "cloth")]
    object: String,
    /// Clusters of a material that has no rows.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clusters())]
    clusters: u32,
    /// Folder to write: the variants NAME-01.loden and so on, and sheet.png.
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Generate {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        match self.command {
            Kind::Exchange(exchange) => exchange.run(terminal),
            Kind::Blend(blend) => blend.run(terminal),
            Kind::Family(family) => family.run(terminal),
        }
    }
}

impl Blend {
    fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let sources = [Some(&self.first), Some(&self.second), self.mask.as_ref()];
        let target = Outputs::new(terminal, sources.into_iter().flatten()).file(&self.output, &["loden"])?;
        let request = BlendRequest {
            options: self.assumptions.given().clone(),
            first: self.first,
            second: self.second,
            amount: self.amount,
            mask: self.mask,
            clusters: self.clusters as usize,
            output: target.path().to_path_buf(),
        };
        let mut done = job::blend(&request, terminal)?;
        done.output = target.finish()?;
        terminal.result(&done, || {
            let (file, size, [n, m]) = (done.output.display(), report::bytes(done.bytes), done.rows);
            format!("{file}: {n} rows mixed with {m}, {size}, {:.1} s", done.seconds)
        })
    }
}

impl Exchange {
    fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let outputs = Outputs::new(terminal, [&self.structure, &self.reflectance]);
        let target = outputs.file(&self.output, &["loden"])?;
        let request = ExchangeRequest {
            structure: self.structure,
            reflectance: self.reflectance,
            options: self.assumptions.given().clone(),
            by: Match::ALL.iter().copied().find(|by| by.name() == self.by).unwrap_or(Match::Transport),
            epsilon: self.regularise,
            split: self.split,
            keep: Keep::ALL.iter().copied().find(|keep| keep.name() == self.keep).unwrap_or(Keep::Nothing),
            clusters: self.clusters as usize,
            output: target.path().to_path_buf(),
        };
        let mut done = job::exchange(&request, terminal)?;
        done.output = target.finish()?;
        terminal.result(&done, || {
            let (file, size, [n, m]) = (done.output.display(), report::bytes(done.bytes), done.rows);
            format!("{file}: {n} rows matched with {} of {m}, {size}, {:.1} s", done.used, done.seconds)
        })
    }
}

/// Size of a picture of the sheet, and its samples per pixel.
const SHEET: ([usize; 2], u32) = ([240, 224], 32);

impl Family {
    fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        Outputs::new(terminal, [&self.input]).folder(&self.output)?;
        let ([width, height], spp) = SHEET;
        let request = FamilyRequest {
            input: self.input,
            options: self.assumptions.given().clone(),
            count: self.count as usize,
            seed: self.seed,
            spread: self.spread,
            look: Look { denoise: true, ..Look::new(&self.object, width, height, spp) },
            clusters: self.clusters as usize,
            output: self.output,
        };
        let done = job::family(&request, terminal)?;
        let sheet = done.output.join("sheet.png");
        done.sheet.write_noted(&sheet, terminal.command())?;
        terminal.result(&done, || {
            let rows: Vec<Vec<String>> = done.variants.iter().map(cells).collect();
            let header = ["file", "hue", "saturation", "lightness", "gloss", "highlights", "contrast"];
            format!("{}\nLook at {}", report::table(&header, &rows).trim_end(), sheet.display())
        })
    }
}

/// The line of a variant in the table.
fn cells(variant: &Variant) -> Vec<String> {
    let Edit { recolor, gloss, highlights, contrast, .. } = variant.edit;
    let [hue, saturation, lightness] = match recolor {
        Some(Recolor::Turn { hue, saturation, lightness }) => [hue, saturation, lightness],
        _ => [0.0, 1.0, 0.0],
    };
    let numbers = [hue, saturation, lightness, gloss, highlights, contrast].map(|number| number.to_string());
    [vec![variant.file.display().to_string()], numbers.to_vec()].concat()
}
