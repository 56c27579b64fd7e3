//! What the 3D view shows: objects as triangles for the browser, and the same view as a scene file for the path tracer.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use axum::Json;
use axum::extract::{Query, State};
use axum::response::{IntoResponse, Response};
use glam::Vec3;
use loden::render::object::{self, Object};
use loden::render::{Ball, MeshData, Projection, Shape, from_up};
use loden::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::Studio;
use crate::catalogue::key;
use crate::extras::{check_mesh, has};
use crate::failure::{Answer, blocking};

/// Segments around a sphere, and half as many from pole to pole.
const AROUND: usize = 256;

/// Objects of mesh files that are kept.
const KEPT: usize = 4;

/// Radiance behind objects: the grey of the view.
pub(crate) const BACKGROUND: f32 = 0.0232;

/// The key light: irradiance on a surface that faces it.
pub(crate) const IRRADIANCE: f32 = 0.88 * std::f32::consts::PI;

/// Radiance of the sky of [`Lighting::Studio`].
const FILL: f32 = 0.2;

#[derive(Deserialize)]
pub(crate) struct Named {
    name: String,
}

/// An object and, unless it is built in, its file.
pub(crate) struct Worn {
    object: Arc<Object>,
    file: Option<PathBuf>,
}

impl Studio {
    /// A built-in object by its name, or that of a mesh file below the given folders.
    pub fn object(&self, name: &str) -> Answer<Worn> {
        if let Some(known) = object::OBJECTS.iter().find(|known| known.name == name) {
            return Ok(Worn { object: Arc::new((known.build)()?), file: None });
        }
        let names = || object::OBJECTS.iter().map(|object| object.name).collect::<Vec<_>>().join(", ");
        let missing = || Error::parameter("object", format!("found {name:?}, expected {} or a mesh file", names()));
        let path = self.folders.find(name).ok().filter(|path| has(path, object::EXTENSIONS)).ok_or_else(missing)?;
        let found = self.objects.get(&key(&path)?, KEPT, || {
            check_mesh(&self.folders, &path)?;
            Ok(Arc::new(object::load(&path.display().to_string())?))
        })?;
        Ok(Worn { object: found, file: Some(std::path::absolute(&path).map_err(Error::io(&path))?) })
    }
}

/// How an object is seen, and what lights it.
pub(crate) async fn object(State(studio): State<Arc<Studio>>, Query(named): Query<Named>) -> Answer<Json<Value>> {
    blocking(move || {
        let Worn { object, .. } = studio.object(&named.name)?;
        let Projection::Perspective { field_of_view_degrees } = object.camera.projection else {
            return Err(Error::parameter("object", "has no camera for perspective").into());
        };
        Ok(Json(json!({
            "position": object.camera.position.to_array(), "target": object.camera.target.to_array(), "field_of_view": field_of_view_degrees,
            "floor": object.floor, "turn": object.turn_degrees, "radius": object.shape.bounds().radius,
            "irradiance": IRRADIANCE, "background": BACKGROUND, "warnings": object.warnings,
        })))
    })
    .await
}

/// The triangles of an object: counts of vertices and triangles, then positions, normals and texture coordinates of all
/// vertices as 32-bit numbers, then the vertices of each triangle.
pub(crate) async fn mesh(State(studio): State<Arc<Studio>>, Query(named): Query<Named>) -> Answer<Response> {
    blocking(move || {
        let Worn { object, .. } = studio.object(&named.name)?;
        let data = match &object.shape {
            Shape::Mesh(mesh) => mesh.data(),
            Shape::Sphere(sphere) => sphere.triangles(AROUND),
            _ => return Err(Error::parameter("object", "has no triangles").into()),
        };
        Ok(([("content-type", "application/octet-stream")], packed(&oriented(data))).into_response())
    })
    .await
}

/// With the vertices of each triangle counter-clockwise as seen from the side that its normals point to: files differ, and browsers tell
/// the outside by this order.
fn oriented(mut data: MeshData) -> MeshData {
    for triangle in &mut data.triangles {
        let [a, b, c] = triangle.map(|vertex| data.positions[vertex as usize]);
        let normal: Vec3 = triangle.iter().map(|vertex| data.normals[*vertex as usize]).sum();
        if (b - a).cross(c - a).dot(normal) < 0.0 {
            triangle.swap(1, 2);
        }
    }
    data
}

fn packed(data: &MeshData) -> Vec<u8> {
    let counts = [data.positions.len() as u32, data.triangles.len() as u32];
    let vectors = data.positions.iter().chain(&data.normals).flat_map(|v| v.to_array());
    let numbers = vectors.chain(data.uvs.iter().flat_map(|uv| uv.to_array()));
    let mut bytes: Vec<u8> = counts.iter().flat_map(|count| count.to_le_bytes()).collect();
    bytes.extend(numbers.flat_map(f32::to_le_bytes));
    bytes.extend(data.triangles.iter().flatten().flat_map(|index| index.to_le_bytes()));
    bytes
}

