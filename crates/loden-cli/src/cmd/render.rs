//! `loden render`: an object wearing a material, or a scene.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use loden::Error;
use loden::import;
use loden::material::Material;
use loden::picture::Picture;
use loden::progress::Progress;
use loden::render::scene_file::SceneFile;
use loden::render::{EnvironmentMap, Lighting, Settings, Studio, TextureMap, object, render, studio};
use serde_json::json;

use super::decompress::SchemeFlag;
use crate::flags::{Angles, Assumptions, Size};
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Render {
    #[arg(long, help = object_help(), required_unless_present = "scene")]
    object: Option<String>,
    /// What it wears: a .loden file, or anything else `loden info` knows.
    #[arg(long, value_name = "FILE", required_unless_present = "scene")]
    material: Option<PathBuf>,
    /// A scene instead of an object: .toml, .rib or .rib.gz (docs/scenes.md).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["object", "material", "light", "env", "uv_scale", "uv_rotation"])]
    scene: Option<PathBuf>,
    /// The picture to write, .png or .exr.
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
    /// Repeats of the material per repeat of the object's texture coordinates.
    #[arg(long, default_value_t = 4.0)]
    uv_scale: f32,
    /// Turns the material on the object, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    uv_rotation: f32,
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

impl Render {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        self.check_output()?;
        let (settings, picture, seconds) = match (&self.scene, &self.object, &self.material) {
            (Some(file), ..) => self.scene(file, terminal)?,
            (None, Some(object), Some(material)) => self.object(object, material, terminal)?,
            _ => unreachable!("clap asks for a scene, or an object and a material"),
        };
        picture.write(&self.output)?;
        let Settings { width, height, spp, .. } = settings;
        let rate = (width * height) as f64 * f64::from(spp) / seconds;
        let value = json!({ "output": self.output, "width": width, "height": height, "spp": spp, "seconds": seconds, "samples_per_s": rate });
        terminal.result(&value, || {
            format!("{}: {seconds:.1} s, {:.2} million samples a second", self.output.display(), rate / 1e6)
        })
    }

    /// The settings, the picture, and the seconds that tracing took.
    fn scene(&self, file: &Path, terminal: &Terminal) -> anyhow::Result<(Settings, Picture, f64)> {
        let scene = SceneFile::open(file)?;
        terminal.warn(&scene.warnings);
        let settings = self.settings(scene.settings);
        let start = Instant::now();
        let picture = render(&scene.scene(), &settings, terminal)?;
        Ok((settings, picture, start.elapsed().as_secs_f64()))
    }

    fn object(&self, object: &str, material: &Path, terminal: &Terminal) -> anyhow::Result<(Settings, Picture, f64)> {
        let lighting = match (&self.light, &self.env) {
            (Some(light), _) => Lighting::Key { theta_degrees: light.theta, phi_degrees: light.phi },
            (_, Some(file)) => {
                Lighting::Environment(Box::new(EnvironmentMap::new(Picture::read(file)?, self.env_rotation)?))
            }
            _ => Lighting::default(),
        };
        let settings = self.settings(Settings::default());
        let texture = TextureMap { scale: self.uv_scale, rotation_degrees: self.uv_rotation };
        let look = Look { object: object.into(), settings, texture, lighting };
        let name = material.display().to_string();
        let material = self.open_material(material, terminal)?;
        let start = Instant::now();
        let picture = draw(&look, material.as_ref(), &name, terminal)?;
        Ok((settings, picture, start.elapsed().as_secs_f64()))
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
            _ => Err(Error::parameter("output", format!("{} does not end in .png or .exr", self.output.display()))),
        }
    }

    fn open_material(&self, path: &Path, terminal: &Terminal) -> loden::Result<Arc<dyn Material>> {
        let measured = import::open_named(path, &self.assumptions.options())?.1;
        terminal.warn(&measured.warnings());
        measured.material(self.interpolation.into())
    }
}
