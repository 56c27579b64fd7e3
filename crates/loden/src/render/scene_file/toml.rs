//! Scenes in TOML; docs/scenes.md describes them.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec2, Vec3};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::{Spanned, Table, Value};

use super::{Meshes, Named, SceneFile, check_texture};
use crate::direction::Scheme;
use crate::model::{self, Analytic};
use crate::params::Values;
use crate::picture::Picture;
use crate::render::geometry::{self, Basis, Patch, Quadric};
use crate::render::{
    AreaLight, Camera, DirectionalLight, Emitter, Environment, EnvironmentMap, Flat, Lens, Light, MeshData, PointLight,
    Projection, Settings, SpotLight, TextureMap, object,
};
use crate::{Error, Result};

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Document {
    size: Option<[usize; 2]>,
    samples: Option<u32>,
    depth: Option<u32>,
    background: Option<Color>,
    camera: CameraTable,
    environment: Option<Sky>,
    #[serde(default)]
    light: Vec<Spanned<Table>>,
    #[serde(default)]
    material: BTreeMap<String, Spanned<Table>>,
    #[serde(default)]
    shape: Vec<Spanned<Table>>,
}

/// One number for all channels, or three.
#[derive(Deserialize, Clone, Copy)]
#[serde(untagged, expecting = "expected a number or [red, green, blue]")]
enum Color {
    Grey(f32),
    Rgb([f32; 3]),
}

impl From<Color> for Vec3 {
    fn from(color: Color) -> Self {
        match color {
            Color::Grey(value) => Self::splat(value),
            Color::Rgb(rgb) => rgb.into(),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct CameraTable {
    position: Vec3Of,
    target: Vec3Of,
    #[serde(default = "up")]
    up: Vec3Of,
    field_of_view: Option<f32>,
    orthographic: Option<f32>,
    #[serde(default)]
    lens_radius: f32,
    focus: Option<f32>,
}

type Vec3Of = [f32; 3];

fn up() -> Vec3Of {
    [0.0, 1.0, 0.0]
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sky {
    radiance: Option<Color>,
    file: Option<PathBuf>,
    #[serde(default)]
    rotation: f32,
}

#[derive(Deserialize)]
#[serde(tag = "kind", deny_unknown_fields, rename_all = "kebab-case", rename_all_fields = "kebab-case")]
enum LightTable {
    Directional {
        direction: Vec3Of,
        irradiance: Color,
        #[serde(default)]
        radius: f32,
    },
    Point {
        position: Vec3Of,
        intensity: Color,
    },
    Spot {
        position: Vec3Of,
        target: Vec3Of,
        intensity: Color,
        angle: f32,
        #[serde(default)]
        edge: f32,
        #[serde(default)]
        falloff: f32,
    },
    Rectangle {
        centre: Vec3Of,
        x: Vec3Of,
        y: Vec3Of,
        radiance: Color,
    },
    Disk {
        centre: Vec3Of,
        x: Vec3Of,
        y: Vec3Of,
        radiance: Color,
    },
    Sphere {
        centre: Vec3Of,
        radius: f32,
        radiance: Color,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct MaterialFile {
    file: PathBuf,
    #[serde(default)]
    interpolation: Interpolation,
}

#[derive(Deserialize, Default, Clone, Copy)]
#[serde(rename_all = "kebab-case")]
enum Interpolation {
    #[default]
    Triangles,
    Rings,
}

/// What every shape has.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Wearing {
    material: String,
    #[serde(default)]
    transform: Vec<Step>,
    #[serde(default = "one")]
    uv_scale: f32,
    #[serde(default)]
    uv_rotation: f32,
}

fn one() -> f32 {
    1.0
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "kebab-case")]
enum Step {
    Translate(Vec3Of),
    Rotate([f32; 4]),
    Scale(Color),
    Matrix([f32; 16]),
}

fn full() -> f32 {
    360.0
}

#[derive(Deserialize, Debug)]
#[serde(tag = "kind", deny_unknown_fields, rename_all = "kebab-case", rename_all_fields = "kebab-case")]
enum ShapeTable {
    Sphere {
        #[serde(default = "one")]
        radius: f32,
        z_min: Option<f32>,
        z_max: Option<f32>,
        #[serde(default = "full")]
        sweep: f32,
    },
    Cone {
        height: f32,
        radius: f32,
        #[serde(default = "full")]
        sweep: f32,
    },
    Cylinder {
        radius: f32,
        z_min: f32,
        z_max: f32,
        #[serde(default = "full")]
        sweep: f32,
    },
    Hyperboloid {
        from: Vec3Of,
        to: Vec3Of,
        #[serde(default = "full")]
        sweep: f32,
    },
    Paraboloid {
        radius: f32,
        z_min: f32,
        z_max: f32,
        #[serde(default = "full")]
        sweep: f32,
    },
    Disk {
        radius: f32,
        #[serde(default)]
        height: f32,
        #[serde(default = "full")]
        sweep: f32,
    },
    Torus {
        major_radius: f32,
        minor_radius: f32,
        #[serde(default)]
        phi_min: f32,
        #[serde(default = "full")]
        phi_max: f32,
        #[serde(default = "full")]
        sweep: f32,
    },
    Quad {
        corners: [Vec3Of; 4],
    },
    Polygon {
        points: Vec<Vec3Of>,
        #[serde(default)]
        holes: Vec<Vec<Vec3Of>>,
    },
    Patch {
        points: Vec<Vec3Of>,
        #[serde(default = "bezier")]
        basis: String,
    },
    Object {
        name: String,
    },
    Mesh {
        file: PathBuf,
    },
    Subdivision {
        file: PathBuf,
        #[serde(default = "four")]
        levels: u32,
    },
}

fn bezier() -> String {
    "bezier".into()
}

fn four() -> u32 {
    4
}

pub(super) fn read(path: &Path) -> Result<SceneFile> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let source = Source { path, text: &text };
    let document: Document = toml::from_str(&text).map_err(|e| source.at(e.span(), "scene", e.message()))?;
    let mut file = SceneFile::empty(document.camera.camera().map_err(|e| source.at(None, "camera", &e.to_string()))?);
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
        file.environment = source.environment(sky)?;
    }
    for table in document.light {
        file.lights.push(source.part("light", table, |light: LightTable| light.light())?);
    }
    for (name, table) in document.material {
        let what = format!("material.{name}");
        let material = source.part(&what, table, |table: Table| source.material(&mut file, table))?;
        file.materials.push(Named { name, material });
    }
    let mut meshes = Meshes::default();
    for table in document.shape {
        source.part("shape", table, |table: Table| source.shape(&mut file, &mut meshes, table))?;
    }
    Ok(file)
}

/// The file, to say where in it something is wrong and to find others beside it.
struct Source<'a> {
    path: &'a Path,
    text: &'a str,
}

impl Source<'_> {
    fn at(&self, span: Option<Range<usize>>, what: &str, problem: &str) -> Error {
        let line = span.map(|s| 1 + self.text.bytes().take(s.start).filter(|&b| b == b'\n').count());
        Error::invalid(self.path, line.map_or(what.into(), |line| format!("line {line}: {what}")), problem)
    }