/// A view of a material on an object.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub(crate) struct Look {
    pub material: String,
    pub object: String,
    position: [f32; 3],
    target: [f32; 3],
    /// Angle from the vertical and azimuth of the key light, degrees, as those of `loden render --light`.
    light: [f32; 2],
    pub lighting: Lighting,
    /// A picture of the surroundings instead of the key light, and how it is turned about the vertical, degrees.
    #[serde(default)]
    surroundings: Option<String>,
    #[serde(default)]
    turn: f32,
    /// Repeats of the material per unit of texture coordinates.
    scale: f32,
    /// Width and height of the picture.
    pub size: [usize; 2],
}

/// What lights the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Lighting {
    /// The key light or the surroundings and nothing else, which is what the browser draws.
    Lamp,
    /// A soft key light and a weak sky, or the surroundings; a floor, and light from surface to surface.
    Studio,
}

impl Look {
    /// The scene as a file for `loden render --scene`, with this many samples per pixel.
    pub fn toml(&self, studio: &Studio, samples: u32) -> Answer<String> {
        let worn = studio.object(&self.object)?;
        let material = studio.folders.find(&self.material)?;
        let material = std::path::absolute(&material).map_err(Error::io(&material))?;
        let surroundings = self.surroundings.as_deref().map(|id| studio.panorama(id)).transpose()?;
        let surroundings = surroundings.map(|path| std::path::absolute(&path).map_err(Error::io(&path))).transpose()?;
        let soft = self.lighting == Lighting::Studio;
        let [width, height] = self.size;
        let Projection::Perspective { field_of_view_degrees } = worn.object.camera.projection else {
            return Err(Error::parameter("object", "has no camera for perspective").into());
        };
        let lights = match &surroundings {
            Some(picture) => {
                format!("[environment]\nfile = {}\nrotation = {:?}\n", quoted(picture), self.turn)
            }
            None => self.key_light(soft),
        };
        let mut text = format!(
            "size = [{width}, {height}]\nsamples = {samples}\ndepth = {}\n{}\n\
             [camera]\nposition = {}\ntarget = {}\nfield-of-view = {field_of_view_degrees}\n\n{lights}\n\
             [material.shown]\nfile = {}\n\n[[shape]]\n{}\nmaterial = \"shown\"\nuv-scale = {:?}\nuv-rotation = {:?}\n",
            if soft { 6 } else { 2 },
            if surroundings.is_some() { String::new() } else { format!("background = {BACKGROUND}\n") },
            list(self.position.into()),
            list(self.target.into()),
            quoted(&material),
            worn.shape(&self.object)?,
            self.scale,
            worn.object.turn_degrees,
        );
        if soft {
            // writing to a string cannot fail
            let _ = write!(
                text,
                "\n[material.floor]\nmodel = \"lambert\"\nkd = 0.4\n\n\
                 [[shape]]\nkind = \"disk\"\nradius = 30\nmaterial = \"floor\"\n\
                 transform = [{{ rotate = [-90, 1, 0, 0] }}, {{ translate = [0, {:?}, 0] }}]\n",
                worn.object.floor
            );
        }
        Ok(text)
    }

    /// The key light; a soft one comes with a weak sky.
    fn key_light(&self, soft: bool) -> String {
        let [theta, phi] = self.light.map(f32::to_radians);
        let sky = if soft { format!("[environment]\nradiance = {FILL}\n\n") } else { String::new() };
        let (direction, radius) = (list(from_up(theta, phi)), if soft { 5 } else { 0 });
        format!(
            "{sky}[[light]]\nkind = \"directional\"\ndirection = {direction}\nirradiance = {IRRADIANCE:?}\nradius = {radius}\n"
        )
    }
}

/// A file name as a string of TOML.
fn quoted(path: &Path) -> String {
    serde_json::to_string(&path.display().to_string()).unwrap_or_default()
}

impl Worn {
    /// The lines of its shape. A mesh file is moved and scaled as the library does it to show it by itself.
    fn shape(&self, name: &str) -> Result<String> {
        if let Some(file) = &self.file {
            let Ball { centre, radius } = Ball::around(&object::read(file)?.data.positions);
            let scale = if radius > 0.0 { 1.0 / radius } else { 1.0 };
            let steps = format!("{{ translate = {} }}, {{ scale = {scale:?} }}", list(-centre));
            return Ok(format!("kind = \"mesh\"\nfile = {}\ntransform = [{steps}]", quoted(file)));
        }
        Ok(match &self.object.shape {
            Shape::Sphere(sphere) => format!(
                "kind = \"sphere\"\nradius = {:?}\nmapping = {{ kind = \"sphere\", centre = {}, axis = {} }}",
                sphere.radius,
                list(sphere.centre),
                list(sphere.axis)
            ),
            _ => format!("kind = \"object\"\nname = \"{name}\""),
        })
    }
}

fn list(v: Vec3) -> String {
    format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z)
}

/// A look as a scene file, for people who go on with it.
pub(crate) async fn file(State(studio): State<Arc<Studio>>, Json(look): Json<Look>) -> Answer<String> {
    blocking(move || look.toml(&studio, 64)).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_face_where_their_normals_point() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let both = |normal: Vec3| {
            let mesh = MeshData {
                positions: positions.clone(),
                normals: vec![normal; 3],
                triangles: vec![[0, 1, 2]],
                ..MeshData::default()
            };
            oriented(mesh).triangles
        };
        assert_eq!(both(Vec3::Z), [[0, 1, 2]]);
        assert_eq!(both(Vec3::NEG_Z), [[0, 2, 1]]);
    }
}
