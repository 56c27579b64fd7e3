//! The tables of a TOML scene as types, and their conversion to parts of the scene.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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
    pub environment: Option<EnvironmentTable>,
    #[serde(default)]
    pub light: Vec<Spanned<Table>>,
    #[serde(default)]
    pub material: BTreeMap<String, Spanned<Table>>,
    #[serde(default)]
    pub shape: Vec<Spanned<Table>>,
}

/// One number for all channels, or three numbers.
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
    pub position: Array3,
    pub target: Array3,
    #[serde(default = "up")]
    pub up: Array3,
    pub field_of_view: Option<f32>,
    pub orthographic: Option<f32>,
    #[serde(default)]
    pub lens_radius: f32,
    pub focus: Option<f32>,
}

pub(super) type Array3 = [f32; 3];

fn up() -> Array3 {
    [0.0, 1.0, 0.0]
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct EnvironmentTable {
    pub radiance: Option<Color>,
    pub file: Option<PathBuf>,
    #[serde(default)]
    pub rotation: f32,
}

#[derive(Deserialize)]
#[serde(tag = "kind", deny_unknown_fields, rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub(super) enum LightTable {
    Directional {
        direction: Array3,
        irradiance: Color,
        #[serde(default)]
        radius: f32,
    },
    Point {
        position: Array3,
        intensity: Color,
    },
    Spot {
        position: Array3,
        target: Array3,
        intensity: Color,
        angle: f32,
        #[serde(default)]
        edge: f32,
        #[serde(default)]
        falloff: f32,
    },
    Rectangle {
        centre: Array3,
        x: Array3,
        y: Array3,
        radiance: Color,
        texture: Option<PathBuf>,
    },
    Disk {
        centre: Array3,
        x: Array3,
        y: Array3,
        radiance: Color,
        texture: Option<PathBuf>,
    },
    Sphere {
        centre: Array3,
        radius: f32,
        radiance: Color,
        texture: Option<PathBuf>,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct MaterialFile {
    pub file: PathBuf,
    pub interpolation: Option<String>,
    pub blending: Option<String>,
    pub memory: Option<String>,
}

/// The fields that all shapes have.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct CommonFields {
    pub material: String,
    #[serde(default)]
    pub transform: Vec<Step>,
    #[serde(default = "one")]
    pub uv_scale: f32,
    #[serde(default)]
    pub uv_rotation: f32,
    pub mapping: Option<MappingTable>,
    #[serde(default)]
    pub wrap: WrapName,
    #[serde(default = "once")]
    pub texture_samples: u32,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(tag = "kind", deny_unknown_fields, rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub(super) enum MappingTable {
    Sphere {
        centre: Array3,
        #[serde(default = "up")]
        axis: Array3,
    },
    Cylinder {
        centre: Array3,
        axis: Array3,
    },
    Plane {
        origin: Array3,
        u: Array3,
        v: Array3,
    },
    Camera {
        position: Array3,
        target: Array3,
        #[serde(default = "up")]
        up: Array3,
        field_of_view: f32,
    },
    Triplanar {
        #[serde(default)]
        origin: Array3,
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
pub(super) enum WrapName {
    #[default]
    Repeat,
    Mirror,
    Clamp,
    Black,
}

impl From<WrapName> for Wrap {
    fn from(word: WrapName) -> Self {
        match word {
            WrapName::Repeat => Self::Repeat,
            WrapName::Mirror => Self::Mirror,
            WrapName::Clamp => Self::Clamp,
            WrapName::Black => Self::Black,
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
    Translate(Array3),
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
        from: Array3,
        to: Array3,
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
        corners: [Array3; 4],
    },
    Polygon {
        points: Vec<Array3>,
        #[serde(default)]
        holes: Vec<Vec<Array3>>,
    },
    Patch {
        points: Vec<Array3>,
        #[serde(default = "bezier")]
        basis: String,
    },
    Object {
        name: String,
    },
    Mesh {
        file: PathBuf,
        crease: Option<f32>,
    },
    Subdivision {
        file: PathBuf,
        levels: Option<u32>,
    },
}

fn bezier() -> String {
    "bezier".into()
}

/// A colour; an error if a channel is negative or not finite.
pub(super) fn non_negative(name: &str, color: Color) -> Result<Vec3> {
    let color = Vec3::from(color);
    if color.is_finite() && color.min_element() >= 0.0 {
        return Ok(color);
    }
    Err(Error::parameter(name, format!("found {color}, expected finite values of at least 0")))
}

impl CameraTable {
    pub fn camera(&self) -> Result<Camera> {
        let projection = match (self.field_of_view, self.orthographic) {
            (field, None) => Projection::Perspective { field_of_view_degrees: field.unwrap_or(30.0) },
            (None, Some(height)) => Projection::Orthographic { height },
            _ => return Err(Error::parameter("camera", "expected field-of-view or orthographic, found both")),
        };
        let (position, target) = (Vec3::from(self.position), Vec3::from(self.target));
        let focus = self.focus.unwrap_or(position.distance(target));
        let lens = if self.lens_radius == 0.0 { Lens::PINHOLE } else { Lens { radius: self.lens_radius, focus } };
        Ok(Camera { position, target, up: self.up.into(), projection, lens, window: None })
    }
}

impl LightTable {
    /// The picture that an area light shows.
    pub fn texture(&self) -> Option<&Path> {
        match self {
            Self::Rectangle { texture, .. } | Self::Disk { texture, .. } | Self::Sphere { texture, .. } => {
                texture.as_deref()
            }
            _ => None,
        }
    }

    pub fn light(&self) -> Result<Light> {
        let unit = |name: &str, v: Vec3| {
            v.try_normalize().ok_or_else(|| Error::parameter(name, format!("found {v}, which has no direction")))
        };
        Ok(match *self {
            Self::Directional { direction, irradiance, radius } => DirectionalLight {
                direction: unit("direction", direction.into())?,
                irradiance: non_negative("irradiance", irradiance)?,
                radius_degrees: in_range("radius", radius, 0.0, 89.0)?,
            }
            .into(),
            Self::Point { position, intensity } => {
                Light::Point(PointLight { position: position.into(), intensity: non_negative("intensity", intensity)? })
            }
            Self::Spot { position, target, intensity, angle, edge, falloff } => Light::Spot(SpotLight {
                position: position.into(),
                axis: unit("target", Vec3::from(target) - Vec3::from(position))?,
                intensity: non_negative("intensity", intensity)?,
                angle_degrees: in_range("angle", angle, 0.0, 180.0)?,
                edge_degrees: in_range("edge", edge, 0.0, angle)?,
                falloff: in_range("falloff", falloff, 0.0, 1e6)?,
            }),
            Self::Rectangle { centre, x, y, radiance, .. } => area(Emitter::Rectangle(flat(centre, x, y)?), radiance)?,
            Self::Disk { centre, x, y, radiance, .. } => area(Emitter::Disk(flat(centre, x, y)?), radiance)?,
            Self::Sphere { centre, radius, radiance, .. } => {
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

fn flat(centre: Array3, x: Array3, y: Array3) -> Result<Flat> {
    let flat = Flat { centre: centre.into(), x: x.into(), y: y.into() };
    if flat.x.cross(flat.y).length_squared().is_normal() {
        return Ok(flat);
    }
    Err(Error::parameter("x", format!("found x = {} and y = {}, which span no area", flat.x, flat.y)))
}

fn area(shape: Emitter, radiance: Color) -> Result<Light> {
    Ok(Light::Area(AreaLight::new(shape, non_negative("radiance", radiance)?)))
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
    /// The quadric of this table; `None` for other shapes.
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
