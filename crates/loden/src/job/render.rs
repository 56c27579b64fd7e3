//! Pictures of objects and scenes, from the names of their files.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::open;
use super::synthesize::endless;
use crate::import::BoundedMaterial;
use crate::material::{Interpolation, Material, PagedBtf};
use crate::memory::Memory;
use crate::params::Given;
use crate::picture::Picture;
use crate::progress::Progress;
use crate::render::object::Object;
use crate::render::scene_file::{Reading, SceneFile, Shadows};
use crate::render::{
    Checkpoint, Effort, EnvironmentMap, Guides, LEAST_SAMPLES, Lighting, Rendered, Scene, Settings, Studio, TextureMap,
    denoise, object, render_in_steps, studio_scene,
};
use crate::{Error, Result};

/// Part of the memory that is kept for all but images, at most.
const RESERVED: u64 = 64 << 20;

/// Between two writings of a checkpoint.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(20);

/// How to look at a material on an object.
#[derive(Debug, Clone)]
pub struct Look {
    /// A built-in object or a file.
    pub object: String,
    /// Size and quality.
    pub settings: Settings,
    /// How the material lies on the object.
    pub texture: TextureMap,
    /// Where the light comes from.
    pub lighting: Lighting,
    /// Whether noise is removed.
    pub denoise: bool,
}

impl Look {
    /// The default look at an object.
    pub fn new(object: &str, width: usize, height: usize, spp: u32) -> Self {
        Self {
            object: object.into(),
            settings: Settings { width, height, spp, ..Settings::default() },
            texture: TextureMap { scale: 4.0, ..TextureMap::default() },
            lighting: Lighting::default(),
            denoise: false,
        }
    }
}

/// Renders an object wearing a material; `name` is what errors call the material.
///
/// # Errors
/// As [`object::load`] and [`render_in_steps`].
pub fn draw(look: &Look, material: &dyn Material, name: &str, progress: &dyn Progress) -> Result<Picture> {
    look.draw(&look.object(progress)?, material, name, progress)
}

impl Look {
    /// Its object; warnings go to `progress`.
    pub(super) fn object(&self, progress: &dyn Progress) -> Result<Object> {
        let object = object::load(&self.object)?;
        object.warnings.iter().for_each(|warning| progress.warn(warning));
        Ok(object)
    }

    /// Renders its object, which is loaded.
    pub(super) fn draw(
        &self,
        object: &Object,
        material: &dyn Material,
        name: &str,
        progress: &dyn Progress,
    ) -> Result<Picture> {
        let (texture, lighting) = (self.texture, self.lighting.clone());
        let studio = Studio { object, material, material_name: name, texture, lighting };
        let scene = studio_scene(&studio)?;
        let rendered = render_in_steps(&scene, &self.settings, &Effort::default(), progress)?;
        Ok(if self.denoise { denoised(&scene, &self.settings, rendered, progress)? } else { rendered }.picture)
    }
}

/// A picture without noise, unless it has too few samples to know the noise.
fn denoised(scene: &Scene, settings: &Settings, mut rendered: Rendered, progress: &dyn Progress) -> Result<Rendered> {
    if rendered.samples_per_pixel >= LEAST_SAMPLES {
        let guides = Guides::of(scene, settings, progress)?;
        rendered.picture = denoise(&rendered.picture, &rendered.variance, &guides, progress)?;
    }
    Ok(rendered)
}

/// A picture to be made.
#[derive(Debug, Clone)]
pub struct Render {
    /// What is looked at.
    pub subject: Subject,
    /// Width and height in pixels; of a scene as its file says if unsaid.
    pub size: Option<[usize; 2]>,
    /// Samples per pixel, likewise.
    pub spp: Option<u32>,
    /// The most segments of a path, likewise.
    pub depth: Option<u32>,
    /// Another seed gives the same picture with other noise.
    pub seed: u64,
    /// Whether noise is removed, see [`denoise`]; a picture of less than [`LEAST_SAMPLES`] samples per pixel stays as it is.
    pub denoise: bool,
    /// When to stop.
    pub limits: Limits,
    /// Memory for the images of an uncompressed BTF; the rest of them goes to temporary files.
    pub memory: Option<Memory>,
    /// The folder for such a file; of a scene it is the system's.
    pub scratch: PathBuf,
}

