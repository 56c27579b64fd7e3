//! `loden acquire`: the virtual goniometer.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use loden::acquire::photograph::{self, Camera};
use loden::acquire::{self, HeightField, SAMPLES, maps};
use loden::direction::DirectionSet;
use loden::params::{Param, Params};
use loden::{Error, job};
use serde_json::json;

use super::convert::Pictures;
use crate::flags::{Flags, Tables};
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Acquire {
    /// The sample: a built-in one, or `maps` with --height and --albedo.
    #[arg(value_name = "SAMPLE", help = sample_help())]
    sample: String,
    /// `.zip` or a folder (Bonn layout), or `.toml` (raw array of linear f32).
    #[arg(long, short)]
    output: PathBuf,
    /// Directions of views and lights: a known set.
    #[arg(long, default_value = "bonn81", value_name = "SET")]
    directions: String,
    /// Points per side of the height field, a power of two.
    #[arg(long, default_value_t = 512)]
    grid: usize,
    /// For `maps`: the heights, a grey picture.
    #[arg(long, value_name = "FILE")]
    height: Option<PathBuf>,
    /// For `maps`: the colours, a picture [default: grey].
    #[arg(long, value_name = "FILE")]
    albedo: Option<PathBuf>,
    /// Take raw photographs into a folder, for `loden rectify`: a sample in a marker frame, seen in perspective by a
    /// camera with distortion, noise and several exposures. Then --spp counts paths per pixel.
    #[arg(long)]
    raw: bool,
    #[command(flatten)]
    pictures: Pictures,
    #[command(flatten)]
    params: Flags<Samples>,
}

fn sample_help() -> String {
    let names: Vec<_> = SAMPLES.iter().map(|sample| sample.name()).collect();
    format!("A built-in sample ({}), or `maps` with --height and --albedo", names.join(", "))
}

/// The parameters of the measurement and of all samples.
#[derive(Debug, Clone)]
struct Samples;

impl Tables for Samples {
    fn tables() -> Vec<(&'static str, &'static [Param])> {
        let samples = SAMPLES.iter().map(|sample| (sample.name(), sample.params()));
        let others = [("maps", maps::Options::TABLE), ("all", acquire::Options::TABLE), ("--raw", Camera::TABLE)];
        samples.chain(others).collect()
    }
}

impl Acquire {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let (measurement, rest) = self.params.split(acquire::Options::TABLE);
        let (camera, sample_flags) = if self.raw { rest.split(Camera::TABLE) } else { (rest.clone(), rest) };
        let options = measurement.read::<acquire::Options>()?;
        let field = self.field(&sample_flags, options.seed)?;
        let directions = DirectionSet::named(&self.directions)
            .ok_or_else(|| Error::parameter("directions", format!("no set named {:?}; try bonn81", self.directions)))?;
        let start = Instant::now();
        if self.raw {
            let camera = camera.read::<Camera>()?;
            let sets = [&directions, &directions];
            let count = photograph::photograph(&field, sets, &options, &camera, &self.output, terminal)?;
            let (seconds, manifest) = (start.elapsed().as_secs_f64(), self.output.join(photograph::MANIFEST));
            let value = json!({ "output": self.output, "manifest": manifest, "sample": self.sample, "photographs": count, "pixels": camera.pixels, "spp": options.spp, "seconds": seconds });
            return terminal.result(&value, || format!("{}: {count} photographs, {seconds:.1} s", manifest.display()));
        }
        job::measure(&field, &directions, &options, &self.output, self.pictures.given(), terminal)?;
        let seconds = start.elapsed().as_secs_f64();
        let pairs = directions.len() * directions.len();
        let value = json!({ "output": self.output, "sample": self.sample, "images": pairs, "size": options.size, "spp": options.spp, "seconds": seconds });
        terminal.result(&value, || format!("{}: {pairs} images, {seconds:.1} s", self.output.display()))
    }

    fn field(&self, flags: &Flags<Samples>, seed: u64) -> loden::Result<HeightField> {
        if self.sample == "maps" {
            let missing = || Error::parameter("height", "the sample `maps` needs this picture");
            let height = self.height.as_ref().ok_or_else(missing)?;
            return acquire::maps::build(height, self.albedo.as_deref(), &flags.read::<maps::Options>()?, self.grid);
        }
        let sample = acquire::named(&self.sample)
            .ok_or_else(|| Error::parameter("SAMPLE", format!("found {:?}; {}", self.sample, sample_help())))?;
        sample.build(&flags.values(sample.params())?, self.grid, seed)
    }
}
