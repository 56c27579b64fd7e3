//! `loden synthesize`: a material or picture larger than its sample.

mod page;

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use loden::Error;
use loden::job::{self, Features, Sample, Store, SurfaceRequest, SynthesisRequest, SynthesisSample};
use loden::output;
use loden::params::Param;
use loden::picture::Picture;
use loden::progress::Progress;
use loden::synth::surface::Stroke;
use loden::synth::{self, Goal, SYNTHESES, Synthesis};
use serde_json::json;

use crate::choice;
use crate::flags::{Assumptions, Flags, Size, Tables};
use crate::help::{self, Section};
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = epilogue())]
pub struct Synthesize {
    /// The sample: a .loden file or another BTF, which is then compressed; with --apply the picture to rearrange.
    #[arg(required_unless_present = "image", conflicts_with = "image")]
    source: Option<PathBuf>,
    /// Make a picture larger instead: PNG or EXR, whose depth is kept, or another format, which becomes PNG of 8 bits.
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    /// Use another sample of the same directions too, as often as WEIGHT says relative to the first: FILE or FILE:WEIGHT.
    ///
    /// May be given several times. Only --method optimise follows the weights. The result holds all samples, compressed.
    #[arg(
        long,
        value_name = "FILE",
        value_parser = weighted,
        requires = "source",
        conflicts_with_all = ["image", "apply", "mask", "report", "on"]
    )]
    with: Vec<(PathBuf, f32)>,
    /// Method.
    #[arg(long, default_value = synth::DEFAULT, value_parser = choice::synthesis())]
    method: String,
    /// Texels of the result, such as 1024x512.
    #[arg(long, required_unless_present_any = ["apply", "fill"])]
    size: Option<Size>,
    /// The texels of the sample that may be copied: a picture of its size, white where they may.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// Fill the texels that the mask excludes, and keep the others, instead of making something larger.
    #[arg(long, requires = "mask", conflicts_with_all = ["size", "apply"])]
    fill: bool,
    /// A picture that the result resembles from afar, of its size: the lightness of texels follows it.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["apply", "fill", "report", "on"])]
    guide: Option<PathBuf>,
    /// How closely the result follows --guide, against how much it looks like the sample.
    #[arg(long, value_name = "WEIGHT", default_value_t = 10.0, requires = "guide")]
    guide_weight: f32,
    /// Make a result that continues at its opposite edges.
    #[arg(long)]
    tileable: bool,
    /// The sample continues at its opposite edges.
    #[arg(long)]
    periodic: bool,
    /// Chooses one of many results; the same seed gives the same bytes.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// What the texels of a BTF are compared by: appearance, the height found from its shading, or both.
    #[arg(long, default_value = Features::Appearance.name(), value_parser = choice::words(Features::ALL.iter().map(|f| f.name())))]
    compare: String,
    /// Numbers per texel that stand for the appearance: the largest principal components of a BTF's images.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=64))]
    channels: u16,
    /// What the file of a material holds: the sample's planes and a map of sources, or rearranged planes.
    ///
    /// A map adds little to the file and suits every codec. Rearranged planes are as large as the result, and are
    /// not entropy-coded.
    #[arg(long, default_value = Store::Map.name(), value_parser = choice::words(Store::ALL.iter().map(|store| store.name())))]
    store: String,
    /// Write the map of sources too, to be applied to other pictures: PNG of 16 bits (red the column, green the row) or EXR.
    #[arg(long, value_name = "FILE", conflicts_with = "apply")]
    map: Option<PathBuf>,
    /// Rearrange the picture SOURCE by a map that --map wrote.
    #[arg(long, value_name = "MAP", requires = "source", conflicts_with_all = ["image", "size"])]
    apply: Option<PathBuf>,
    /// Instead of a result, write a page that compares methods on the sample: pictures, maps, times, measures.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["output", "map", "apply", "fill", "compare"])]
    report: Option<PathBuf>,
    /// Cover the surface of a mesh instead: a built-in object, or an .obj, .ply, .gltf or .glb file.
    ///
    /// --size is that of an atlas. Beside OUT.loden, the mesh is written with its texture coordinates as OUT.glb: render it with
    /// --uv-scale 1.
    #[arg(
        long,
        value_name = "MESH",
        requires = "source",
        conflicts_with_all = ["image", "apply", "fill", "report", "mask", "map", "tileable", "periodic", "store"]
    )]
    on: Option<String>,
    /// A direction that threads follow on the surface, near a point: X,Y,Z,DX,DY,DZ. May be given several times.
    #[arg(long, value_name = "NUMBERS", requires = "on", allow_hyphen_values = true, value_parser = stroke)]
    stroke: Vec<Stroke>,
    /// Methods of the report, separated by commas; efros-leung is slow.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "optimise,quilting,patches,wei-levoy,tiling",
        value_name = "NAME,...",
        requires = "report",
        value_parser = choice::synthesis()
    )]
    methods: Vec<String>,
    /// File to write: .loden, or .png or .exr for a picture; - for standard output.
    #[arg(long, short, value_name = "FILE", required_unless_present = "report")]
    output: Option<PathBuf>,
    #[command(flatten)]
    params: Flags<Methods>,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// A file, and behind a colon its weight.