/// What is looked at.
#[derive(Debug, Clone)]
pub enum Subject {
    /// An object in the studio.
    Object(Dressed),
    /// A scene.
    Scene {
        /// Its file.
        file: PathBuf,
        /// Replaces [`TextureMap::samples`] of all bodies.
        texture_samples: Option<u32>,
        /// [`Reading::world`].
        world: Option<usize>,
        /// [`Reading::shadows`].
        shadows: Option<Shadows>,
    },
}

/// An object wearing a material.
#[derive(Debug, Clone)]
pub struct Dressed {
    /// A built-in object or a file.
    pub object: String,
    /// A material, named as for [`open()`].
    pub material: PathBuf,
    /// What its files leave unstated.
    pub import: Given,
    /// How to interpolate between measured directions and texels.
    pub interpolation: Interpolation,
    /// Whether a BTF goes on without end, see [`Endless`](crate::synth::Endless), instead of being repeated.
    pub endless: bool,
    /// How the material lies on the object.
    pub texture: TextureMap,
    /// Where the light comes from.
    pub light: Light,
}

/// The light of a studio.
#[derive(Debug, Clone, Default)]
pub enum Light {
    /// That of [`Lighting::default`].
    #[default]
    Standard,
    /// A key light: angle from the vertical and azimuth, degrees.
    Key([f32; 2]),
    /// A picture of the surroundings.
    Environment {
        /// A latitude-longitude picture.
        file: PathBuf,
        /// Turns it about the vertical, degrees.
        rotation_degrees: f32,
    },
}

impl Light {
    /// With its picture read; warnings go to `progress`.
    ///
    /// # Errors
    /// What reading the picture gives.
    pub fn lighting(&self, progress: &dyn Progress) -> Result<Lighting> {
        Ok(match self {
            Self::Standard => Lighting::default(),
            Self::Key([theta_degrees, phi_degrees]) => {
                Lighting::Key { theta_degrees: *theta_degrees, phi_degrees: *phi_degrees }
            }
            Self::Environment { file, rotation_degrees } => {
                let mut warnings = Vec::new();
                let map = EnvironmentMap::read(file, *rotation_degrees, &mut warnings)?;
                warnings.iter().for_each(|warning| progress.warn(warning));
                Lighting::Environment(Box::new(map))
            }
        })
    }
}

/// When to stop before all samples are taken.
#[derive(Debug, Clone, Default)]
pub struct Limits {
    /// After this time.
    pub time: Option<Duration>,
    /// When the relative error of a tile is below this.
    pub relative_error: Option<f32>,
    /// The file that keeps the samples; if it exists, rendering goes on from it.
    pub checkpoint: Option<PathBuf>,
}

/// A picture and how it was made.
#[derive(Debug)]
pub struct Rendering {
    /// Size and quality.
    pub settings: Settings,
    /// The picture.
    pub rendered: Rendered,
    /// Seconds of tracing.
    pub seconds: f64,
    /// Materials that are not in memory as a whole.
    pub paged: Vec<Paging>,
}

/// A material that is not in memory as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Paging {
    /// Bytes in memory.
    pub resident_bytes: u64,
    /// Bytes in the file.
    pub file_bytes: u64,
    /// Pages asked for.
    pub pages_asked: u64,
    /// Pages read from the file.
    pub pages_read: u64,
}

impl Paging {
    fn of(btf: &Arc<PagedBtf>) -> Self {
        let (pages_asked, pages_read) = btf.requests();
        Self { resident_bytes: btf.resident_bytes(), file_bytes: btf.file_bytes(), pages_asked, pages_read }
    }
}

/// Makes a picture; it is not written to a file.
///
/// # Errors
/// What opening the files gives; as [`render_in_steps`].
pub fn render(job: &Render, progress: &dyn Progress) -> Result<Rendering> {
    match &job.subject {
        Subject::Scene { file, texture_samples, world, shadows } => {
            let reading = Reading { memory: job.for_images(), world: *world, shadows: *shadows };
            job.scene(file, &reading, *texture_samples, progress)
        }
        Subject::Object(dressed) => job.object(dressed, progress),
    }
}

