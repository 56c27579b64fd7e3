//! Scene files in TOML; `docs/scenes.md` describes the format.

mod tables;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat4, Mat4, Vec2, Vec3};
use serde::de::DeserializeOwned;
use toml::{Spanned, Table, Value};

use self::tables::{
    Array3, CommonFields, Document, EnvironmentTable, LightTable, MaterialFile, ShapeTable, non_negative,
};
use super::{Meshes, SceneFile, SceneMaterial};
use crate::import;
use crate::material::{Blending, Interpolation, Material};
use crate::memory::Memory;
use crate::model::{self, Analytic};
use crate::params::Values;
use crate::picture::Picture;
use crate::render::geometry::{self, Basis, Patch};
use crate::render::object::MeshFile;
use crate::render::{
    CREASE_DEGREES, Environment, EnvironmentMap, Light, Mapping, Mesh, MeshData, Revolved, Settings, TextureMap, object,
};
use crate::{Error, Result};

pub(super) fn read(path: &Path, memory: Option<Memory>) -> Result<SceneFile> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let source = Source { path, text: &text };
    let document: Document =
        toml::from_str(&text).map_err(|e| source.invalid(e.span(), "scene", &crate::input::in_words(e.message())))?;
    let camera = document.camera.camera().map_err(|e| source.invalid(None, "camera", &e.to_string()))?;
    let mut file = SceneFile::empty(camera);
    file.memory = memory;
    let defaults = Settings::default();
    let [width, height] = document.size.unwrap_or([defaults.width, defaults.height]);
    file.settings = Settings {
        width,
        height,
        spp: document.samples.unwrap_or(defaults.spp),
        depth: document.depth.unwrap_or(defaults.depth),
        ..defaults
    };
    file.background = document.background.map(Vec3::from);
    if let Some(sky) = &document.environment {
        file.environment = source.environment(sky, &mut file.warnings)?;
    }
    for table in document.light {
        let light = |light: LightTable| source.light(&light, &mut file.warnings);
        file.lights.push(source.part("light", table, light)?);
    }
    for (name, table) in document.material {
        let what = format!("material.{name}");
        let (material, source) = source.part(&what, table, |table: Table| source.material(&mut file, table))?;
        file.materials.push(SceneMaterial { name, material, source });
    }
    let mut meshes = Meshes::default();
    for table in document.shape {
        source.part("shape", table, |table: Table| source.shape(&mut file, &mut meshes, table))?;
    }
    Ok(file)
}

/// The scene file: locates errors by line and resolves relative paths.
struct Source<'a> {
    path: &'a Path,
    text: &'a str,
}

