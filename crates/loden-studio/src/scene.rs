//! What the 3D view shows: objects as triangles for the browser, and the same view as a scene file for the path tracer.

use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

use axum::Json;
use axum::extract::Query;
use axum::response::{IntoResponse, Response};
use glam::Vec3;
use loden::render::object::{self, Object};
use loden::render::{MeshData, Projection, Shape, from_up};
use loden::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::failure::{Answer, blocking};

/// Segments around a sphere, and half as many from pole to pole.
const AROUND: usize = 256;

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

/// An object that is built in; files are not among them.
fn built_in(name: &str) -> Result<Object> {
    let known = object::OBJECTS.iter().find(|known| known.name == name);
    let names = || object::OBJECTS.iter().map(|object| object.name).collect::<Vec<_>>().join(", ");
    let missing = || Error::parameter("object", format!("found {name:?}, expected one of {}", names()));
    (known.ok_or_else(missing)?.build)()
}

/// How an object is seen, and what lights it.
pub(crate) async fn object(Query(named): Query<Named>) -> Answer<Json<Value>> {
    blocking(move || {
        let object = built_in(&named.name)?;
        let Projection::Perspective { field_of_view_degrees } = object.camera.projection else {
            return Err(Error::parameter("object", "has no camera for perspective").into());
        };
        Ok(Json(json!({
            "position": object.camera.position.to_array(), "target": object.camera.target.to_array(), "field_of_view": field_of_view_degrees,
            "floor": object.floor, "turn": object.turn_degrees, "radius": object.shape.bounds().radius,
            "irradiance": IRRADIANCE, "background": BACKGROUND,
        })))
    })
    .await
}

/// The triangles of an object: counts of vertices and triangles, then positions, normals and texture coordinates of all
/// vertices as 32-bit numbers, then the vertices of each triangle.
pub(crate) async fn mesh(Query(named): Query<Named>) -> Answer<Response> {
    blocking(move || {
        let object = built_in(&named.name)?;
        let data = match &object.shape {
            Shape::Mesh(mesh) => mesh.data(),
            Shape::Sphere(sphere) => sphere.triangles(AROUND),
            _ => return Err(Error::parameter("object", "has no triangles").into()),
        };
        Ok(([("content-type", "application/octet-stream")], packed(&data)).into_response())
    })
    .await
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
    /// Repeats of the material per unit of texture coordinates.
    scale: f32,
    /// Width and height of the picture.
    pub size: [usize; 2],
}

/// What lights the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Lighting {
    /// The key light alone and nothing else, which is what the browser draws.
    Lamp,
    /// A soft key light, a weak sky, a floor, and light from surface to surface.
    Studio,
}

impl Look {
    /// The scene as a file for `loden render --scene`, with this many samples per pixel.
    pub fn toml(&self, material: &Path, samples: u32) -> Result<String> {
        let object = built_in(&self.object)?;
        let [theta, phi] = self.light.map(f32::to_radians);
        let direction = from_up(theta, phi);
        let soft = self.lighting == Lighting::Studio;
        let file = serde_json::to_string(&material.display().to_string()).unwrap_or_default();
        let [width, height] = self.size;
        let Projection::Perspective { field_of_view_degrees } = object.camera.projection else {
            return Err(Error::parameter("object", "has no camera for perspective"));
        };
        let mut text = format!(
            "size = [{width}, {height}]\nsamples = {samples}\ndepth = {}\nbackground = {BACKGROUND}\n\n\
             [camera]\nposition = {}\ntarget = {}\nfield-of-view = {field_of_view_degrees}\n\n\
             [[light]]\nkind = \"directional\"\ndirection = {}\nirradiance = {IRRADIANCE:?}\nradius = {}\n\n\
             [material.shown]\nfile = {file}\n\n[[shape]]\n{}\nmaterial = \"shown\"\nuv-scale = {:?}\nuv-rotation = {:?}\n",
            if soft { 6 } else { 2 },
            list(self.position.into()),
            list(self.target.into()),
            list(direction),
            if soft { 5 } else { 0 },
            shape(&self.object, &object),
            self.scale,
            object.turn_degrees,
        );
        if soft {
            // writing to a string cannot fail
            let _ = write!(
                text,
                "\n[environment]\nradiance = {FILL}\n\n[material.floor]\nmodel = \"lambert\"\nkd = 0.4\n\n\
                 [[shape]]\nkind = \"disk\"\nradius = 30\nmaterial = \"floor\"\n\
                 transform = [{{ rotate = [-90, 1, 0, 0] }}, {{ translate = [0, {:?}, 0] }}]\n",
                object.floor
            );
        }
        Ok(text)
    }
}

fn list(v: Vec3) -> String {
    format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z)
}

fn shape(name: &str, object: &Object) -> String {
    match &object.shape {
        Shape::Sphere(sphere) => format!(
            "kind = \"sphere\"\nradius = {:?}\nmapping = {{ kind = \"sphere\", centre = {}, axis = {} }}",
            sphere.radius,
            list(sphere.centre),
            list(sphere.axis)
        ),
        _ => format!("kind = \"object\"\nname = \"{name}\""),
    }
}

/// A look as a scene file, for people who go on with it.
pub(crate) async fn file(
    axum::extract::State(studio): axum::extract::State<Arc<crate::Studio>>,
    Json(look): Json<Look>,
) -> Answer<String> {
    let material = studio.folders.find(&look.material)?;
    let material = std::path::absolute(&material).map_err(Error::io(&material))?;
    Ok(look.toml(&material, 64)?)
}
