//! `loden render`: an object wearing a material, or a scene.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use loden::Error;
use loden::job::{self, Dressed, Light, Limits, Look, Rendering, Subject, Worn};
use loden::memory::{self, Memory};
use loden::picture::ToneMap;
use loden::progress::Progress;
use loden::render::scene_file::Shadows;
use loden::render::{Settings, TextureMap, object};
use serde_json::{Value, json};

use super::sheet;
use crate::choice;
use crate::flags::{Angles, Assumptions, Between, Size};
use crate::outputs::{Outputs, Target};
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden render --object teapot --material wool.loden -o teapot.png
  loden render --object bowl.obj --material wool.zip --env sky.hdr --spp 256 -o bowl.exr
  loden render --scene scenes/light-bulb.rib -o bulb.png
  loden render --object cloth --material wool.loden --spp 4096 --checkpoint cloth.bin -o cloth.png
  loden render --sheet wool.zip wool-c4.loden wool-c9.loden -o sheet.html")]
pub struct Render {
    #[arg(long, help = object_help(), value_parser = choice::object(), hide_possible_values = true, required_unless_present_any = ["scene", "sheet"])]
    object: Option<String>,
    /// Material of the object: a .loden file or anything else that `loden info` recognises.
    #[arg(long, value_name = "FILE", required_unless_present_any = ["scene", "sheet"])]
    material: Option<PathBuf>,
    /// Render a measurement and compressed forms of it side by side, differences below.
    ///
    /// The object is a sphere unless --object names another. Differences to the first picture are amplified eight
    /// times. The output is a .png or .exr, or a .html page with the errors.
    #[arg(long, num_args = 2.., value_names = ["SOURCE", "FILES"], conflicts_with_all = ["scene", "material", "checkpoint", "time_limit", "target_error", "memory"])]
    sheet: Vec<PathBuf>,
    /// Scene file: .toml, .rib or .rib.gz (docs/scenes.md).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["object", "material", "light", "env", "uv_scale", "uv_rotation"])]
    scene: Option<PathBuf>,
    /// World of a RIB scene to draw, counted from 1 [default: the last that is a picture].
    #[arg(long, value_name = "N", conflicts_with_all = ["object", "sheet"])]
    world: Option<usize>,
    /// Lights of a RIB scene that cast shadows: all, or those that the file asks to [default: asked].
    #[arg(long, value_name = "WHICH", conflicts_with_all = ["object", "sheet"])]
    shadows: Option<ShadowsFlag>,
    /// Picture to write: .png or .exr; for --sheet also .html.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Direction of the key light: angle from the vertical and azimuth in degrees [default: 42,140].
    ///
    /// An azimuth of 0 is to the right, 90 towards the camera.
    #[arg(long, value_name = "THETA,PHI", conflicts_with = "env", allow_hyphen_values = true)]
    light: Option<Angles>,
    /// Environment light: a latitude-longitude picture, .exr or .hdr.
    #[arg(long, value_name = "FILE")]
    env: Option<PathBuf>,
    /// Rotation of the environment about the vertical, degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    env_rotation: f32,
    /// Size in pixels [default: of the scene, else 512x512].
    #[arg(long, value_name = "WIDTHxHEIGHT")]
    size: Option<Size>,
    /// Samples per pixel; powers of two are best [default: of the scene, else 64].
    #[arg(long, value_name = "N")]
    spp: Option<u32>,
    /// Maximum path length in segments; 2 is direct light only [default: of the scene, else 6].
    #[arg(long, value_name = "N")]
    depth: Option<u32>,
    /// Whether to remove noise, guided by the albedo and normals of the surfaces [default: true for .png, false for .exr].
    ///
    /// Needs at least four samples per pixel.
    #[arg(long, value_name = "BOOL", conflicts_with = "sheet")]
    denoise: Option<bool>,
    /// Factor on all pixels.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, conflicts_with = "sheet")]
    exposure: f32,
    /// Curve that fits values brighter than a display into a .png.
    #[arg(long, value_name = "CURVE", default_value = ToneMap::Linear.name(), value_parser = choice::tone_map(), conflicts_with = "sheet")]
    tone_map: String,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Stop after this time with the samples taken so far, at least one per pixel.
    #[arg(long, value_name = "SECONDS")]
    time_limit: Option<f64>,
    /// Stop sampling a tile of 16 x 16 pixels when its relative error is below this; --spp is then the maximum.
    #[arg(long, value_name = "FRACTION")]
    target_error: Option<f32>,
    /// Save the samples to this file every 20 seconds and at the end; continue from it if it exists.
    ///
    /// A finished picture is refined by running the command again with a larger --spp.
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Memory limit for an uncompressed BTF, such as 512M; the rest is paged from a temporary file.
    ///
    /// The file is created beside the output, or in the folder for temporary files if a scene is rendered. Up to 64M of
    /// the limit are reserved for the rest of the program.
    #[arg(long, value_name = "BYTES")]
    memory: Option<Memory>,
    /// Repeats of the material per unit of the object's texture coordinates.
    #[arg(long, value_name = "N", default_value_t = 4.0)]
    uv_scale: f32,
    /// Rotation of the material on the object, degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    uv_rotation: f32,
    /// Maximum number of texture points averaged per camera ray, 1 to 64, against aliasing [default: of the scene, else
    /// 1].
    #[arg(long, value_name = "N")]
    texture_samples: Option<u32>,
    #[command(flatten)]
    between: Between,
    /// Continue a BTF without end by blending random pieces of it, instead of repeating it.
    ///
    /// For materials without structure, such as felt or gravel. A warning says if structure is lost.
    #[arg(long, conflicts_with_all = ["scene", "sheet", "memory"])]
    endless: bool,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// Lights that cast shadows.
#[derive(Clone, Copy, clap::ValueEnum)]
enum ShadowsFlag {
    All,
    Asked,
}

impl From<ShadowsFlag> for Shadows {
    fn from(flag: ShadowsFlag) -> Self {
        match flag {
            ShadowsFlag::All => Self::All,
            ShadowsFlag::Asked => Self::Asked,
        }
    }
}

fn object_help() -> String {
    let names: Vec<_> = object::OBJECTS.iter().map(|object| object.name).collect();
    format!("Object: {}, or an .obj, .gltf, .glb or .ply file", names.join(", "))
}

impl Render {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let endings: &[&str] = if self.sheet.is_empty() { &["png", "exr"] } else { &["png", "exr", "html"] };
        let outputs = self.outputs(terminal);
        let target = outputs.file(&self.output, endings)?;
        self.checkpoint.iter().try_for_each(|path| outputs.continued(path))?;
        if let [original, others @ ..] = &self.sheet[..] {
            return self.sheet(original, others, target, terminal);
        }
        let is_png = target.is("png");
        let tone = ToneMap::ALL.iter().copied().find(|tone| tone.name() == self.tone_map).unwrap_or_default();
        if !is_png && tone != ToneMap::Linear {
            return Err(Error::parameter("tone-map", "an .exr holds linear light; name a .png").into());
        }
        if !(self.exposure.is_finite() && self.exposure >= 0.0) {
            let problem = format!("found {}, expected a factor that is not negative", self.exposure);
            return Err(Error::parameter("exposure", problem).into());
        }
        let done = job::render(&self.job(is_png)?, terminal)?;
        let picture = done.rendered.picture.clone().toned(self.exposure, tone);
        picture.write_noted(target.path(), terminal.command())?;
        target.finish()?;
        let peak = memory::peak();
        terminal.result(&self.value(&done, peak), || self.text(&done, peak))
    }