impl Source<'_> {
    /// An error in this file; `span` gives the line.
    fn invalid(&self, span: Option<Range<usize>>, what: &str, problem: &str) -> Error {
        let line = span.map(|s| 1 + self.text.bytes().take(s.start).filter(|&b| b == b'\n').count());
        Error::invalid(self.path, line.map_or(what.into(), |line| format!("line {line}: {what}")), problem)
    }

    /// Makes a part of the scene from its table. Errors name the line of the table, also those of files that it names.
    fn part<T: DeserializeOwned, U>(
        &self,
        what: &str,
        table: Spanned<Table>,
        make: impl FnOnce(T) -> Result<U>,
    ) -> Result<U> {
        let span = table.span();
        let part = typed(table.into_inner()).and_then(make);
        part.map_err(|error| match error {
            Error::Parameter { name, problem } => self.invalid(Some(span), &format!("{what}: {name}"), &problem),
            other => self.invalid(Some(span), what, &other.to_string()),
        })
    }

    /// Resolves a path relative to the folder of the scene file.
    fn resolve(&self, path: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new(".")).join(path)
    }

    fn environment(&self, sky: &EnvironmentTable, warnings: &mut Vec<String>) -> Result<Environment> {
        match (sky.radiance, &sky.file) {
            (Some(radiance), None) => Ok(Environment::Constant(non_negative("radiance", radiance)?)),
            (None, Some(file)) => {
                let map = EnvironmentMap::read(self.resolve(file), sky.rotation, warnings);
                let map = map.map_err(|error| self.invalid(None, "environment", &error.to_string()))?;
                Ok(Environment::Map(Box::new(map)))
            }
            _ => Err(self.invalid(None, "environment", "expected either radiance or file")),
        }
    }

    fn light(&self, table: &LightTable, warnings: &mut Vec<String>) -> Result<Light> {
        let light = table.light()?;
        let (Light::Area(area), Some(texture)) = (&light, table.texture()) else { return Ok(light) };
        let path = self.resolve(texture);
        let textured = area.clone().with_texture(Picture::read_light(&path, warnings)?);
        Ok(Light::Area(textured.map_err(|e| Error::invalid(&path, "texture", e.to_string()))?))
    }

    /// A material, and what opens it again.
    fn material(&self, file: &mut SceneFile, table: Table) -> Result<(Arc<dyn Material>, Option<String>)> {
        if table.contains_key("file") {
            let MaterialFile { file: path, interpolation, blending, memory } = typed(table)?;
            let memory =
                memory.map(|text| text.parse()).transpose().map_err(|e: String| Error::parameter("memory", e))?;
            let how = Interpolation::of_words(
                interpolation.as_deref().unwrap_or("triangles"),
                blending.as_deref().unwrap_or(Blending::Auto.name()),
            )?;
            let resolved = self.resolve(&path);
            let path = import::in_scene(Path::new(&path), resolved);
            let source = (how == Interpolation::default()).then(|| path.display().to_string());
            return Ok((file.open_material(&path, how, memory)?, source));
        }
        let name = table.get("model").and_then(Value::as_str);
        let name = name.ok_or_else(|| Error::parameter("model", "expected either model or file"))?;
        let model = model::by_name(name)?;
        let mut values = Values::defaults(model.params());
        for (key, value) in table.iter().filter(|(key, _)| *key != "model") {
            values.set(key, &text(value))?;
        }
        let analytic = Analytic::new(model, values)?;
        let source = analytic.specification();
        Ok((Arc::new(analytic), Some(source)))
    }

    fn shape(&self, file: &mut SceneFile, meshes: &mut Meshes, mut table: Table) -> Result<()> {
        let common = ["material", "transform", "uv-scale", "uv-rotation", "mapping", "wrap", "texture-samples"];
        let common: Table = common.iter().filter_map(|key| table.remove_entry(*key)).collect();
        let common: CommonFields = typed(common)?;
        let shape: ShapeTable = typed(table)?;
        let material = file.materials.iter().position(|m| m.name == common.material);
        let material = material.ok_or_else(|| {
            let known: Vec<_> = file.materials.iter().map(|m| m.name.as_str()).collect();
            Error::parameter("material", format!("found {:?}, expected one of: {}", common.material, known.join(", ")))
        })?;
        let texture = TextureMap {
            scale: common.uv_scale,
            rotation_degrees: common.uv_rotation,
            mapping: common.mapping.map_or(Mapping::Surface, Mapping::from),
            wrap: common.wrap.into(),
            samples: common.texture_samples,
        };
        let transform = common.transform.iter().fold(Mat4::IDENTITY, |product, step| step.matrix() * product);
        if let Some(quadric) = shape.quadric() {
            let form = Revolved::new(quadric, Revolved::CORNERS, false)?.into();
            return file.place(form, transform, material, texture);
        }
        let crease = if let ShapeTable::Mesh { crease, .. } = &shape { *crease } else { None };
        let mut read = MeshFile::default();
        let (mesh, origin) = meshes.get(format!("{shape:?}"), || {
            read = self.mesh(&shape)?;
            let data = std::mem::take(&mut read.data);
            let mesh = Mesh::smoothed(data, crease.unwrap_or(CREASE_DEGREES));
            let named = |problem: &str| match &shape {
                ShapeTable::Mesh { file, .. } => Error::invalid(self.resolve(file), "mesh", problem),
                _ => Error::parameter("mesh", problem),
            };
            let mesh = mesh.map_err(|error| match error {
                Error::Parameter { name, problem } if name == "mesh" => named(&problem),
                other => other,
            });
            Ok((mesh?, read.origin))
        })?;
        file.warnings.append(&mut read.warnings);
        if texture.mapping == Mapping::Surface {
            file.warnings.extend(read.no_uvs);
        }
        let transform = (transform.as_dmat4() * DMat4::from_translation(origin)).as_mat4();
        file.place(mesh.into(), transform, material, texture)
    }

    fn mesh(&self, shape: &ShapeTable) -> Result<MeshFile> {
        const UVS: [Vec2; 4] = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
        let corners = |points: &[Array3]| points.iter().copied().map(Vec3::from).collect::<Vec<_>>();
        let mut warnings = Vec::new();
        let data = match shape {
            ShapeTable::Quad { corners: points } => {
                let points = [0, 1, 3, 2].map(|i| Vec3::from(points[i]));
                geometry::bilinear_mesh(&[Patch { points, uvs: UVS }])
            }
            ShapeTable::Polygon { points, holes } => {
                let loops = std::iter::once(points).chain(holes);
                let mut data = MeshData::default();
                let mut indices = Vec::new();
                for points in loops {
                    let first = data.positions.len() as u32;
                    data.positions.extend(corners(points));
                    indices.push((first..data.positions.len() as u32).collect());
                }
                data.triangles = geometry::polygons(&data.positions, &[indices])?;
                data
            }
            ShapeTable::Patch { points, basis } => {
                let points = corners(points);
                let basis = Basis::by_name(basis)?;
                if let Ok(points) = <[Vec3; 4]>::try_from(&points[..]) {
                    geometry::bilinear_mesh(&[Patch { points, uvs: UVS }])
                } else {
                    let points = <[Vec3; 16]>::try_from(&points[..]).map_err(|_| {
                        Error::parameter("points", format!("found {} points, expected 4 or 16", points.len()))
                    })?;
                    geometry::bicubic_mesh(&[Patch { points, uvs: UVS }], &basis, &basis)
                }
            }
            ShapeTable::Object { name } => object::data(name)?,
            ShapeTable::Mesh { file, .. } => return object::read(&self.resolve(file)),
            ShapeTable::Subdivision { file, levels } => {
                let (control, mut found) = object::control_mesh(&self.resolve(file))?;
                warnings.append(&mut found);
                let most = geometry::max_levels(&control);
                if let Some(levels) = levels.filter(|&levels| levels > most) {
                    warnings.push(format!(
                        "{}: subdivided {most} times, not {levels}: the limit is 262144 faces",
                        file.display()
                    ));
                }
                geometry::subdivide(&control, levels.unwrap_or(4))?
            }
            _ => return Err(Error::parameter("kind", "found a quadric, which has no mesh")),
        };
        Ok(MeshFile { data, warnings, ..MeshFile::default() })
    }
}

/// Converts a table to its type; the error names the field.
fn typed<T: DeserializeOwned>(table: Table) -> Result<T> {
    table.try_into().map_err(|e: toml::de::Error| {
        Error::parameter("field", crate::input::in_words(e.message()).trim().replace('\n', " "))
    })
}

/// A parameter's value as it is written on the command line.
fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(list) => list.iter().map(text).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}
