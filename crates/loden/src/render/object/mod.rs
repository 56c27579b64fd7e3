//! Objects to render a material on: built in or read from a file.

mod cloth;
mod gltf;
mod obj;
mod ply;
mod polygons;
mod sphere;
mod teapot;

use std::path::Path;

use self::polygons::Polygons;
pub use self::polygons::{MeshFile, MeshPaint};
pub(super) use self::teapot::original as original_teapot;
use super::geometry::ControlMesh;
use super::{Ball, Camera, MeshData, Shape};
use crate::{Error, Result};

/// A shape and a camera that shows it well.
#[derive(Debug, Clone)]
pub struct Object {
    /// The shape, y up. Built-in objects have texture coordinates that keep a square texture square and repeat about
    /// once over the height of the object.
    pub shape: Shape,
    /// Height of the floor under it.
    pub floor: f32,
    /// A camera that shows all of it.
    pub camera: Camera,
    /// Rotation of textures that shows them upright to the camera, degrees.
    pub turn_degrees: f32,
    /// Warnings for the user about what was missing in the file, one sentence each.
    pub warnings: Vec<String>,
}

/// A built-in object.
pub struct BuiltIn {
    /// The name on the command line.
    pub name: &'static str,
    /// A one-sentence description.
    pub doc: &'static str,
    /// Builds the object.
    pub build: fn() -> Result<Object>,
}

/// All built-in objects.
pub const OBJECTS: &[&BuiltIn] = &[&sphere::SPHERE, &teapot::TEAPOT, &cloth::CLOTH];

/// File name extensions that can be read.
pub const EXTENSIONS: &[&str] = &["obj", "gltf", "glb", "ply"];

/// The built-in object of this name, or the object in the file at this path.
///
/// # Errors
/// [`Error::Parameter`] if it is neither; any error of reading the file.
pub fn load(name_or_path: &str) -> Result<Object> {
    if let Some(object) = OBJECTS.iter().find(|o| o.name == name_or_path) {
        return (object.build)();
    }
    let path = Path::new(name_or_path);
    if reader(path).is_none() && !path.exists() {
        let names: Vec<_> = OBJECTS.iter().map(|o| o.name).collect();
        let (names, endings) = (names.join(", "), EXTENSIONS.join(", "));
        let problem = format!("found {name_or_path:?}, expected {names}, or a file ending in {endings}");
        return Err(Error::parameter("object", problem));
    }
    from_file(path, read(path)?)
}

type Reader = fn(&Path) -> Result<Polygons>;

fn reader(path: &Path) -> Option<Reader> {
    match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
        "obj" => Some(obj::read),
        "gltf" | "glb" => Some(gltf::read),
        "ply" => Some(ply::read),
        _ => None,
    }
}

/// Reads the mesh of a file.
///
/// # Errors
/// Any error of reading the file; [`Error::Unsupported`] if its extension is not one of [`EXTENSIONS`].
pub fn read(path: &Path) -> Result<MeshFile> {
    let unsupported =
        || Error::unsupported(path, format!("expected an object file ending in {}", EXTENSIONS.join(", ")));
    reader(path).ok_or_else(unsupported)?(path)?.finish(path)
}

/// Reads the materials that [`MeshFile::painted`] refers to, the first of which stands for none; with warnings.
///
/// # Errors
/// Any error of reading the file and those that it names.
pub fn paints(path: &Path) -> Result<(Vec<MeshPaint>, Vec<String>)> {
    match path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("obj") => obj::paints(path),
        Some("gltf" | "glb") => gltf::paints(path),
        _ => Ok((vec![MeshPaint::default()], Vec::new())),
    }
}

/// Reads the polygons of an OBJ file as a control mesh for subdivision, with warnings of one sentence each.
///
/// # Errors
/// Any error of reading the file.
pub(super) fn control_mesh(path: &Path) -> Result<(ControlMesh, Vec<String>)> {
    let (control, warnings) = obj::control_mesh(path)?;
    Ok((control, warnings.into_iter().map(|warning| format!("{}: {warning}", path.display())).collect()))
}

/// The mesh of a built-in object; spheres have none.
///
/// # Errors
/// [`Error::Parameter`] if there is no such mesh.
pub(super) fn data(name: &str) -> Result<MeshData> {
    match name {
        "teapot" => Ok(teapot::data()),
        "cloth" => Ok(cloth::data()),
        _ => Err(Error::parameter("name", format!("found {name:?}, expected teapot or cloth"))),
    }
}

impl Object {
    /// An object above a floor at its lowest point, seen slightly from above.
    fn standing(shape: Shape, floor: f32, warnings: Vec<String>) -> Self {
        let Ball { centre, radius } = shape.bounds();
        Self { shape, floor, camera: Camera::around(centre, radius, 20.0, 0.0, 1.0), turn_degrees: 0.0, warnings }
    }
}

/// Makes an object of a mesh file, scaled to radius 1 about the origin for the best precision of rays.
fn from_file(path: &Path, file: MeshFile) -> Result<Object> {
    let MeshFile { mut data, mut warnings, no_uvs, .. } = file;
    warnings.extend(no_uvs);
    let Ball { centre, radius } = Ball::around(&data.positions);
    if radius > 0.0 && radius.is_finite() {
        data.positions.iter_mut().for_each(|p| *p = (*p - centre) / radius);
    }
    let floor = data.positions.iter().map(|p| p.y).fold(f32::INFINITY, f32::min);
    let mesh = super::Mesh::new(data).map_err(|e| Error::invalid(path, "mesh", e.to_string()))?;
    Ok(Object::standing(Shape::Mesh(mesh.into()), floor, warnings))
}

#[cfg(test)]
mod tests;
