//! Attribute requests: colour, surface, orientation, texture coordinates, lights.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec2, Vec3};

use super::bxdf::Patterns;
use super::condition::{Value, Variables};
use super::detail::Detail;
use super::lights::{self, Decay, Source};
use super::meshes::{CORNERS, Corners};
use super::request::{self, Parameters, Request, RibResult, Step};
use super::{Reader, triple};
use crate::picture::Picture;
use crate::render::geometry::Basis;
use crate::render::{Environment, EnvironmentMap, Light};

/// The current attributes, which `AttributeBegin` saves.
#[derive(Clone)]
pub(super) struct Attributes {
    pub color: Vec3,
    pub opacity: Vec3,
    pub surface: Surface,
    pub corners: Corners,
    pub bases: [Basis; 2],
    pub orientation: Orientation,
    /// Radiance of the shapes that follow, if they are lights.
    pub emitted: Option<Vec3>,
    /// Whether the lights that follow cast shadows, if an attribute says so.
    pub shadows: Option<bool>,
    /// Whether the camera sees the shapes that follow.
    pub visible: bool,
    pub patterns: Patterns,
    /// Attributes that conditions may ask for.
    pub variables: Variables,
    pub detail: Detail,
}

/// A surface shader with its parameters, its line, and the folder of its file.
#[derive(Clone)]
pub(super) struct Surface {
    pub interface: Interface,
    pub name: String,
    pub parameters: Parameters,
    pub line: usize,
    pub file: PathBuf,
    /// Transform that was current at the request.
    pub world_from_surface: Mat4,
}

/// How a surface was given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Interface {
    /// Not at all.
    Default,
    /// By `Surface`.
    Shader,
    /// By `Bxdf`.
    Bxdf,
}

/// The side of a surface that counts as its outside.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Orientation {
    Outside,
    Inside,
    /// The outside of a left-handed coordinate system.
    LeftHanded,
    RightHanded,
}

impl Orientation {
    fn parse(name: &str) -> RibResult<Self> {
        Ok(match name {
            "outside" => Self::Outside,
            "inside" => Self::Inside,
            "lh" => Self::LeftHanded,
            "rh" => Self::RightHanded,
            other => return Err(format!("found {other:?}, expected outside, inside, lh or rh")),
        })
    }

    fn reversed(self) -> Self {
        match self {
            Self::Outside => Self::Inside,
            Self::Inside => Self::Outside,
            Self::LeftHanded => Self::RightHanded,
            Self::RightHanded => Self::LeftHanded,
        }
    }
}

impl Default for Attributes {
    fn default() -> Self {
        let surface = Surface {
            interface: Interface::Default,
            name: "defaultsurface".into(),
            parameters: Parameters::default(),
            line: 0,
            file: PathBuf::new(),
            world_from_surface: Mat4::IDENTITY,
        };
        Self {
            color: Vec3::ONE,
            opacity: Vec3::ONE,
            surface,
            corners: CORNERS,
            bases: [Basis::BEZIER; 2],
            orientation: Orientation::Outside,
            emitted: None,
            shadows: None,
            visible: true,
            patterns: Patterns::default(),
            variables: Variables::default(),
            detail: Detail::default(),
        }
    }
}