    fn outputs<'a>(&self, terminal: &'a Terminal) -> Outputs<'a> {
        let object = self.object.as_ref().map(PathBuf::from);
        let sources = [&self.material, &self.scene, &self.env, &self.checkpoint].into_iter().flatten();
        Outputs::new(terminal, sources.chain(&self.sheet).chain(&object))
    }

    fn value(&self, done: &Rendering, peak: u64) -> Value {
        let Settings { width, height, spp, .. } = done.settings;
        let mut value = json!({
            "output": self.output, "width": width, "height": height, "spp": spp, "seconds": done.seconds,
            "samples_per_s": rate(done), "samples_per_pixel": done.rendered.samples_per_pixel,
            "complete": done.rendered.complete, "peak_rss_bytes": peak,
        });
        if !done.paged.is_empty() {
            value["paged"] = json!(done.paged);
        }
        value
    }

    fn text(&self, done: &Rendering, peak: u64) -> String {
        let (file, rate) = (self.output.display(), rate(done) / 1e6);
        let mut text = format!("{file}: {:.1} s, {rate:.2} million samples a second", done.seconds);
        if !done.rendered.complete || self.target_error.is_some() {
            text += &format!(", {:.1} samples per pixel", done.rendered.samples_per_pixel);
        }
        for btf in &done.paged {
            let [resident, file] = [btf.resident_bytes, btf.file_bytes].map(report::bytes);
            let peak = report::bytes(peak);
            text += &format!("\nmaterial: {resident} of {file} in memory; peak of the program {peak}");
        }
        text
    }

    fn job(&self, is_png: bool) -> loden::Result<job::Render> {
        let subject = match (&self.scene, &self.object, &self.material) {
            (Some(file), ..) => Subject::Scene {
                file: file.clone(),
                texture_samples: self.texture_samples,
                world: self.world,
                shadows: self.shadows.map(Into::into),
            },
            (None, Some(object), Some(material)) => Subject::Object(Dressed {
                object: object.clone(),
                material: material.clone(),
                import: self.assumptions.given().clone(),
                interpolation: self.between.interpolation(),
                endless: self.endless,
                texture: self.texture(),
                light: self.studio_light(),
            }),
            _ => unreachable!("clap asks for a scene, or an object and a material"),
        };
        let limit = |seconds: f64| {
            let wrong = |_| Error::parameter("time-limit", format!("found {seconds}, expected seconds"));
            Duration::try_from_secs_f64(seconds).map_err(wrong)
        };
        let folder = self.output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Ok(job::Render {
            subject,
            size: self.size.map(|size| [size.width, size.height]),
            spp: self.spp,
            depth: self.depth,
            seed: self.seed,
            denoise: self.denoise.unwrap_or(is_png),
            limits: Limits {
                time: self.time_limit.map(limit).transpose()?,
                relative_error: self.target_error,
                checkpoint: self.checkpoint.clone(),
            },
            memory: self.memory,
            scratch: folder.into(),
        })
    }

    fn sheet(&self, original: &Path, others: &[PathBuf], target: Target, terminal: &Terminal) -> anyhow::Result<()> {
        let worn = |path: &Path| Worn::open(path, self.between.interpolation(), self.assumptions.given(), terminal);
        let Size { width, height } = self.size.unwrap_or(Size { width: 320, height: 320 });
        let default = Settings::default();
        let (spp, depth) = (self.spp.unwrap_or(default.spp), self.depth.unwrap_or(default.depth));
        let look = Look {
            object: self.object.clone().unwrap_or_else(|| "sphere".into()),
            settings: Settings { width, height, spp, depth, seed: self.seed },
            texture: self.texture(),
            lighting: self.studio_light().lighting(terminal)?,
            denoise: false,
        };
        let others = others.iter().map(|path| worn(path)).collect::<loden::Result<Vec<_>>>()?;
        sheet::sheet(&look, &worn(original)?, &others, target, terminal)
    }

    fn texture(&self) -> TextureMap {
        let default = TextureMap::default();
        let samples = self.texture_samples.unwrap_or(default.samples);
        TextureMap { scale: self.uv_scale, rotation_degrees: self.uv_rotation, samples, ..default }
    }

    fn studio_light(&self) -> Light {
        match (&self.light, &self.env) {
            (Some(light), _) => Light::Key([light.theta, light.phi]),
            (_, Some(file)) => Light::Environment { file: file.clone(), rotation_degrees: self.env_rotation },
            _ => Light::Standard,
        }
    }
}

/// Samples a second.
fn rate(done: &Rendering) -> f64 {
    done.rendered.samples as f64 / done.seconds
}
