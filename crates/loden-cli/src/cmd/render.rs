//! `loden render`: an object wearing a material, or a scene.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use loden::Error;
use loden::import::{self, Measured};
use loden::material::{Material, PagedBtf};
use loden::memory::Memory;
use loden::picture::Picture;
use loden::progress::Progress;
use loden::render::scene_file::SceneFile;
use loden::render::{
    Checkpoint, Effort, EnvironmentMap, Lighting, Rendered, Settings, Studio, TextureMap, object, render_in_steps,
    studio, studio_scene,
};
use serde_json::{Value, json};

use super::decompress::SchemeFlag;
use super::sheet::{self, Worn};
use crate::flags::{Angles, Assumptions, Size};
use crate::report;
use crate::terminal::Terminal;

/// What of the memory is left to all but images, at most.
const REST: u64 = 64 << 20;

/// Between two writings of a checkpoint.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(20);

#[derive(Args)]
pub struct Render {
    #[arg(long, help = object_help(), required_unless_present_any = ["scene", "sheet"])]
    object: Option<String>,
    /// What it wears: a .loden file, or anything else `loden info` knows.
    #[arg(long, value_name = "FILE", required_unless_present_any = ["scene", "sheet"])]
    material: Option<PathBuf>,
    /// A measurement and compressed forms of it side by side on one object (a sphere if none is named), with their differences
    /// eight times below: -o .png or .exr, or .html with the numbers.
    #[arg(long, num_args = 2.., value_names = ["SOURCE", "FILES"], conflicts_with_all = ["scene", "material", "checkpoint", "time_limit", "target_error", "memory"])]
    sheet: Vec<PathBuf>,
    /// A scene instead of an object: .toml, .rib or .rib.gz (docs/scenes.md).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["object", "material", "light", "env", "uv_scale", "uv_rotation"])]
    scene: Option<PathBuf>,
    /// The picture to write, .png or .exr (of a sheet .html, too).
    #[arg(long, short)]
    output: PathBuf,
    /// A key light from here: angle from the vertical, azimuth (0 from the right, 90 from the camera), degrees.
    #[arg(long, value_name = "THETA,PHI", conflicts_with = "env")]
    light: Option<Angles>,
    /// Light from all around: a latitude-longitude picture, .exr or .hdr.
    #[arg(long, value_name = "FILE")]
    env: Option<PathBuf>,
    /// Turns the environment about the vertical, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    env_rotation: f32,
    /// Pixels, WIDTHxHEIGHT [default: the scene's, else 512x512].
    #[arg(long)]
    size: Option<Size>,
    /// Samples per pixel; powers of two are best [default: the scene's, else 64].
    #[arg(long)]
    spp: Option<u32>,
    /// The most segments of a path, the camera ray included: 2 is direct light only [default: the scene's, else 6].
    #[arg(long)]
    depth: Option<u32>,
    /// Another seed gives the same picture with other noise.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Stop after so many seconds with the samples taken by then, one of every pixel at least.
    #[arg(long, value_name = "SECONDS")]
    time_limit: Option<f64>,
    /// Take samples only until the relative error of each square of 16 x 16 pixels is below this; --spp is the most then.
    #[arg(long, value_name = "FRACTION")]
    target_error: Option<f32>,
    /// Keep the samples in this file now and then and at the end; if it exists, go on from it. More --spp refine a picture.
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// The memory for an uncompressed BTF, such as 512M: of more images the rest is in a temporary file beside the output (of a
    /// scene: in the folder for temporary files). A part, 64M at most, is left to the rest of the program.
    #[arg(long, value_name = "BYTES")]
    memory: Option<Memory>,
    /// Repeats of the material per repeat of the object's texture coordinates.
    #[arg(long, default_value_t = 4.0)]
    uv_scale: f32,
    /// Turns the material on the object, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    uv_rotation: f32,
    /// The most points of a texture finer than the pixels that a camera ray averages, 1 to 64 [default: the scene's, else 1].
    #[arg(long, value_name = "POINTS")]
    texture_samples: Option<u32>,
    /// How to interpolate between measured directions.
    #[arg(long, default_value = "triangles")]
    interpolation: SchemeFlag,
    #[command(flatten)]
    assumptions: Assumptions,
}

fn object_help() -> String {
    let names: Vec<_> = object::OBJECTS.iter().map(|object| object.name).collect();
    format!("What is looked at: {}, or an .obj, .gltf, .glb or .ply file", names.join(", "))
}

