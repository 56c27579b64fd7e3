//! Scene files in TOML or RIB.

mod black;
mod rib;
mod rib_text;
mod toml;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Mat4, Vec3};

use super::traced::Traced;
use super::{Body, Camera, Environment, Form, Instance, Light, Mesh, Scene, Settings, Shape, TextureMap};
use crate::import;
use crate::material::{Interpolation, Material, PagedBtf};
use crate::memory::Memory;
use crate::progress::Silent;
use crate::{Error, Result};

/// File name extensions of scene files.
pub const EXTENSIONS: &[&str] = &["toml", "rib", "rib.gz"];

/// Maximum number of shapes in a scene.
const MAX_BODIES: usize = 1 << 20;

/// Largest coordinate of a shape, in units of its size, without a warning. Rays then start off a surface by less than 1
/// % of the shape's size.
const FARTHEST: f32 = 2500.0;

/// A scene read from a file, with its materials.
pub struct SceneFile {
    /// All materials of the scene.
    pub materials: Vec<SceneMaterial>,
    /// All visible shapes.
    pub bodies: Vec<SceneBody>,
    /// All lights except the environment.
    pub lights: Vec<Light>,
    /// Light from all directions.
    pub environment: Environment,
    /// What the camera sees where a ray hits nothing; the environment if `None`.
    pub background: Option<Vec3>,
    /// The camera.
    pub camera: Camera,
    /// Image size and quality; settings that the file omits have their defaults.
    pub settings: Settings,
    /// Warnings for the user, one sentence each, with the line: requests that were ignored, defaults that were assumed.
    pub warnings: Vec<String>,
    /// Measured materials that are paged in from a temporary file.
    pub paged: Vec<Arc<PagedBtf>>,
    /// Memory limit of measured materials whose table has none.
    memory: Option<Memory>,
    /// Body of each instance by its extent, bit by bit, and how many were left out because they lie exactly on it.
    places: HashMap<[[u32; 3]; 2], usize>,
    coincident: usize,
}

/// A material with its name.
pub struct SceneMaterial {
    /// Name in the scene or file name, for error messages.
    pub name: String,
    /// The material.
    pub material: Arc<dyn Material>,
    /// What opens it again: the name of a file, or a model with its parameters. `None` for surfaces of RIB that are more than that: they
    /// emit light, let it through or are painted.
    pub source: Option<String>,
}

/// A shape of the scene.
pub struct SceneBody {
    /// The shape in world coordinates.
    pub shape: Shape,
    /// Index into [`SceneFile::materials`].
    pub material: usize,
    /// How the material is mapped onto the shape.
    pub texture: TextureMap,
}

/// How to read a scene file.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Reading {
    /// Memory limit for the images of each BTF; the rest goes to temporary files.
    pub memory: Option<Memory>,
    /// The world of a RIB file to draw, counted from 1; by default the last one that is a picture.
    pub world: Option<usize>,
    /// Which lights of a RIB file cast shadows; by default those for which the file asks for shadows.
    pub shadows: Option<Shadows>,
}

/// Which lights of a RIB file cast shadows. Area lights and environments always do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shadows {
    /// All of them.
    All,
    /// Those for which the file asks for shadows, as in RenderMan.
    Asked,
}

