//! `loden acquire`: the virtual goniometer.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use loden::acquire;
use loden::acquire::photograph::{self, Camera};
use loden::direction::DirectionSet;
use loden::job::{BuiltSample, SampleRequest};
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
    #[arg(long, value_name = "N", default_value_t = job::GRID)]
    grid: usize,
    /// Height map of the sample `maps`: a grey picture, white is high.
    #[arg(long, value_name = "FILE")]
    height: Option<PathBuf>,
    /// Mesh of the sample `mesh`: .obj, .ply, .gltf or .glb.
    #[arg(long, value_name = "FILE")]
    object: Option<PathBuf>,
    /// Albedo map of the samples `maps` and `mesh`: a picture [default: grey; of a mesh that of the file].
    #[arg(long, value_name = "FILE")]
    albedo: Option<PathBuf>,
    /// Also write what fraction of each texel the sample covers: a BTF of all views with one light, 0 in holes.
    ///
    /// Holes are black in the BTF itself: divided by the fraction, values are those of the sample alone.
    #[arg(long, value_name = "FILE", conflicts_with = "raw")]
    coverage: Option<PathBuf>,
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
    let samples = job::sample_kinds().into_iter().map(|kind| {
        let title = format!("Parameters of {}", kind.name);
        Section { name: kind.name, title, params: kind.params }
    });
    let examples = [
        "loden acquire leather --size 128 --spp 32 -o leather.zip",
        "loden acquire maps --height bumps.png --albedo colour.png -o mine.zip",
        "loden acquire yarn --weave satin --yarns 16 -o satin.zip",
        "loden acquire mesh --object lace.glb --periodic --coverage holes.zip -o lace.zip",
        "loden acquire twill --raw -o photographs",
        "loden acquire twill --help",
    ];
    help::epilogue(&[measurement].into_iter().chain(samples).chain([raw]).collect::<Vec<_>>(), &examples)
}

/// The parameters of the measurement and of all samples.
#[derive(Debug, Clone)]
struct Samples;

impl Tables for Samples {
    fn tables() -> Vec<(&'static str, &'static [Param])> {
        let samples = job::sample_kinds().into_iter().map(|kind| (kind.name, kind.params));
        let common = [("all", acquire::Options::TABLE), ("--raw", Camera::TABLE)];
        samples.chain(common).collect()
    }
}

impl Acquire {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let (measurement, rest) = self.params.split(acquire::Options::TABLE);
        let (camera, sample_flags) = if self.raw { rest.split(Camera::TABLE) } else { (rest.clone(), rest) };
        let options = measurement.read::<acquire::Options>()?;
        let sample = self.sample(&sample_flags, options.seed).build(terminal)?;
        let directions = DirectionSet::named(&self.directions)
            .ok_or_else(|| Error::parameter("directions", format!("no set named {:?}; try bonn81", self.directions)))?;
        let start = Instant::now();
        let outputs = Outputs::new(terminal, self.height.iter().chain(&self.albedo).chain(&self.object));
        if self.raw {
            let camera = camera.read::<Camera>()?;
            return self.photograph(&sample, &directions, &options, &camera, &outputs, terminal);
        }
        let target = outputs.btf(&self.output, None)?;
        let holes = self.coverage.as_ref().map(|path| outputs.btf(path, None)).transpose()?;
        let pictures = self.pictures.given();
        job::measure(&sample, &directions, &options, target.path(), pictures, terminal)?;
        if let Some(holes) = holes {
            job::coverage(&sample, &directions, &options, holes.path(), pictures, terminal)?;
            holes.finish()?;
        }
        target.finish()?;
        let seconds = start.elapsed().as_secs_f64();
        let pairs = directions.len() * directions.len();
        let value = json!({ "output": self.output, "sample": self.sample, "images": pairs, "size": options.size, "spp": options.spp, "seconds": seconds });
        terminal
            .result(&value, || format!("{}: {}, {seconds:.1} s", self.output.display(), report::count(pairs, "image")))
    }

    fn sample(&self, flags: &Flags<Samples>, seed: u64) -> SampleRequest {
        SampleRequest {
            name: self.sample.clone(),
            params: flags.given().clone(),
            grid: self.grid,
            seed,
            height: self.height.clone(),
            object: self.object.clone(),
            albedo: self.albedo.clone(),
        }
    }

    fn photograph(
        &self,
        sample: &BuiltSample,
        directions: &DirectionSet,
        options: &acquire::Options,
        camera: &Camera,
        outputs: &Outputs,
        terminal: &Terminal,
    ) -> anyhow::Result<()> {
        let (start, target) = (Instant::now(), outputs.whole_folder(&self.output)?);
        let count = photograph::photograph(sample, [directions; 2], options, camera, target.path(), terminal)?;
        target.finish()?;
        let (seconds, manifest) = (start.elapsed().as_secs_f64(), self.output.join(photograph::MANIFEST));
        let value = json!({ "output": self.output, "manifest": manifest, "sample": self.sample, "photographs": count, "pixels": camera.pixels, "spp": options.spp, "seconds": seconds });
        terminal.result(&value, || {
            format!("{}: {}, {seconds:.1} s", manifest.display(), report::count(count, "photograph"))
        })
    }
}
