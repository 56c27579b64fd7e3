//! `loden acquire`: the virtual goniometer.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use loden::acquire::photograph::{self, Camera};
use loden::acquire::{self, HeightField, SAMPLES, Solid, Specimen, maps, mesh, yarn};
use loden::direction::DirectionSet;
use loden::params::{Param, Params};
use loden::progress::Progress;
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
    let others = [("maps", maps::Options::TABLE), ("mesh", mesh::Options::TABLE), ("yarn", yarn::Options::TABLE)];
    let others = others.map(|(name, params)| Section { name, title: format!("Parameters of {name}"), params });
    let samples = SAMPLES.iter().map(|sample| {
        let (name, params) = (sample.name(), sample.params());
        Section { name, title: format!("Parameters of {name}"), params }
    });
    let examples = [
        "loden acquire leather --size 128 --spp 32 -o leather.zip",
        "loden acquire maps --height bumps.png --albedo colour.png -o mine.zip",
        "loden acquire yarn --weave satin --yarns 16 -o satin.zip",
        "loden acquire mesh --object lace.glb --periodic --coverage holes.zip -o lace.zip",
        "loden acquire twill --raw -o photographs",
        "loden acquire twill --help",
    ];
    help::epilogue(&[measurement].into_iter().chain(samples).chain(others).chain([raw]).collect::<Vec<_>>(), &examples)
}

/// The parameters of the measurement and of all samples.
#[derive(Debug, Clone)]
struct Samples;

impl Tables for Samples {
    fn tables() -> Vec<(&'static str, &'static [Param])> {
        let samples = SAMPLES.iter().map(|sample| (sample.name(), sample.params()));
        let others = [("maps", maps::Options::TABLE), ("mesh", mesh::Options::TABLE), ("yarn", yarn::Options::TABLE)];
        let common = [("all", acquire::Options::TABLE), ("--raw", Camera::TABLE)];
        samples.chain(others).chain(common).collect()
    }
}

/// A sample as it was built.
enum Built {
    Field(HeightField),
    Solid(Solid),
}

impl<'a> From<&'a Built> for Specimen<'a> {
    fn from(built: &'a Built) -> Self {
        match built {
            Built::Field(field) => Self::Field(field),
            Built::Solid(solid) => Self::Solid(solid),
        }
    }
}

impl Acquire {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let (measurement, rest) = self.params.split(acquire::Options::TABLE);
        let (camera, sample_flags) = if self.raw { rest.split(Camera::TABLE) } else { (rest.clone(), rest) };
        let options = measurement.read::<acquire::Options>()?;
        let sample = self.build(&sample_flags, options.seed, terminal)?;
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

    fn photograph(
        &self,
        sample: &Built,
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

    fn build(&self, flags: &Flags<Samples>, seed: u64, terminal: &Terminal) -> loden::Result<Built> {
        let needed = |name: &str, what: &str, file: &Option<PathBuf>| {
            let missing = || Error::parameter(name, format!("the sample `{}` needs this {what}", self.sample));
            file.clone().ok_or_else(missing)
        };
        let albedo = self.albedo.as_deref();
        match self.sample.as_str() {
            "maps" => {
                let height = needed("height", "picture", &self.height)?;
                maps::build(&height, albedo, &flags.read::<maps::Options>()?, self.grid).map(Built::Field)
            }
            "mesh" => {
                let object = needed("object", "mesh", &self.object)?;
                let (solid, warnings) = mesh::build(&object, albedo, &flags.read::<mesh::Options>()?)?;
                warnings.iter().for_each(|warning| terminal.warn(warning));
                Ok(Built::Solid(solid))
            }
            "yarn" => yarn::build(&flags.read::<yarn::Options>()?, seed).map(Built::Solid),
            name => {
                let unknown = || Error::parameter("SAMPLE", format!("found {name:?}, which is no sample"));
                let sample = acquire::named(name).ok_or_else(unknown)?;
                sample.build(&flags.values(sample.params())?, self.grid, seed).map(Built::Field)
            }
        }
    }
}