fn weighted(text: &str) -> Result<(PathBuf, f32), String> {
    let parts = text.rsplit_once(':').and_then(|(file, weight)| Some((file, weight.parse::<f32>().ok()?)));
    match parts {
        Some((_, weight)) if !(weight.is_finite() && weight > 0.0) => Err("expected a weight above zero".into()),
        Some((file, weight)) => Ok((file.into(), weight)),
        None => Ok((text.into(), 1.0)),
    }
}

/// Six numbers with commas.
fn stroke(text: &str) -> Result<Stroke, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z, dx, dy, dz]) if [x, y, z, dx, dy, dz].iter().all(|v| v.is_finite()) => {
            Ok(Stroke { at: [x, y, z], along: [dx, dy, dz] })
        }
        _ => Err("expected six numbers: a point and a direction".into()),
    }
}

fn epilogue() -> String {
    let section = |method: &&dyn Synthesis| {
        let (name, params) = (method.name(), method.params());
        Section { name, title: format!("Parameters of --method {name}"), params }
    };
    let examples = [
        "loden synthesize wool.loden --size 1024 -o large.loden",
        "loden synthesize wool.loden --size 512x256 --tileable --method quilting --map map.png -o tile.loden",
        "loden synthesize --apply map.png height.exr -o large.exr",
        "loden synthesize --image wall.png --size 600 -o large.png",
        "loden synthesize wool.loden --mask undamaged.png --fill -o repaired.loden",
        "loden synthesize wool.loden --size 512 --report methods",
        "loden synthesize wool.loden --on teapot.obj --size 1024 -o teapot.loden",
        "loden synthesize --method wei-levoy --help",
    ];
    help::epilogue(&SYNTHESES.iter().map(section).collect::<Vec<_>>(), &examples)
}

/// The parameters of all methods.
#[derive(Debug, Clone)]
struct Methods;

impl Tables for Methods {
    fn tables() -> Vec<(&'static str, &'static [Param])> {
        SYNTHESES.iter().map(|method| (method.name(), method.params())).collect()
    }
}

