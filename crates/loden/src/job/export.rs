//! Exporting a compressed material to another renderer.

use std::path::Path;

use serde::Serialize;

use glam::Vec3;

use super::open::label;
use crate::direction::Scheme;
use crate::material::Material;
use crate::output::OutputDir;
use crate::picture::Picture;
use crate::progress::Progress;
use crate::render::{Body, Camera, DirectionalLight, Environment, Scene, Settings, Shape, Sphere, TextureMap, render};
use crate::renderers::Renderer;
use crate::renderers::scene::{self, SIDE};
use crate::{Error, Result, codec};

/// A folder that was written for another renderer.
#[derive(Debug, Serialize)]
pub struct RendererExport {
    /// Name of the renderer.
    pub renderer: &'static str,
    /// Number of files.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
}

/// Writes the compressed material `input` as a folder for `renderer`; the folder must be empty or not exist.
///
/// # Errors
/// Errors of opening the file; [`Error::Unsupported`] if the renderer cannot show such a material; [`Error::Exists`];
/// [`Error::Io`]; [`Error::Cancelled`]. Nothing is left behind.
pub fn export_to(
    input: &Path,
    renderer: &dyn Renderer,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<RendererExport> {
    let material = codec::open(input)?;
    renderer.check(input, &material)?;
    let output = OutputDir::create(folder)?;
    renderer.write(&label(input), &material, output.folder(), progress)?;
    let picture = test_picture(&*material.material(Scheme::Triangles)?, &label(input), progress)?;
    picture.write(output.folder().join(scene::PICTURE))?;
    let written = std::fs::read_dir(output.folder()).map_err(Error::io(folder))?;
    let sizes = written.map(|entry| Ok(entry?.metadata()?.len())).collect::<std::io::Result<Vec<u64>>>();
    let sizes = sizes.map_err(Error::io(folder))?;
    output.commit()?;
    Ok(RendererExport { renderer: renderer.name(), files: sizes.len(), bytes: sizes.iter().sum() })
}

/// Samples per pixel of the picture of the test scene.
const SAMPLES: u32 = 16;

/// Our picture of the test scene, which the exported one should equal.
fn test_picture(material: &dyn Material, name: &str, progress: &dyn Progress) -> Result<Picture> {
    let ball = Body {
        shape: Shape::Sphere(Sphere { centre: Vec3::ZERO, radius: 1.0, axis: Vec3::Z }),
        material,
        material_name: name.into(),
        texture: TextureMap { scale: scene::REPEATS, ..TextureMap::default() },
    };
    let light = DirectionalLight {
        direction: scene::TO_LIGHT.normalize(),
        irradiance: Vec3::splat(scene::IRRADIANCE),
        radius_degrees: 0.0,
    };
    let camera = Camera { up: Vec3::Z, ..Camera::pinhole(scene::EYE, Vec3::ZERO, scene::FIELD_OF_VIEW) };
    let scene = Scene {
        bodies: vec![ball],
        lights: vec![light.into()],
        environment: Environment::Dark,
        background: None,
        camera,
    };
    let settings = Settings { width: SIDE, height: SIDE, spp: SAMPLES, depth: 2, ..Settings::default() };
    render(&scene, &settings, progress)
}