    /// Makes a part of the scene from its table; what fails is said with the table's line.
    fn part<T: DeserializeOwned, U>(
        &self,
        what: &str,
        table: Spanned<Table>,
        make: impl FnOnce(T) -> Result<U>,
    ) -> Result<U> {
        let span = table.span();
        let part = typed(table.into_inner()).and_then(make);
        part.map_err(|error| match error {
            // about the scene itself, not a file that it names
            Error::Parameter { name, problem } => self.at(Some(span), &format!("{what}: {name}"), &problem),
            other => other,
        })
    }

    fn beside(&self, path: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new(".")).join(path)
    }

    fn environment(&self, sky: &Sky) -> Result<Environment> {
        match (sky.radiance, &sky.file) {
            (Some(radiance), None) => Ok(Environment::Constant(not_negative("radiance", radiance)?)),
            (None, Some(file)) => {
                let file = self.beside(file);
                let map = EnvironmentMap::new(Picture::read(&file)?, sky.rotation);
                Ok(Environment::Map(Box::new(map.map_err(|e| Error::invalid(&file, "environment", e.to_string()))?)))
            }
            _ => Err(self.at(None, "environment", "either radiance or file is expected")),
        }
    }

    fn material(&self, file: &mut SceneFile, table: Table) -> Result<Arc<dyn crate::material::Material>> {
        if table.contains_key("file") {
            let MaterialFile { file: path, interpolation } = typed(table)?;
            let scheme = match interpolation {
                Interpolation::Triangles => Scheme::Triangles,
                Interpolation::Rings => Scheme::Rings,
            };
            return file.open_material(&self.beside(&path), scheme);
        }
        let name = table.get("model").and_then(Value::as_str);
        let name = name.ok_or_else(|| Error::parameter("model", "there is neither a model nor a file"))?;
        let model = model::by_name(name)?;
        let mut values = Values::defaults(model.params());
        for (key, value) in table.iter().filter(|(key, _)| *key != "model") {
            values.set(key, &text(value))?;
        }
        Ok(Arc::new(Analytic::new(model, values)))
    }

    fn shape(&self, file: &mut SceneFile, meshes: &mut Meshes, mut table: Table) -> Result<()> {
        let common = ["material", "transform", "uv-scale", "uv-rotation"];
        let common: Table = common.iter().filter_map(|key| table.remove_entry(*key)).collect();
        let wearing: Wearing = typed(common)?;
        let shape: ShapeTable = typed(table)?;
        let material = file.materials.iter().position(|m| m.name == wearing.material);
        let material = material.ok_or_else(|| {
            let known: Vec<_> = file.materials.iter().map(|m| m.name.as_str()).collect();
            Error::parameter("material", format!("found {:?}, there are: {}", wearing.material, known.join(", ")))
        })?;
        let texture = TextureMap { scale: wearing.uv_scale, rotation_degrees: wearing.uv_rotation };
        let mut warnings = Vec::new();
        let mesh = meshes.get(format!("{shape:?}"), || self.mesh(&shape, &mut warnings))?;
        file.warnings.append(&mut warnings);
        let transform = wearing.transform.iter().fold(Mat4::IDENTITY, |sum, step| step.matrix() * sum);
        file.place(mesh, transform, material, check_texture(texture)?)
    }

    fn mesh(&self, shape: &ShapeTable, warnings: &mut Vec<String>) -> Result<MeshData> {
        const UVS: [Vec2; 4] = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
        let corners = |points: &[Vec3Of]| points.iter().copied().map(Vec3::from).collect::<Vec<_>>();
        match shape {
            ShapeTable::Quad { corners: points } => {
                let points = [0, 1, 3, 2].map(|i| Vec3::from(points[i]));
                Ok(geometry::bilinear_mesh(&[Patch { points, uvs: UVS }]))
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
                Ok(data)
            }
            ShapeTable::Patch { points, basis } => {
                let points = corners(points);
                let basis = Basis::named(basis)
                    .ok_or_else(|| Error::parameter("basis", format!("there is no basis {basis:?}")))?;
                if let Ok(points) = <[Vec3; 4]>::try_from(&points[..]) {
                    return Ok(geometry::bilinear_mesh(&[Patch { points, uvs: UVS }]));
                }
                let points = <[Vec3; 16]>::try_from(&points[..])
                    .map_err(|_| Error::parameter("points", format!("found {}, expected 4 or 16", points.len())))?;
                Ok(geometry::bicubic_mesh(&[Patch { points, uvs: UVS }], &basis, &basis))
            }
            ShapeTable::Object { name } => object::data(name),
            ShapeTable::Mesh { file } => {
                let (data, mut found) = object::read(&self.beside(file))?;
                warnings.append(&mut found);
                Ok(data)
            }
            ShapeTable::Subdivision { file, levels } => {
                geometry::subdivide(&object::control_mesh(&self.beside(file))?, (*levels).min(8))
            }
            quadric => quadric.quadric().map_or_else(|| Ok(MeshData::default()), |q| q.mesh()),
        }
    }
}