impl Render {
    fn scene(
        &self,
        file: &Path,
        reading: &Reading,
        texture_samples: Option<u32>,
        progress: &dyn Progress,
    ) -> Result<Rendering> {
        let mut scene = SceneFile::open_as(file, reading)?;
        if let Some(samples) = texture_samples {
            scene.bodies.iter_mut().for_each(|body| body.texture.samples = samples);
        }
        scene.warnings.iter().for_each(|warning| progress.warn(warning));
        let settings = self.settings(scene.settings);
        let effort = self.effort(&[file])?;
        let start = Instant::now();
        let traced = scene.scene();
        let rendered = render_in_steps(&traced, &settings, &effort, progress)?;
        let seconds = start.elapsed().as_secs_f64();
        if let Some(why) = scene.why_black(&rendered.picture) {
            progress.warn(&format!("{}: {why}", file.display()));
        }
        let rendered = if self.denoise { denoised(&traced, &settings, rendered, progress)? } else { rendered };
        Ok(Rendering { settings, rendered, seconds, paged: scene.paged.iter().map(Paging::of).collect() })
    }

    fn object(&self, dressed: &Dressed, progress: &dyn Progress) -> Result<Rendering> {
        let settings = self.settings(Settings::default());
        let mut files = vec![dressed.material.as_path()];
        if let Light::Environment { file, .. } = &dressed.light {
            files.push(file);
        }
        let effort = self.effort(&files)?;
        let lighting = dressed.light.lighting(progress)?;
        let object = object::load(&dressed.object)?;
        object.warnings.iter().for_each(|warning| progress.warn(warning));
        let BoundedMaterial { material, paged } = self.open_material(dressed, progress)?;
        let material_name = dressed.material.display().to_string();
        let view = Studio {
            object: &object,
            material: material.as_ref(),
            material_name: &material_name,
            texture: dressed.texture,
            lighting,
        };
        let start = Instant::now();
        let scene = studio_scene(&view)?;
        let rendered = render_in_steps(&scene, &settings, &effort, progress)?;
        let seconds = start.elapsed().as_secs_f64();
        let rendered = if self.denoise { denoised(&scene, &settings, rendered, progress)? } else { rendered };
        Ok(Rendering { settings, rendered, seconds, paged: paged.iter().map(Paging::of).collect() })
    }

    fn open_material(&self, dressed: &Dressed, progress: &dyn Progress) -> Result<BoundedMaterial> {
        let measured = open(&dressed.material, &dressed.import, progress)?.measured;
        if dressed.endless {
            let material = endless(measured, &dressed.material, dressed.interpolation, progress)?;
            return Ok(BoundedMaterial { material, paged: None });
        }
        let place = self.for_images().map(|memory| (memory, self.scratch.as_path()));
        measured.material_within(dressed.interpolation, place, progress)
    }

    /// The part of the memory that is for images.
    fn for_images(&self) -> Option<Memory> {
        self.memory.map(|Memory(bytes)| Memory(bytes - (bytes / 2).min(RESERVED)))
    }

    fn settings(&self, default: Settings) -> Settings {
        let [width, height] = self.size.unwrap_or([default.width, default.height]);
        let (spp, depth) = (self.spp.unwrap_or(default.spp), self.depth.unwrap_or(default.depth));
        Settings { width, height, spp, depth, seed: self.seed }
    }

    /// When to stop. A checkpoint knows its picture by the subject and by size and time of its files.
    fn effort(&self, files: &[&Path]) -> Result<Effort> {
        let mut scene = format!("{:?}", self.subject);
        for file in files {
            // a model is no file
            if let Ok(found) = std::fs::metadata(file) {
                scene += &format!(" {} {} {:?}", file.display(), found.len(), found.modified().ok());
            }
        }
        if let Some(error) = self.limits.relative_error.filter(|error| !error.is_finite()) {
            return Err(Error::parameter("target-error", format!("found {error}, expected a fraction")));
        }
        let checkpoint = |path: &PathBuf| Checkpoint { path: path.clone(), scene, every: CHECKPOINT_EVERY };
        Ok(Effort {
            time_limit: self.limits.time,
            relative_error: self.limits.relative_error,
            checkpoint: self.limits.checkpoint.as_ref().map(checkpoint),
        })
    }
}
