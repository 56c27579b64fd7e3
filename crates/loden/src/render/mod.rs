//! Pictures of objects wearing a material.
//!
//! World coordinates: x to the right, y up, z towards the default camera. A [`Scene`] holds bodies (a [`Shape`]
//! wearing a material), lights, an environment and a camera; [`render`] traces it. [`studio()`] builds the scene
//! in which a material is judged: an object of [`object::OBJECTS`] or of a file on a seamless floor.

pub mod bvh;
mod camera;
mod environment;
pub mod geometry;
mod instance;
mod integrator;
mod light;
mod mesh;
pub mod object;
mod sampler;
mod scene;
pub mod scene_file;
mod shape;
mod studio;
mod tracer;

pub use camera::{Camera, Lens, Projection};
pub use environment::{Environment, EnvironmentMap};
pub use instance::Instance;
pub use light::{AreaLight, DirectionalLight, Emitter, Flat, Light, PointLight, SpotLight, from_up};
pub use mesh::{Mesh, MeshData};
pub use sampler::Sampler;
pub use scene::{Body, Scene, TextureMap};
pub use shape::{Ball, Disc, Shape, Sphere};
pub use studio::{Lighting, Studio, studio};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::picture::{MAX_PIXELS, MAX_SIDE, Picture};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// A half line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it begins.
    pub origin: Vec3,
    /// Unit vector.
    pub direction: Vec3,
}

/// Size and quality of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples per pixel; powers of two are best stratified.
    pub spp: u32,
    /// The most segments of a path, the camera ray included: 2 is direct light only.
    pub depth: u32,
    /// Another seed gives the same picture with other noise.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { width: 512, height: 512, spp: 64, depth: 6, seed: 0 }
    }
}

impl Settings {
    fn check(&self) -> Result<()> {
        let range = |name: &str, found: u64, max: u64| {
            if (1..=max).contains(&found) {
                return Ok(());
            }
            Err(Error::parameter(name, format!("found {found}, expected 1 to {max}")))
        };
        range("width", self.width as u64, MAX_SIDE as u64)?;
        range("height", self.height as u64, MAX_SIDE as u64)?;
        range("pixels", (self.width * self.height) as u64, MAX_PIXELS as u64)?;
        range("spp", self.spp.into(), 1 << 24)?;
        range("depth", self.depth.into(), 1024)
    }
}

/// Side of the squares of pixels that threads work on.
const TILE: usize = 16;

/// Traces a scene. Pixels are filtered by a tent one pixel wide to each side, by drawing from it; so each pixel
/// depends on nothing but its own samples, and the result on nothing but scene and settings.
///
/// # Errors
/// [`Error::Parameter`] for impossible settings or camera, or naming a material whose value is not finite;
/// what [`crate::material::Material::prepare`] gives; [`Error::Cancelled`].
pub fn render(scene: &Scene, settings: &Settings, progress: &dyn Progress) -> Result<Picture> {
    settings.check()?;
    let Settings { width, height, spp, depth, seed } = *settings;
    let rays = scene.camera.prepare(width, height)?;
    scene.bodies.iter().try_for_each(|body| body.material.prepare())?;
    let tracer = tracer::Tracer::new(scene);
    let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
    let task = Task::new(progress, "render", (columns * rows) as u64);
    let pixel = |x: usize, y: usize| {
        let mut sum = Vec3::ZERO;
        for index in 0..spp {
            let mut sampler = Sampler::new(seed, x as u32, y as u32, index);
            let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + tent(sampler.next_2d());
            let ray = rays.through(at, || sampler.next_2d());
            sum += integrator::radiance(&tracer, ray, depth, &mut sampler)?;
        }
        Ok::<_, Error>(sum / spp as f32)
    };
    let tiles: Vec<Vec<Vec3>> = (0..columns * rows)
        .into_par_iter()
        .map(|tile| {
            let (left, top) = (tile % columns * TILE, tile / columns * TILE);
            let mut rgb = Vec::with_capacity(TILE * TILE);
            for y in top..(top + TILE).min(height) {
                for x in left..(left + TILE).min(width) {
                    rgb.push(pixel(x, y)?);
                }
            }
            task.advance(1)?;
            Ok(rgb)
        })
        .collect::<Result<_>>()?;
    let mut picture = Picture::filled(width, height, Vec3::ZERO);
    for (tile, rgb) in tiles.iter().enumerate() {
        let (left, top) = (tile % columns * TILE, tile / columns * TILE);
        let across = TILE.min(width - left);
        for (row, line) in rgb.chunks_exact(across).enumerate() {
            picture.rgb[(top + row) * width + left..][..across].copy_from_slice(line);
        }
    }
    Ok(picture)
}

/// Two uniform numbers to the density (1 - |x|) (1 - |y|) on -1..1.
#[inline]
fn tent(random: Vec2) -> Vec2 {
    let one = |u: f32| if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * u).sqrt() };
    Vec2::new(one(random.x), one(random.y))
}
