//! `loden edit`: another colour, gloss or contrast.

use std::path::PathBuf;

use clap::Args;
use clap::builder::RangedU64ValueParser;
use loden::Error;
use loden::generate::{Edit as Changes, Recolor, Selection, color};
use loden::job::{self, EditRequest, On};

use crate::flags::Assumptions;
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden edit hat.loden --recolor from=d8b020,to=b02018 -o red.loden
  loden edit hat.loden --recolor hue=90,saturation=0.8 --gloss 0.7 -o green.loden
  loden edit stone.loden --contrast 0.5 --mask path.png -o flat.loden
  loden edit stone.loden --tint ffe0c0 --exposure 0.5 --rows 0,3,8-12 -o warm.loden")]
pub struct Edit {
    /// The material; one without rows, such as one compressed by klt, is clustered first.
    input: PathBuf,
    /// Change the colour of the diffuse part: hue=DEGREES,saturation=FACTOR,lightness=L in CIE Lab, or from=RRGGBB,to=RRGGBB.
    #[arg(long, value_name = "HOW")]
    recolor: Option<Recolor>,
    /// Divide the roughness of highlights; above 1 they are sharper.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    gloss: f32,
    /// Multiply the strength of highlights; 0 removes them.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    highlights: f32,
    /// Depth of shadows and shading: 0 removes them, 2 deepens them.
    #[arg(long, value_name = "EXPONENT", default_value_t = 1.0)]
    contrast: f32,
    /// Multiply by a colour, RRGGBB, highlights too.
    #[arg(long, value_name = "RRGGBB", default_value = "ffffff")]
    tint: String,
    /// Make brighter by this many stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_hyphen_values = true)]
    exposure: f32,
    /// Move colours to grey, 0 to 1.
    #[arg(long, value_name = "AMOUNT", default_value_t = 0.0)]
    desaturate: f32,
    /// Change these rows alone, such as 0,3,8-12.
    #[arg(long, value_name = "LIST", group = "on")]
    rows: Option<String>,
    /// Change the rows near a mean colour alone: RRGGBB,RADIUS, with the largest difference in CIE Lab.
    #[arg(long, value_name = "COLOR,RADIUS", group = "on")]
    colors: Option<String>,
    /// Change these texels alone: a picture of the size of the material, white where it changes.
    #[arg(long, value_name = "FILE", group = "on")]
    mask: Option<PathBuf>,
    /// Change the texels connected with texel X,Y alone, as far as their mean colours are like its own.
    #[arg(long, value_name = "X,Y", group = "on")]
    grow: Option<String>,
    /// The largest difference of colours for --grow, in CIE Lab.
    #[arg(long, value_name = "RADIUS", default_value_t = 10.0, requires = "grow")]
    similar: f64,
    /// Clusters of a material that has no rows.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clusters())]
    clusters: u32,
    /// File to write, .loden; - for standard output.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// A number of clusters.
pub fn clusters() -> RangedU64ValueParser<u32> {
    RangedU64ValueParser::new().range(1..=1 << 16)
}

impl Edit {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let outputs = Outputs::new(terminal, [Some(&self.input), self.mask.as_ref()].into_iter().flatten());
        let target = outputs.file(&self.output, &["loden"])?;
        let edit = Changes {
            recolor: self.recolor,
            gloss: self.gloss,
            highlights: self.highlights,
            contrast: self.contrast,
            tint: color(&self.tint)?.to_array(),
            exposure: self.exposure,
            desaturate: self.desaturate,
        };
        let request = EditRequest {
            on: self.on()?,
            options: self.assumptions.given().clone(),
            input: self.input,
            edit,
            clusters: self.clusters as usize,
            output: target.path().to_path_buf(),
        };
        let mut done = job::edit(&request, terminal)?;
        done.output = target.finish()?;
        terminal.result(&done, || {
            let (file, size, [before, after]) = (done.output.display(), report::bytes(done.bytes), done.rows);
            let more = if after == before { String::new() } else { format!(", {before} before") };
            format!("{file}: {after} rows{more}, {size}, {:.1} s", done.seconds)
        })
    }

    /// What is changed.
    fn on(&self) -> loden::Result<On> {
        let wrong = |name: &str, found: &str, expected: &str| {
            Error::parameter(name, format!("found {found:?}, expected {expected}"))
        };
        if let Some(path) = &self.mask {
            return Ok(On::Mask(path.clone()));
        }
        let selection = if let Some(list) = &self.rows {
            let rows = numbers(list).ok_or_else(|| wrong("rows", list, "numbers and ranges such as 0,3,8-12"))?;
            Selection::Rows(rows)
        } else if let Some(text) = &self.colors {
            let parts = text.split_once(',').and_then(|(c, radius)| Some((c, radius.parse::<f64>().ok()?)));
            let (center, radius) =
                parts.ok_or_else(|| wrong("colors", text, "a colour and a radius such as e0c030,25"))?;
            Selection::Colors { center: color(center)?, radius }
        } else if let Some(text) = &self.grow {
            let parts = text.split_once(',').and_then(|(x, y)| Some((x.parse().ok()?, y.parse().ok()?)));
            let (x, y) = parts.ok_or_else(|| wrong("grow", text, "a column and a row such as 12,40"))?;
            Selection::Grow { x, y, radius: self.similar }
        } else {
            Selection::All
        };
        Ok(On::Selection(selection))
    }
}

/// The numbers of a list with ranges.
fn numbers(list: &str) -> Option<Vec<usize>> {
    let mut all = Vec::new();
    for part in list.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (usize, usize) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
        // as many as rows can be
        if first > last || last >= 1 << 16 {
            return None;
        }
        all.extend(first..=last);
    }
    Some(all)
}
