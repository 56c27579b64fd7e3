//! `loden demo`: the main job from a measurement to a page about it.

mod commands;
mod story;

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use loden::btf::BtfMeta;
use loden::codec::{self, Codec};
use loden::job::{self, Look, Setting};
use loden::progress::Progress;
use loden::{Error, acquire, memory, output};
use serde_json::json;

use super::compare;
use crate::flags::Assumptions;
use crate::outputs::Outputs;
use crate::terminal::Terminal;
use commands::Commands;
use story::Story;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden demo
  loden demo wool.zip --components 4,9,16 -o wool")]
pub struct Demo {
    /// A BTF: any file or folder that `loden info` recognises [default: a simulated twill].
    source: Option<PathBuf>,
    /// Folder for the page, the pictures and the compressed files.
    #[arg(long = "output", short, alias = "out", default_value = "loden-demo", value_name = "DIR")]
    out: PathBuf,
    /// Numbers of components of the method pvmf, which the default method is compared with.
    #[arg(long, value_delimiter = ',', default_values_t = [2, 4, 9, 16], value_name = "C,...")]
    components: Vec<usize>,
    /// Texels per side of the simulated sample.
    #[arg(long, default_value_t = 64, value_name = "N")]
    size: usize,
    /// Paths per texel and view of the simulated sample.
    #[arg(long, default_value_t = 16, value_name = "N")]
    spp: u32,
    /// Render small, noisy pictures, for a first look.
    #[arg(long)]
    draft: bool,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// A position of the default method's quality dial beside its default.
const OTHER: f64 = 0.3;

/// Classical methods beside pvmf, each at two positions of its dial that take little time.
const CLASSICAL: [(&str, [f64; 2]); 2] = [("pca", [0.2, 0.4]), ("kmeans", [0.3, 0.6])];

impl Demo {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let start = Instant::now();
        Outputs::new(terminal, &self.source).folder(&self.out)?;
        output::create_folder(&self.out)?;
        let mut commands = Commands::new(&self.assumptions);
        let path = self.measurement(&mut commands, terminal)?;
        let source = job::open_btf(&path, self.assumptions.given(), terminal)?;
        let settings = self.settings(source.meta())?;
        let rows = job::compress_settings(source.as_ref(), &settings, &self.out, terminal)?;
        rows.iter().for_each(|row| commands.compress(&path, row));
        commands.compare(&path, &rows);
        let story = Story { demo: &self, path: &path, source: &source, rows: &rows };
        let html = story.write(commands, terminal)?;
        let page = self.out.join("index.html");
        output::write_file(&page, |file| file.write_all(html.as_bytes()))?;
        let seconds = start.elapsed().as_secs_f64();
        let value = json!({ "page": page, "rows": rows, "seconds": seconds, "peak_rss_bytes": memory::peak() });
        terminal.result(&value, || format!("{}\nLook at {} ({seconds:.0} s)", compare::table(&rows), page.display()))
    }

    /// The source, or a measurement of the virtual goniometer.
    fn measurement(&self, commands: &mut Commands, terminal: &Terminal) -> anyhow::Result<PathBuf> {
        if let Some(path) = &self.source {
            return Ok(path.clone());
        }
        let path = self.out.join("twill.zip");
        let options = acquire::Options { size: self.size, spp: self.spp, ..acquire::Options::default() };
        terminal.stage(&format!("measuring a simulated twill: 81 x 81 images of {0} x {0} texels", self.size));
        job::built_in("twill", &options, &path, terminal)?;
        commands.acquire("twill", &options, &path);
        Ok(path)
    }

    /// The default method at two settings, then classical ones.
    fn settings(&self, meta: &BtfMeta) -> loden::Result<Vec<(&'static dyn Codec, Setting)>> {
        let default = codec::by_name(codec::DEFAULT)?;
        let mut settings = vec![(default, Vec::new())];
        settings.push((default, default.dial(meta, OTHER)));
        let pvmf = codec::by_name("pvmf")?;
        let rank = meta.texels().saturating_sub(1).min(3 * meta.lights.len());
        let possible: Vec<usize> = self.components.iter().copied().filter(|count| (1..=rank).contains(count)).collect();
        if possible.is_empty() {
            let problem =
                format!("none of {:?} is between 1 and {rank}, the rank of this measurement", self.components);
            return Err(Error::parameter("components", problem));
        }
        settings.extend(possible.iter().map(|count| (pvmf, vec![("components", count.to_string())])));
        for (name, places) in CLASSICAL {
            let codec = codec::by_name(name)?;
            settings.extend(places.map(|place| (codec, codec.dial(meta, place))));
        }
        settings.dedup_by(|(a, first), (b, second)| a.name() == b.name() && first == second);
        Ok(settings)
    }

    fn look(&self, object: &str, [width, height]: [usize; 2], spp: u32) -> Look {
        match self.draft {
            true => Look::new(object, width / 8, height / 8, 4),
            false => Look::new(object, width, height, spp),
        }
    }
}