/// How to look at a material on an object.
#[derive(Debug, Clone)]
pub struct Look {
    pub object: String,
    pub settings: Settings,
    pub texture: TextureMap,
    pub lighting: Lighting,
}

impl Look {
    /// The default look at an object of this name or file.
    pub fn new(object: &str, width: usize, height: usize, spp: u32) -> Self {
        Self {
            object: object.into(),
            settings: Settings { width, height, spp, ..Settings::default() },
            texture: TextureMap { scale: 4.0, ..TextureMap::default() },
            lighting: Lighting::default(),
        }
    }
}

/// Renders it.
pub fn draw(look: &Look, material: &dyn Material, name: &str, progress: &dyn Progress) -> loden::Result<Picture> {
    let object = object::load(&look.object)?;
    let scene = Studio {
        object: &object,
        material,
        material_name: name,
        texture: look.texture,
        lighting: look.lighting.clone(),
    };
    studio(&scene, &look.settings, progress)
}

/// A picture and how it came about.
struct Made {
    settings: Settings,
    rendered: Rendered,
    /// That tracing took.
    seconds: f64,
    /// Materials that are not in memory as a whole.
    paged: Vec<Arc<PagedBtf>>,
}

fn paging(btf: &Arc<PagedBtf>) -> Value {
    let (asked, read) = btf.requests();
    json!({ "resident_bytes": btf.resident_bytes(), "file_bytes": btf.file_bytes(), "pages_asked": asked, "pages_read": read })
}

