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
use crate::choice;
use crate::flags::{Flags, Tables};
use crate::help::{self, Section};
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = epilogue())]
pub struct Acquire {
    /// Sample to measure.
    #[arg(value_parser = choice::sample())]
    sample: String,
    #[arg(long, short, value_name = "FILE", help = "BTF to write: .zip, .btf, .toml or a folder; with --raw a folder", long_help = choice::btf_output("BTF to write; with --raw a folder"))]
    output: PathBuf,
    /// Set of view and light directions.
    #[arg(long, default_value = "bonn81", value_name = "SET", value_parser = choice::directions())]
    directions: String,
    /// Points per side of the height field, a power of two.
    #[arg(long, value_name = "N", default_value_t = 512)]
    grid: usize,
    /// Height map of the sample `maps`: a grey picture, white is high.
    #[arg(long, value_name = "FILE")]
    height: Option<PathBuf>,
    /// Albedo map of the sample `maps`: a picture [default: grey].
    #[arg(long, value_name = "FILE")]
    albedo: Option<PathBuf>,
    /// Take raw photographs for `loden rectify` instead of measuring texels.
    ///
    /// The sample lies in a marker frame and is seen in perspective by a camera with distortion, noise and several
    /// exposures. --spp then counts paths per pixel.
    #[arg(long)]
    raw: bool,
    #[command(flatten)]
    pictures: Pictures,
    #[command(flatten)]
    params: Flags<Samples>,
}

fn epilogue() -> String {
    let measurement = Section { name: "", title: "Measurement".into(), params: acquire::Options::TABLE };
    let raw = Section { name: "--raw", title: "Camera, with --raw".into(), params: Camera::TABLE };
    let maps = Section { name: "maps", title: "Parameters of maps".into(), params: maps::Options::TABLE };
    let samples = SAMPLES.iter().map(|sample| {
        let (name, params) = (sample.name(), sample.params());
        Section { name, title: format!("Parameters of {name}"), params }
    });
    let examples = [
        "loden acquire leather --size 128 --spp 32 -o leather.zip",
        "loden acquire maps --height bumps.png --albedo colour.png -o mine.zip",
        "loden acquire twill --raw -o photographs",
        "loden acquire twill --help",
    ];
    help::epilogue(&[measurement].into_iter().chain(samples).chain([maps, raw]).collect::<Vec<_>>(), &examples)
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
        let outputs = Outputs::new(terminal, self.height.iter().chain(&self.albedo));
        if self.raw {
            let camera = camera.read::<Camera>()?;
            let target = outputs.whole_folder(&self.output)?;
            let sets = [&directions, &directions];
            let count = photograph::photograph(&field, sets, &options, &camera, target.path(), terminal)?;
            target.finish()?;
            let (seconds, manifest) = (start.elapsed().as_secs_f64(), self.output.join(photograph::MANIFEST));
            let value = json!({ "output": self.output, "manifest": manifest, "sample": self.sample, "photographs": count, "pixels": camera.pixels, "spp": options.spp, "seconds": seconds });
            return terminal.result(&value, || {
                format!("{}: {}, {seconds:.1} s", manifest.display(), report::count(count, "photograph"))
            });
        }
        let target = outputs.btf(&self.output, None)?;
        job::measure(&field, &directions, &options, target.path(), self.pictures.given(), terminal)?;
        target.finish()?;
        let seconds = start.elapsed().as_secs_f64();
        let pairs = directions.len() * directions.len();
        let value = json!({ "output": self.output, "sample": self.sample, "images": pairs, "size": options.size, "spp": options.spp, "seconds": seconds });
        terminal
            .result(&value, || format!("{}: {}, {seconds:.1} s", self.output.display(), report::count(pairs, "image")))
    }

    fn field(&self, flags: &Flags<Samples>, seed: u64) -> loden::Result<HeightField> {
        if self.sample == "maps" {
            let missing = || Error::parameter("height", "the sample `maps` needs this picture");
            let height = self.height.as_ref().ok_or_else(missing)?;
            return acquire::maps::build(height, self.albedo.as_deref(), &flags.read::<maps::Options>()?, self.grid);
        }
        let sample = acquire::named(&self.sample)
            .ok_or_else(|| Error::parameter("SAMPLE", format!("found {:?}, which is no sample", self.sample)))?;
        sample.build(&flags.values(sample.params())?, self.grid, seed)
    }
}