impl Synthesize {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        if let Some(folder) = &self.report {
            return self.report(folder, terminal);
        }
        let output = self.output.as_ref().context("an output is expected")?;
        if let (Some(map), Some(picture)) = (&self.apply, &self.source) {
            return apply(map, picture, output, terminal);
        }
        if let Some(on) = &self.on {
            return self.on_surface(on, output, terminal);
        }
        let method = synth::by_name(&self.method)?;
        let params = self.params.values(method.params())?;
        let endings: &[&str] = if self.image.is_some() { &["png", "exr"] } else { &["loden"] };
        let outputs = Outputs::new(
            terminal,
            self.source
                .iter()
                .chain(&self.image)
                .chain(&self.mask)
                .chain(&self.guide)
                .chain(self.with.iter().map(|(file, _)| file)),
        );
        let target = outputs.file(output, endings)?;
        let map = outputs.optional(self.map.as_ref(), &["png", "exr"])?;
        let sample = match (self.image, self.source) {
            (Some(image), _) => Sample::Picture(image),
            (None, source) => {
                Sample::Material(source.context("a source is expected")?, self.assumptions.given().clone())
            }
        };
        let request = SynthesisRequest {
            sample,
            with: self.with,
            method,
            params,
            size: self.size.map(|size| [size.width, size.height]),
            tileable: self.tileable,
            seed: self.seed,
            mask: self.mask,
            guide: self.guide.map(|file| (file, self.guide_weight)),
            periodic: self.periodic,
            features: compared(&self.compare),
            channels: self.channels.into(),
            store: Store::ALL.iter().copied().find(|store| store.name() == self.store).unwrap_or(Store::Map),
            map: map.as_ref().map(|map| map.path().to_path_buf()),
            output: target.path().to_path_buf(),
        };
        let mut done = job::synthesize(&request, terminal)?;
        done.map = map.map(|map| map.finish()).transpose()?;
        done.output = target.finish()?;
        terminal.result(&done, || {
            let growth = done.growth.map_or(String::new(), |growth| format!(", {growth:.2} times the sample's"));
            let (file, size, seconds) = (done.output.display(), report::bytes(done.bytes), done.seconds);
            format!("{file}: {} x {} texels, {size}{growth}, {seconds:.1} s", done.width, done.height)
        })
    }

    /// Covers a surface.
    fn on_surface(&self, on: &str, output: &Path, terminal: &Terminal) -> anyhow::Result<()> {
        let source = self.source.as_ref().context("a source is expected")?;
        let size = self.size.context("a size is expected")?;
        if size.width != size.height {
            return Err(Error::parameter("size", "an atlas is square: give one number").into());
        }
        let outputs = Outputs::new(terminal, [source.as_path(), Path::new(on)]);
        let target = outputs.file(output, &["loden"])?;
        let mesh = outputs.file(&output.with_extension("glb"), &["glb"])?;
        let request = SurfaceRequest {
            sample: source.clone(),
            options: self.assumptions.given().clone(),
            on: on.to_owned(),
            side: size.width,
            seed: self.seed,
            strokes: self.stroke.clone(),
            features: compared(&self.compare),
            channels: self.channels.into(),
            output: target.path().to_path_buf(),
            mesh: mesh.path().to_path_buf(),
        };
        let mut done = job::synthesize_on(&request, terminal)?;
        (done.mesh, done.output) = (mesh.finish()?, target.finish()?);
        terminal.result(&done, || {
            let (file, mesh, size) = (done.output.display(), done.mesh.display(), report::bytes(done.bytes));
            format!("{file}, {mesh}: {} points, {size}, {:.1} s", done.points, done.seconds)
        })
    }

    /// Compares methods on a page.
    fn report(&self, folder: &Path, terminal: &Terminal) -> anyhow::Result<()> {
        let path = self.image.as_ref().or(self.source.as_ref()).context("a source is expected")?;
        Outputs::new(terminal, [path]).folder(folder)?;
        let mut sample = if self.image.is_some() {
            let mut warnings = Vec::new();
            let picture = Picture::read(path, &mut warnings)?;
            warnings.iter().for_each(|warning| terminal.warn(warning));
            SynthesisSample::of_picture(picture)
        } else {
            let source = job::open_btf(path, self.assumptions.given(), terminal)?;
            SynthesisSample::of_btf(source.as_ref(), self.channels.into(), terminal)?
        };
        if let Some(mask) = &self.mask {
            sample.exemplar.mask = Some(job::read_mask(mask, &sample.exemplar)?);
        }
        sample.exemplar.periodic = self.periodic;
        let size = self.size.context("a size is expected")?;
        let goal = Goal { tileable: self.tileable, seed: self.seed, ..Goal::new(size.width, size.height) };
        let row = |name: &String| {
            let method = synth::by_name(name)?;
            terminal.stage(name);
            sample.row(method, &self.params.split(method.params()).0.values(method.params())?, &goal, terminal)
        };
        let rows = self.methods.iter().map(row).collect::<loden::Result<Vec<_>>>()?;
        output::create_folder(folder)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let command = terminal.command().unwrap_or_default();
        let html = page::page(&name, &sample, &rows, command);
        let page = folder.join("index.html");
        output::write_file(&page, |file| file.write_all(html.as_bytes()))?;
        terminal.result(&rows, || format!("Look at {}", page.display()))
    }
}

fn compared(word: &str) -> Features {
    Features::ALL.iter().copied().find(|features| features.name() == word).unwrap_or(Features::Appearance)
}

/// Rearranges a picture by a map.
fn apply(map: &Path, picture: &Path, output: &Path, terminal: &Terminal) -> anyhow::Result<()> {
    let target = Outputs::new(terminal, [map, picture]).file(output, &["png", "exr"])?;
    job::apply_map(map, picture, target.path())?;
    let output = target.finish()?;
    terminal.result(&json!({ "output": output, "source": picture, "map": map }), || {
        format!("{}: rearranged by {}", output.display(), map.display())
    })
}