impl Render {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        self.check_output()?;
        if let [original, others @ ..] = &self.sheet[..] {
            return self.sheet(original, others, terminal);
        }
        let made = match (&self.scene, &self.object, &self.material) {
            (Some(file), ..) => self.scene(file, terminal)?,
            (None, Some(object), Some(material)) => self.object(object, material, terminal)?,
            _ => unreachable!("clap asks for a scene, or an object and a material"),
        };
        let Made { settings, rendered, seconds, paged } = made;
        rendered.picture.write(&self.output)?;
        let Settings { width, height, spp, .. } = settings;
        let rate = rendered.samples as f64 / seconds;
        let peak = report::peak_rss();
        let mut value = json!({
            "output": self.output, "width": width, "height": height, "spp": spp, "seconds": seconds, "samples_per_s": rate,
            "samples_per_pixel": rendered.samples_per_pixel, "complete": rendered.complete, "peak_rss_bytes": peak,
        });
        if !paged.is_empty() {
            value["paged"] = paged.iter().map(paging).collect();
        }
        terminal.result(&value, || {
            let mut text =
                format!("{}: {seconds:.1} s, {:.2} million samples a second", self.output.display(), rate / 1e6);
            if !rendered.complete || self.target_error.is_some() {
                text += &format!(", {:.1} samples per pixel", rendered.samples_per_pixel);
            }
            for btf in &paged {
                let [resident, file] = [btf.resident_bytes(), btf.file_bytes()].map(report::bytes);
                text += &format!(
                    "\nmaterial: {resident} of {file} in memory; the program had {} at most",
                    report::bytes(peak)
                );
            }
            text
        })
    }

    fn scene(&self, file: &Path, terminal: &Terminal) -> anyhow::Result<Made> {
        let mut scene = SceneFile::open_within(file, self.for_images())?;
        if let Some(samples) = self.texture_samples {
            scene.bodies.iter_mut().for_each(|body| body.texture.samples = samples);
        }
        terminal.warn(&scene.warnings);
        let settings = self.settings(scene.settings);
        let effort = self.effort(&[file])?;
        let start = Instant::now();
        let rendered = render_in_steps(&scene.scene(), &settings, &effort, terminal)?;
        Ok(Made { settings, rendered, seconds: start.elapsed().as_secs_f64(), paged: scene.paged })
    }

    /// When to stop; checkpoints know the picture by these files and the flags.
    fn effort(&self, files: &[&Path]) -> loden::Result<Effort> {
        let limit = |seconds: f64| {
            let wrong = |_| Error::parameter("time-limit", format!("found {seconds}, expected seconds"));
            Duration::try_from_secs_f64(seconds).map_err(wrong)
        };
        let mut words = format!(
            "{:?} {:?} {} {} {} {:?} {:?} {:?}",
            self.object,
            self.light,
            self.env_rotation,
            self.uv_scale,
            self.uv_rotation,
            self.texture_samples,
            self.interpolation,
            self.assumptions
        );
        for file in files {
            let found = std::fs::metadata(file).map_err(Error::io(file))?;
            words += &format!(" {} {} {:?}", file.display(), found.len(), found.modified().ok());
        }
        let checkpoint = |path: &PathBuf| Checkpoint { path: path.clone(), scene: words, every: CHECKPOINT_EVERY };
        Ok(Effort {
            time_limit: self.time_limit.map(limit).transpose()?,
            relative_error: self.target_error,
            checkpoint: self.checkpoint.as_ref().map(checkpoint),
        })
    }

    fn object(&self, object: &str, path: &Path, terminal: &Terminal) -> anyhow::Result<Made> {
        let lighting = self.lighting()?;
        let settings = self.settings(Settings::default());
        let texture = self.texture();
        let files = [Some(path), self.env.as_deref()];
        let effort = self.effort(&files.into_iter().flatten().collect::<Vec<_>>())?;
        let object = object::load(object)?;
        let (material, paged) = self.open_material(path, terminal)?;
        let material_name = path.display().to_string();
        let view =
            Studio { object: &object, material: material.as_ref(), material_name: &material_name, texture, lighting };
        let start = Instant::now();
        let rendered = render_in_steps(&studio_scene(&view)?, &settings, &effort, terminal)?;
        Ok(Made { settings, rendered, seconds: start.elapsed().as_secs_f64(), paged: paged.into_iter().collect() })
    }

    fn sheet(&self, original: &Path, others: &[PathBuf], terminal: &Terminal) -> anyhow::Result<()> {
        let worn = |path: &Path| -> loden::Result<Worn> {
            let measured = import::open_named(path, &self.assumptions.options())?.1;
            terminal.warn(&measured.warnings());
            let bytes = match &measured {
                Measured::Btf(source) => source.source_bytes(),
                Measured::Compressed(btf) => btf.bytes(),
                Measured::Brdf(_) => std::fs::metadata(path).map_err(Error::io(path))?.len(),
            };
            Ok(Worn { path: path.into(), material: measured.material(self.interpolation.into())?, bytes })
        };
        let texture = self.texture();
        let look = Look {
            object: self.object.clone().unwrap_or_else(|| "sphere".into()),
            settings: self.settings(Settings { width: 320, height: 320, ..Settings::default() }),
            texture,
            lighting: self.lighting()?,
        };
        let others = others.iter().map(|path| worn(path)).collect::<loden::Result<Vec<_>>>()?;
        sheet::sheet(&look, &worn(original)?, &others, &self.output, terminal)
    }

    /// What of the memory is for images.
    fn for_images(&self) -> Option<Memory> {
        self.memory.map(|Memory(bytes)| Memory(bytes - (bytes / 2).min(REST)))
    }

    fn texture(&self) -> TextureMap {
        let default = TextureMap::default();
        let samples = self.texture_samples.unwrap_or(default.samples);
        TextureMap { scale: self.uv_scale, rotation_degrees: self.uv_rotation, samples, ..default }
    }

    fn lighting(&self) -> loden::Result<Lighting> {
        Ok(match (&self.light, &self.env) {
            (Some(light), _) => Lighting::Key { theta_degrees: light.theta, phi_degrees: light.phi },
            (_, Some(file)) => {
                Lighting::Environment(Box::new(EnvironmentMap::new(Picture::read(file)?, self.env_rotation)?))
            }
            _ => Lighting::default(),
        })
    }

    fn settings(&self, default: Settings) -> Settings {
        let Size { width, height } = self.size.unwrap_or(Size { width: default.width, height: default.height });
        let (spp, depth) = (self.spp.unwrap_or(default.spp), self.depth.unwrap_or(default.depth));
        Settings { width, height, spp, depth, seed: self.seed }
    }

    /// A wrong ending is better told before the picture is computed.
    fn check_output(&self) -> loden::Result<()> {
        let ending = Path::new(&self.output).extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
        match ending.as_str() {
            "png" | "exr" => Ok(()),
            "html" if !self.sheet.is_empty() => Ok(()),
            _ => Err(Error::parameter("output", format!("{} does not end in .png or .exr", self.output.display()))),
        }
    }

    fn open_material(&self, path: &Path, terminal: &Terminal) -> loden::Result<import::Fitted> {
        let measured = import::open_named(path, &self.assumptions.options())?.1;
        terminal.warn(&measured.warnings());
        let folder = self.output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let place = self.for_images().map(|memory| (memory, folder));
        measured.material_within(self.interpolation.into(), place, terminal)
    }
}
