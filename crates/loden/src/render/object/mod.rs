//! Objects that wear the material: built in, or from a file.

mod cloth;
mod gltf;
mod obj;
mod sphere;
mod teapot;

use std::path::Path;

use super::{Ball, Camera, Shape};
use crate::{Error, Result};

/// A shape with the camera from which it looks good.
#[derive(Debug, Clone)]
pub struct Object {
    /// The shape, y up. Built-in objects have texture coordinates that keep a square texture square and
    /// repeat about once over the object's height.
    pub shape: Shape,
    /// Height of the floor it stands on.
    pub floor: f32,
    /// From where it is seen.
    pub camera: Camera,
    /// What was assumed on reading it, a sentence each, for the user to see.
    pub warnings: Vec<String>,
}

/// A built-in object.
pub struct BuiltIn {
    /// The user's word.
    pub name: &'static str,
    /// One sentence.
    pub doc: &'static str,
    /// Makes it.
    pub build: fn() -> Result<Object>,
}

/// All built-in objects.
pub const OBJECTS: &[&BuiltIn] = &[&sphere::SPHERE, &teapot::TEAPOT, &cloth::CLOTH];

/// File name extensions that can be read.
pub const EXTENSIONS: &[&str] = &["obj", "gltf", "glb"];

/// The built-in object of this name, or the object in the file of this name.
///
/// # Errors
/// [`Error::Parameter`] if it is neither, or what reading the file gives.
pub fn load(name_or_path: &str) -> Result<Object> {
    if let Some(object) = OBJECTS.iter().find(|o| o.name == name_or_path) {
        return (object.build)();
    }
    let path = Path::new(name_or_path);
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("obj") => obj::read(path),
        Some("gltf" | "glb") => gltf::read(path),
        _ if path.exists() => {
            Err(Error::unsupported(path, format!("an object's file name must end in {}", EXTENSIONS.join(", "))))
        }
        _ => {
            let names: Vec<_> = OBJECTS.iter().map(|o| o.name).collect();
            let problem = format!(
                "found {name_or_path:?}, expected {} or a file ending in {}",
                names.join(", "),
                EXTENSIONS.join(", ")
            );
            Err(Error::parameter("object", problem))
        }
    }
}

impl Object {
    /// An object on a floor under its lowest point, seen slightly from above.
    fn standing(shape: Shape, floor: f32, warnings: Vec<String>) -> Self {
        let Ball { centre, radius } = shape.bounds();
        Self { shape, floor, camera: Camera::around(centre, radius, 20.0, 0.0, 1.0), warnings }
    }
}

/// Completes what a file gave: scales it to radius 1 around the origin, where rays are most exact.
fn from_file(path: &Path, mut data: super::MeshData, mut warnings: Vec<String>) -> Result<Object> {
    let Ball { centre, radius } = Ball::around(&data.positions);
    if radius > 0.0 && radius.is_finite() {
        data.positions.iter_mut().for_each(|p| *p = (*p - centre) / radius);
    }
    if data.uvs.is_empty() {
        warnings.push(format!("{}: no texture coordinates; projected along the main axes", path.display()));
    }
    if data.normals.is_empty() {
        warnings.push(format!("{}: no normals; averaged over neighbouring triangles", path.display()));
    }
    let floor = data.positions.iter().map(|p| p.y).fold(f32::INFINITY, f32::min);
    let mesh = super::Mesh::new(data).map_err(|e| Error::invalid(path, "mesh", e.to_string()))?;
    Ok(Object::standing(Shape::Mesh(mesh.into()), floor, warnings))
}

#[cfg(test)]
mod tests;