impl SceneFile {
    /// Reads a scene and all files it names. The extension of the file name selects the format.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the line; [`Error::Unsupported`] for another extension; any error of the files that
    /// the scene names.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_as(path, &Reading::default())
    }

    /// Like [`SceneFile::open`], with options.
    ///
    /// # Errors
    /// See [`SceneFile::open`] and [`PagedBtf::new`]; [`Error::Parameter`] for a world that the file does not have, and
    /// for a world or shadows of a TOML file.
    pub fn open_as(path: impl AsRef<Path>, reading: &Reading) -> Result<Self> {
        let path = path.as_ref();
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let mut file = if name.ends_with(".toml") {
            let given = [("world", reading.world.is_some()), ("shadows", reading.shadows.is_some())];
            if let Some((name, _)) = given.iter().find(|(_, given)| *given) {
                return Err(Error::parameter(*name, "only RIB scenes have this option"));
            }
            toml::read(path, reading.memory)?
        } else if name.ends_with(".rib") || name.ends_with(".rib.gz") {
            rib::read(path, reading)?
        } else {
            return Err(Error::unsupported(path, format!("expected a scene file ending in {}", EXTENSIONS.join(", "))));
        };
        file.warn_of_places();
        Ok(file)
    }

    /// The scene as [`super::render`] takes it.
    pub fn scene(&self) -> Scene<'_> {
        let body = |placed: &SceneBody| {
            let SceneMaterial { name, material, .. } = &self.materials[placed.material];
            Body {
                shape: placed.shape.clone(),
                material: material.as_ref(),
                material_name: name.clone(),
                texture: placed.texture,
            }
        };
        Scene {
            bodies: self.bodies.iter().map(body).collect(),
            lights: self.lights.clone(),
            environment: self.environment.clone(),
            background: self.background,
            camera: self.camera,
        }
    }

    fn empty(camera: Camera) -> Self {
        Self {
            materials: Vec::new(),
            bodies: Vec::new(),
            lights: Vec::new(),
            environment: Environment::Dark,
            background: None,
            camera,
            settings: Settings::default(),
            warnings: Vec::new(),
            paged: Vec::new(),
            memory: None,
            places: HashMap::new(),
            coincident: 0,
        }
    }

    /// Adds a shape.
    fn place(&mut self, form: Form, transform: Mat4, material: usize, texture: TextureMap) -> Result<()> {
        if self.bodies.len() >= MAX_BODIES {
            return Err(Error::parameter("shape", format!("found more than {MAX_BODIES} shapes")));
        }
        texture.check()?;
        let shape = match form {
            // Without a transform, rays need not be transformed either.
            Form::Mesh(mesh) if transform == Mat4::IDENTITY => Shape::Mesh(mesh),
            form => {
                let instance = Instance::new(form, transform)?;
                // Every ray would have to visit all shapes in one place.
                let extent = instance.extent().map(|p| p.to_array().map(f32::to_bits));
                let first = *self.places.entry(extent).or_insert(self.bodies.len());
                if let Some(Shape::Instance(other)) = self.bodies.get(first).map(|body| &body.shape)
                    && **other == instance
                {
                    self.coincident += 1;
                    return Ok(());
                }
                Shape::Instance(Box::new(instance))
            }
        };
        self.bodies.push(SceneBody { shape, material, texture });
        Ok(())
    }

    /// Warns of shapes that were left out and of places where single precision is not enough.
    fn warn_of_places(&mut self) {
        if self.coincident > 0 {
            self.warnings.push(format!("left out shapes that lie exactly on earlier ones: {}", self.coincident));
        }
        let is_far = |body: &&SceneBody| {
            let [low, high] = body.shape.extent();
            low.abs().max(high.abs()).max_element() > FARTHEST * (high - low).max_element()
        };
        let far = self.bodies.iter().filter(is_far).count();
        if far > 0 {
            self.warnings.push(format!(
                "shapes more than {FARTHEST} times their size from the origin: {far}; single precision is too coarse for their shadows"
            ));
        }
    }

    /// Opens a measured material, paged if there is a memory limit.
    fn open_material(
        &mut self,
        path: &Path,
        interpolation: Interpolation,
        memory: Option<Memory>,
    ) -> Result<Arc<dyn Material>> {
        let (_, measured) = import::open_material(path, &Default::default())?;
        self.warnings.extend(measured.warnings());
        let memory = memory.or(self.memory);
        let folder = std::env::temp_dir();
        let limit = memory.map(|memory| (memory, folder.as_path()));
        let import::BoundedMaterial { material, paged } = measured.material_within(interpolation, limit, &Silent)?;
        self.paged.extend(paged);
        Ok(material)
    }
}

/// Cache of meshes, keyed by a description of what they were made from, each with the place of its origin.
#[derive(Default)]
struct Meshes(HashMap<String, (Arc<Mesh>, DVec3)>);

impl Meshes {
    /// The mesh of this key and the place of its origin; made if it is not in the cache.
    fn get(&mut self, key: String, make: impl FnOnce() -> Result<(Mesh, DVec3)>) -> Result<(Arc<Mesh>, DVec3)> {
        if let Some(placed) = self.0.get(&key) {
            return Ok(placed.clone());
        }
        let (mesh, origin) = make()?;
        let placed = (Arc::new(mesh), origin);
        self.0.insert(key, placed.clone());
        Ok(placed)
    }
}

#[cfg(test)]
mod tests;
