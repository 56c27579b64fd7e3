//! Scenes from files: TOML or RIB.

mod rib;
mod toml;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::{Mat4, Vec3};

use super::{Body, Camera, Environment, Instance, Light, Mesh, MeshData, Scene, Settings, Shape, TextureMap};
use crate::direction::Scheme;
use crate::import;
use crate::material::{Material, PagedBtf};
use crate::memory::Memory;
use crate::progress::Silent;
use crate::{Error, Result};

/// Endings of the names of scene files.
pub const EXTENSIONS: &[&str] = &["toml", "rib", "rib.gz"];

/// The most shapes in one scene.
const MAX_BODIES: usize = 1 << 22;

/// A scene that owns its materials.
pub struct SceneFile {
    /// What shapes wear.
    pub materials: Vec<Named>,
    /// What can be seen.
    pub bodies: Vec<Placed>,
    /// What sheds light.
    pub lights: Vec<Light>,
    /// Light from all around.
    pub environment: Environment,
    /// What the camera sees where there is nothing, if not the environment.
    pub background: Option<Vec3>,
    /// From where it is seen.
    pub camera: Camera,
    /// Size and quality; what the file does not say has its default.
    pub settings: Settings,
    /// What was not understood or was assumed, a sentence each with its line, for the user to see.
    pub warnings: Vec<String>,
    /// Measured materials that are kept within an amount of memory.
    pub paged: Vec<Arc<PagedBtf>>,
    /// What a measured material is allowed whose table says nothing.
    memory: Option<Memory>,
}

/// A material and what errors call it.
pub struct Named {
    /// The name of the file or of the material in the scene.
    pub name: String,
    /// The material.
    pub material: Arc<dyn Material>,
}

/// A shape that wears a material of the list.
pub struct Placed {
    /// In world coordinates.
    pub shape: Shape,
    /// Which of [`SceneFile::materials`].
    pub material: usize,
    /// How it lies on the shape.
    pub texture: TextureMap,
}

impl SceneFile {
    /// Reads a scene with all it names; the kind is told by the ending of the file's name.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the line; [`Error::Unsupported`] for another ending; what reading the files it names
    /// gives.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_within(path, None)
    }

    /// As [`SceneFile::open`]; the images of each BTF may take so much memory, the rest is in temporary files.
    ///
    /// # Errors
    /// As [`SceneFile::open`], and [`PagedBtf::new`].
    pub fn open_within(path: impl AsRef<Path>, memory: Option<Memory>) -> Result<Self> {
        let path = path.as_ref();
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        if name.ends_with(".toml") {
            toml::read(path, memory)
        } else if name.ends_with(".rib") || name.ends_with(".rib.gz") {
            rib::read(path, memory)
        } else {
            Err(Error::unsupported(path, format!("a scene file's name must end in {}", EXTENSIONS.join(", "))))
        }
    }

    /// The scene, as [`super::render`] takes it.
    pub fn scene(&self) -> Scene<'_> {
        let body = |placed: &Placed| {
            let Named { name, material } = &self.materials[placed.material];
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
        }
    }

    /// Adds an instance of a mesh.
    fn place(&mut self, mesh: Arc<Mesh>, transform: Mat4, material: usize, texture: TextureMap) -> Result<()> {
        if self.bodies.len() >= MAX_BODIES {
            return Err(Error::parameter("shapes", format!("there are more than {MAX_BODIES}")));
        }
        texture.check()?;
        let instance = Instance::new(mesh.clone(), transform)?;
        // where it is not moved, rays need not be
        let shape = if transform == Mat4::IDENTITY { Shape::Mesh(mesh) } else { Shape::Instance(Box::new(instance)) };
        self.bodies.push(Placed { shape, material, texture });
        Ok(())
    }

    /// Opens a measured material.
    fn open_material(&mut self, path: &Path, scheme: Scheme, memory: Option<Memory>) -> Result<Arc<dyn Material>> {
        let (_, measured) = import::open_named(path, &import::Options::default())?;
        self.warnings.extend(measured.warnings());
        let memory = memory.or(self.memory);
        let folder = std::env::temp_dir();
        let place = memory.map(|memory| (memory, folder.as_path()));
        let (material, paged) = measured.material_within(scheme, place, &Silent)?;
        self.paged.extend(paged);
        Ok(material)
    }
}

/// Meshes that were made already, by what they were made from.
#[derive(Default)]
struct Meshes(HashMap<String, Arc<Mesh>>);

impl Meshes {
    fn get(&mut self, key: String, make: impl FnOnce() -> Result<MeshData>) -> Result<Arc<Mesh>> {
        if let Some(mesh) = self.0.get(&key) {
            return Ok(mesh.clone());
        }
        let mesh = Arc::new(Mesh::new(make()?)?);
        self.0.insert(key, mesh.clone());
        Ok(mesh)
    }
}

#[cfg(test)]
mod tests;
