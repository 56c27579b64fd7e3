//! Pictures of objects wearing a material.
//!
//! World coordinates: x to the right, y up, z towards the default camera. A [`Scene`] holds bodies (a [`Shape`]
//! wearing a material), lights, an environment and a camera; [`render`] traces it. [`studio()`] builds the scene
//! in which a material is judged: an object of [`object::OBJECTS`] or of a file on a seamless floor.

pub mod bvh;
mod camera;
mod environment;
mod filter;
pub mod geometry;
mod instance;
mod integrator;
mod light;
mod mesh;
pub mod object;
mod progressive;
mod sampler;
mod scene;
pub mod scene_file;
mod shape;
mod studio;
mod surface;
mod texture;
mod tracer;

pub use camera::{Camera, Lens, Projection};
pub use environment::{Environment, EnvironmentMap};
pub use filter::MAX_TEXTURE_SAMPLES;
pub use instance::Instance;
pub use light::{AreaLight, DirectionalLight, Emitter, Flat, Light, PointLight, SpotLight, from_up};
pub use mesh::{Mesh, MeshData};
pub use progressive::{Checkpoint, Effort, Rendered, render_in_steps};
pub use sampler::Sampler;
pub use scene::{Body, Scene};
pub use shape::{Ball, Disc, Shape, Sphere};
pub use studio::{Lighting, Studio, studio, studio_scene};
pub use texture::{Mapping, TextureMap, Wrap};

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::picture::{MAX_PIXELS, MAX_SIDE, Picture};
use crate::progress::Progress;
use crate::{Error, Result};

/// A half line.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
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

/// Traces a scene. Each pixel depends on nothing but its own samples, and the result on nothing but scene and settings.
///
/// # Errors
/// [`Error::Parameter`] for impossible settings or camera, or naming a material whose value is not finite;
/// what [`crate::material::Material::prepare`] gives; [`Error::Cancelled`].
pub fn render(scene: &Scene, settings: &Settings, progress: &dyn Progress) -> Result<Picture> {
    Ok(render_in_steps(scene, settings, &Effort::default(), progress)?.picture)
}
