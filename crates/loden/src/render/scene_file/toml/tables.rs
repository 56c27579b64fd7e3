//! The tables of a scene in TOML, and what they stand for.

use std::collections::BTreeMap;
use std::path::PathBuf;

use glam::{Mat4, Vec3};
use serde::Deserialize;
use toml::{Spanned, Table};

use crate::render::geometry::Quadric;
use crate::render::{
    AreaLight, Camera, DirectionalLight, Emitter, Flat, Lens, Light, Mapping, PointLight, Projection, SpotLight, Wrap,
};
use crate::{Error, Result};

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct Document {
    pub size: Option<[usize; 2]>,
    pub samples: Option<u32>,
    pub depth: Option<u32>,
    pub background: Option<Color>,
    pub camera: CameraTable,
    pub environment: Option<Sky>,
    #[serde(default)]
    pub light: Vec<Spanned<Table>>,
    #[serde(default)]
    pub material: BTreeMap<String, Spanned<Table>>,
    #[serde(default)]
    pub shape: Vec<Spanned<Table>>,
}

/// One number for all channels, or three.
#[derive(Deserialize, Clone, Copy)]
#[serde(untagged, expecting = "expected a number or [red, green, blue]")]
pub(super) enum Color {
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
pub(super) struct CameraTable {
    pub position: Vec3Of,
    pub target: Vec3Of,
    #[serde(default = "up")]
    pub up: Vec3Of,
    pub field_of_view: Option<f32>,
    pub orthographic: Option<f32>,
    #[serde(default)]
    pub lens_radius: f32,
    pub focus: Option<f32>,
}

pub(super) type Vec3Of = [f32; 3];

fn up() -> Vec3Of {
    [0.0, 1.0, 0.0]
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sky {
    pub radiance: Option<Color>,
    pub file: Option<PathBuf>,
    #[serde(default)]
    pub rotation: f32,
}

#[derive(Deserialize)]
#[serde(tag = "kind", deny_unknown_fields, rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub(super) enum LightTable {
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
pub(super) struct MaterialFile {
    pub file: PathBuf,
    #[serde(default)]
    pub interpolation: Interpolation,
    pub memory: Option<String>,
}

#[derive(Deserialize, Default, Clone, Copy)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Interpolation {
    #[default]
    Triangles,
    Rings,
}

/// What every shape has.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct Wearing {
    pub material: String,
    #[serde(default)]
    pub transform: Vec<Step>,
    #[serde(default = "one")]
    pub uv_scale: f32,
    #[serde(default)]
    pub uv_rotation: f32,
    pub mapping: Option<MappingTable>,
    #[serde(default)]
    pub wrap: WrapWord,
    #[serde(default = "once")]
    pub texture_samples: u32,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(tag = "kind", deny_unknown_fields, rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub(super) enum MappingTable {
    Sphere {
        centre: Vec3Of,
        #[serde(default = "up")]
        axis: Vec3Of,
    },
    Cylinder {
        centre: Vec3Of,
        axis: Vec3Of,
    },
    Plane {
        origin: Vec3Of,
        u: Vec3Of,
        v: Vec3Of,
    },
    Camera {
        position: Vec3Of,
        target: Vec3Of,
        #[serde(default = "up")]
        up: Vec3Of,
        field_of_view: f32,
    },
    Triplanar {
        #[serde(default)]
        origin: Vec3Of,
        size: f32,
    },
}

impl From<MappingTable> for Mapping {
    fn from(table: MappingTable) -> Self {
        match table {
            MappingTable::Sphere { centre, axis } => Self::Sphere { centre: centre.into(), axis: axis.into() },
            MappingTable::Cylinder { centre, axis } => Self::Cylinder { centre: centre.into(), axis: axis.into() },
            MappingTable::Plane { origin, u, v } => Self::Plane { origin: origin.into(), u: u.into(), v: v.into() },
            MappingTable::Camera { position, target, up, field_of_view } => {
                let [position, target, up] = [position, target, up].map(Vec3::from);
                Self::Camera { position, target, up, field_of_view_degrees: field_of_view }
            }
            MappingTable::Triplanar { origin, size } => Self::Triplanar { origin: origin.into(), size },
        }
    }
}

#[derive(Deserialize, Clone, Copy, Default)]
#[serde(rename_all = "kebab-case")]
pub(super) enum WrapWord {
    #[default]
    Repeat,
    Mirror,
    Clamp,
    Black,
}

impl From<WrapWord> for Wrap {
    fn from(word: WrapWord) -> Self {
        match word {
            WrapWord::Repeat => Self::Repeat,
            WrapWord::Mirror => Self::Mirror,
            WrapWord::Clamp => Self::Clamp,
            WrapWord::Black => Self::Black,
        }
    }
}

fn once() -> u32 {
    1
}

fn one() -> f32 {
    1.0
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Step {
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
pub(super) enum ShapeTable {
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

pub(super) fn not_negative(name: &str, color: Color) -> Result<Vec3> {
    let color = Vec3::from(color);
    if color.is_finite() && color.min_element() >= 0.0 {
        return Ok(color);
    }
    Err(Error::parameter(name, format!("found {color}, expected finite and not negative")))
}

impl CameraTable {
    pub fn camera(&self) -> Result<Camera> {
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
    pub fn light(&self) -> Result<Light> {
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
    pub fn matrix(self) -> Mat4 {
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
    pub fn quadric(&self) -> Option<Quadric> {
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