/// A table as what it should be; the error names the field.
fn typed<T: DeserializeOwned>(table: Table) -> Result<T> {
    table.try_into().map_err(|e: toml::de::Error| Error::parameter("field", e.message().trim().replace('\n', " ")))
}

/// A parameter's value as it would be written on the command line.
fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(list) => list.iter().map(text).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}

fn not_negative(name: &str, color: Color) -> Result<Vec3> {
    let color = Vec3::from(color);
    if color.is_finite() && color.min_element() >= 0.0 {
        return Ok(color);
    }
    Err(Error::parameter(name, format!("found {color}, expected finite and not negative")))
}

impl CameraTable {
    fn camera(&self) -> Result<Camera> {
        let projection = match (self.field_of_view, self.orthographic) {
            (field, None) => Projection::Perspective { field_of_view_degrees: field.unwrap_or(30.0) },
            (None, Some(height)) => Projection::Orthographic { height },
            _ => return Err(Error::parameter("camera", "it has both field-of-view and orthographic")),
        };
        let (position, target) = (Vec3::from(self.position), Vec3::from(self.target));
        let focus = self.focus.unwrap_or(position.distance(target));
        let lens = if self.lens_radius == 0.0 { Lens::PINHOLE } else { Lens { radius: self.lens_radius, focus } };
        Ok(Camera { position, target, up: self.up.into(), projection, lens, window: None })
    }
}