impl Reader {
    /// Executes an attribute request; `false` if the request is not an attribute.
    pub(super) fn attribute(&mut self, request: &Request, path: &Path) -> Step<bool> {
        if self.object.is_some() && matches!(request.name.as_str(), "Color" | "Opacity" | "Surface" | "Bxdf") {
            // An instance takes the attributes that are current where it is placed.
            self.ignore(format!("{} within ObjectBegin", request.name), request.line, path);
            return Ok(true);
        }
        match request.name.as_str() {
            "Color" => self.attributes.color = triple(request)?,
            "Opacity" => self.attributes.opacity = triple(request)?.clamp(Vec3::ZERO, Vec3::ONE),
            "Surface" => self.set_surface(Interface::Shader, 1, request, path)?,
            "Bxdf" => self.set_surface(Interface::Bxdf, 2, request, path)?,
            "Pattern" => {
                let parameters = request.parameters(2, &self.declared)?;
                Arc::make_mut(&mut self.attributes.patterns).insert(request.handle(1)?, parameters);
            }
            "Orientation" => self.attributes.orientation = Orientation::parse(request.text(0)?)?,
            "ReverseOrientation" => self.attributes.orientation = self.attributes.orientation.reversed(),
            "Sides" => {
                if request.numbers(1)?.0[0] != 2.0 {
                    self.ignore("Sides 1 (surfaces are seen from both sides)".into(), request.line, path);
                }
            }
            "TextureCoordinates" => {
                let (n, _) = request.numbers(8)?;
                self.attributes.corners = std::array::from_fn(|k| Vec2::new(n[2 * k], n[2 * k + 1]));
            }
            "Basis" => self.attributes.bases = bases(request)?,
            "Attribute" => self.named_attribute(request, path)?,
            "Detail" => self.detail(request)?,
            "DetailRange" => self.detail_range(request)?,
            "LightSource" => self.light_source(request, path)?,
            "Light" => self.newer_light(request, path)?,
            "AreaLightSource" => self.area_light_source(request, path)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn set_surface(&mut self, interface: Interface, list: usize, request: &Request, path: &Path) -> RibResult<()> {
        let parameters = request.parameters(list, &self.declared)?;
        let (name, world_from_surface) = (request.text(0)?.to_owned(), self.world_from_current());
        let (line, file) = (request.line, path.into());
        self.attributes.surface = Surface { interface, name, parameters, line, file, world_from_surface };
        Ok(())
    }

    fn named_attribute(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        let kind = request.text(0)?;
        let parameters = request.parameters(1, &self.declared)?;
        for parameter in &parameters.0 {
            let name = format!("{kind}:{}", parameter.name);
            let value = match (parameter.numbers.first(), parameter.texts.first()) {
                (Some(&number), _) => Value::Number(number.into()),
                (None, Some(text)) => Value::Text(text.clone()),
                (None, None) => continue,
            };
            match (name.as_str(), &value) {
                ("light:shadows", value) => {
                    self.attributes.shadows = Some(*value == Value::Text("on".into()) || *value == Value::Number(1.0));
                }
                ("visibility:camera", value) => self.attributes.visible = value.is_true(),
                _ if matches!(kind, "identifier" | "user") => {}
                _ => self.ignore(format!("Attribute {kind:?}"), request.line, path),
            }
            Arc::make_mut(&mut self.attributes.variables).insert(name, value);
        }
        Ok(())
    }

    fn light_source(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        let parameters = request.parameters(2, &self.declared)?;
        let name = request.text(0)?;
        if let Some(source) = lights::newer(name, &parameters, self.world_from_current())? {
            self.shine(source, request, path);
            return Ok(());
        }
        let (source, nearest) = lights::classic(name, &parameters, self.world_from_current())?;
        if let Some(nearest) = nearest {
            self.note(format!("LightSource {name:?} is unknown: {nearest} is used"), request.line, path);
        }
        self.shine(source, request, path);
        Ok(())
    }

    fn newer_light(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        let parameters = request.parameters(2, &self.declared)?;
        let name = request.text(0)?;
        match lights::newer(name, &parameters, self.world_from_current())? {
            Some(source) => self.shine(source, request, path),
            None => self.ignore(format!("Light {name:?}"), request.line, path),
        }
        Ok(())
    }

    fn shine(&mut self, source: Source, request: &Request, path: &Path) {
        match source {
            Source::Ambient(radiance) => self.ambient += radiance,
            Source::Sky(radiance, None) => self.add_sky(radiance),
            Source::Sky(radiance, Some(name)) => match self.sky_of(&name, radiance, path) {
                Ok(map) => self.scene.environment = Environment::Map(Box::new(map)),
                Err(problem) => {
                    self.note(format!("the picture of the light: {problem}; it is even"), request.line, path);
                    self.add_sky(radiance);
                }
            },
            Source::Light { light, decay, shadows } => {
                let shadows = self.attributes.shadows.unwrap_or(false) || shadows || self.all_shadows;
                if decay == Decay::None {
                    let what = "a light without decay (it is as bright at the middle of the scene)";
                    self.note(what.into(), request.line, path);
                }
                if decay != Decay::Square {
                    self.even_lights.push((self.scene.lights.len(), decay));
                }
                let shadowless = !shadows && !matches!(light, Light::Area(_));
                self.scene.lights.push(if shadowless { Light::Shadowless(Box::new(light)) } else { light });
            }
            Source::Shapes(radiance) => self.attributes.emitted = Some(radiance),
            Source::Off => {}
        }
    }

    pub(super) fn add_sky(&mut self, radiance: Vec3) {
        if let Environment::Map(_) = self.scene.environment {
            return self.ambient += radiance;
        }
        let before = self.scene.environment.radiance(Vec3::Y);
        self.scene.environment = Environment::Constant(before + radiance);
    }

    /// The environment of a latitude-longitude picture around the z axis of the current coordinates, whose middle
    /// column is towards +x.
    fn sky_of(&mut self, name: &str, radiance: Vec3, path: &Path) -> Result<EnvironmentMap, String> {
        let file = self.find_picture(name, path).ok_or_else(|| format!("{name:?} is missing"))?;
        let picture = Picture::read(&file, &mut self.scene.warnings).map_err(|e| e.to_string())?;
        let (width, height) = (picture.width.min(1024), picture.height.min(512));
        let local_from_world = self.world_from_current().inverse();
        let color = |k: usize| {
            let place = Vec2::new((k % width) as f32 + 0.5, (k / width) as f32 + 0.5);
            let uv = place / Vec2::new(width as f32, height as f32);
            let (phi, theta) = (std::f32::consts::TAU * (uv.x - 0.5), std::f32::consts::PI * uv.y);
            let world = Vec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
            let d = local_from_world.transform_vector3(world).normalize_or(Vec3::Z);
            let u = 0.5 - d.y.atan2(d.x) / std::f32::consts::TAU;
            let v = d.truncate().length().atan2(d.z) / std::f32::consts::PI;
            let x = ((u * picture.width as f32) as usize).min(picture.width - 1);
            let y = ((v * picture.height as f32) as usize).min(picture.height - 1);
            picture.at(x, y).max(Vec3::ZERO) * radiance
        };
        let rgb = (0..width * height).map(color).collect();
        EnvironmentMap::new(Picture { width, height, rgb }, 0.0).map_err(|e| e.to_string())
    }

    fn area_light_source(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        let parameters = request.parameters(2, &self.declared)?;
        match request.text(0)? {
            "null" => self.attributes.emitted = None,
            name @ "PxrStdEnvMapLight" => {
                if let Some(source) = lights::newer(name, &parameters, self.world_from_current())? {
                    self.shine(source, request, path);
                }
            }
            _ => self.attributes.emitted = Some(lights::emitted(&parameters)?),
        }
        Ok(())
    }

    /// Whether shapes are to be turned inside out.
    pub(super) fn is_inside_out(&self) -> bool {
        let left = self.transform.determinant() > 0.0;
        match self.attributes.orientation {
            Orientation::Outside => false,
            Orientation::Inside => true,
            Orientation::LeftHanded => !left,
            Orientation::RightHanded => left,
        }
    }
}

/// The bases along u and v with their steps. A basis is a name or 16 numbers.
fn bases(request: &Request) -> RibResult<[Basis; 2]> {
    use request::Argument::{Number, Numbers, Text};
    let one = |at: usize| match (request.arguments.get(at), request.arguments.get(at + 1)) {
        (Some(basis), Some(Number(step))) if *step >= 1.0 && *step <= 4.0 => {
            let mut basis = match basis {
                Text(name) => Basis::by_name(name).map_err(|e| e.to_string())?,
                Numbers(rows) => {
                    let rows = <[f32; 16]>::try_from(&rows[..]).map_err(|_| "a basis has 16 numbers".to_owned())?;
                    Basis::new(rows, 1)
                }
                other => return Err(format!("found {other:?}, expected a basis name or 16 numbers")),
            };
            basis.step = *step as usize;
            Ok(basis)
        }
        _ => Err("expected two bases, each with a step of 1 to 4".into()),
    };
    Ok([one(0)?, one(2)?])
}