impl LightTable {
    fn light(&self) -> Result<Light> {
        let unit = |name: &str, v: Vec3| {
            v.try_normalize().ok_or_else(|| Error::parameter(name, format!("found {v}, expected a direction")))
        };
        Ok(match *self {
            Self::Directional { direction, irradiance, radius } => DirectionalLight {
                direction: unit("direction", direction.into())?,
                irradiance: not_negative("irradiance", irradiance)?,
                radius_degrees: in_range("radius", radius, 0.0, 89.0)?,
            }
            .into(),
            Self::Point { position, intensity } => {
                Light::Point(PointLight { position: position.into(), intensity: not_negative("intensity", intensity)? })
            }
            Self::Spot { position, target, intensity, angle, edge, falloff } => Light::Spot(SpotLight {
                position: position.into(),
                axis: unit("target", Vec3::from(target) - Vec3::from(position))?,
                intensity: not_negative("intensity", intensity)?,
                angle_degrees: in_range("angle", angle, 0.0, 180.0)?,
                edge_degrees: in_range("edge", edge, 0.0, angle)?,
                falloff: in_range("falloff", falloff, 0.0, 1e6)?,
            }),
            Self::Rectangle { centre, x, y, radiance } => area(Emitter::Rectangle(flat(centre, x, y)?), radiance)?,
            Self::Disk { centre, x, y, radiance } => area(Emitter::Disk(flat(centre, x, y)?), radiance)?,
            Self::Sphere { centre, radius, radiance } => {
                let radius = in_range("radius", radius, f32::MIN_POSITIVE, 1e12)?;
                area(Emitter::Sphere { centre: centre.into(), radius }, radiance)?
            }
        })
    }
}

fn in_range(name: &str, found: f32, min: f32, max: f32) -> Result<f32> {
    if (min..=max).contains(&found) {
        return Ok(found);
    }
    Err(Error::parameter(name, format!("found {found}, expected {min} to {max}")))
}

fn flat(centre: Vec3Of, x: Vec3Of, y: Vec3Of) -> Result<Flat> {
    let flat = Flat { centre: centre.into(), x: x.into(), y: y.into() };
    if flat.x.cross(flat.y).length_squared().is_normal() {
        return Ok(flat);
    }
    Err(Error::parameter("x", format!("{} and y {} span no area", flat.x, flat.y)))
}

fn area(shape: Emitter, radiance: Color) -> Result<Light> {
    Ok(Light::Area(AreaLight { shape, radiance: not_negative("radiance", radiance)? }))
}

impl Step {
    fn matrix(self) -> Mat4 {
        match self {
            Self::Translate(by) => Mat4::from_translation(by.into()),
            Self::Rotate([degrees, x, y, z]) => {
                Mat4::from_axis_angle(Vec3::new(x, y, z).normalize_or(Vec3::Z), degrees.to_radians())
            }
            Self::Scale(by) => Mat4::from_scale(by.into()),
            Self::Matrix(rows) => Mat4::from_cols_array(&rows).transpose(),
        }
    }
}

impl ShapeTable {
    fn quadric(&self) -> Option<Quadric> {
        Some(match *self {
            Self::Sphere { radius, z_min, z_max, sweep } => {
                Quadric::Sphere { radius, z_min: z_min.unwrap_or(-radius), z_max: z_max.unwrap_or(radius), sweep }
            }
            Self::Cone { height, radius, sweep } => Quadric::Cone { height, radius, sweep },
            Self::Cylinder { radius, z_min, z_max, sweep } => Quadric::Cylinder { radius, z_min, z_max, sweep },
            Self::Hyperboloid { from, to, sweep } => Quadric::Hyperboloid { from: from.into(), to: to.into(), sweep },
            Self::Paraboloid { radius, z_min, z_max, sweep } => {
                Quadric::Paraboloid { r_max: radius, z_min, z_max, sweep }
            }
            Self::Disk { radius, height, sweep } => Quadric::Disk { height, radius, sweep },
            Self::Torus { major_radius, minor_radius, phi_min, phi_max, sweep } => {
                Quadric::Torus { major_radius, minor_radius, phi_min, phi_max, sweep }
            }
            _ => return None,
        })
    }
}
