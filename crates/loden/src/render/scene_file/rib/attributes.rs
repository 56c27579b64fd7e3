//! Requests that set what shapes to come look like: colour, surface, sides, lights.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec2, Vec3};

use super::request::{self, Checked, Parameters, Request};
use super::shader::{self, Source};
use super::surface::{CORNERS, Corners};
use super::{Reader, triple, wearing};
use crate::direction::Scheme;
use crate::material::Material;
use crate::render::geometry::Basis;
use crate::render::scene_file::Named;
use crate::render::{Environment, TextureMap};

/// What AttributeBegin saves.
#[derive(Clone)]
pub(super) struct Attributes {
    pub color: Vec3,
    pub surface: Surface,
    pub corners: Corners,
    pub bases: [Basis; 2],
    pub inside_out: Outside,
    /// The radiance of area lights to come.
    pub shining: Option<Vec3>,
}

/// A surface shader with its parameters and the line it stands on.
#[derive(Clone)]
pub(super) struct Surface {
    pub name: String,
    pub parameters: Parameters,
    pub line: usize,
    pub folder: PathBuf,
    /// From the coordinates it was named in.
    pub world_from_surface: Mat4,
}

/// Which side of a surface is the outside.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Outside {
    Same,
    Other,
    /// That of a left-handed system.
    Left,
    Right,
}

impl Default for Attributes {
    fn default() -> Self {
        let surface = Surface {
            name: "matte".into(),
            parameters: Parameters::default(),
            line: 0,
            folder: PathBuf::new(),
            world_from_surface: Mat4::IDENTITY,
        };
        Self {
            color: Vec3::ONE,
            surface,
            corners: CORNERS,
            bases: [Basis::BEZIER; 2],
            inside_out: Outside::Same,
            shining: None,
        }
    }
}

impl Reader {
    /// Whether the request was an attribute, which then is set.
    pub(super) fn attribute(&mut self, request: &Request, path: &Path) -> Checked<bool> {
        if self.object.is_some() && matches!(request.name.as_str(), "Color" | "Surface") {
            // an object has the attributes of the place where it is instanced
            self.leave_out(format!("{} within ObjectBegin", request.name), request.line, path);
            return Ok(true);
        }
        match request.name.as_str() {
            "Color" => self.attributes.color = triple(request)?,
            "Surface" => {
                let parameters = request.parameters(1, &self.declared)?;
                let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
                let name = request.text(0)?.to_owned();
                self.attributes.surface =
                    Surface { name, parameters, line: request.line, folder, world_from_surface: self.placed() };
            }
            "Orientation" => {
                self.attributes.inside_out = match request.text(0)? {
                    "outside" => Outside::Same,
                    "inside" => Outside::Other,
                    "lh" => Outside::Left,
                    "rh" => Outside::Right,
                    other => return Err(format!("found {other:?}, expected outside, inside, lh or rh")),
                }
            }
            "ReverseOrientation" => {
                self.attributes.inside_out = match self.attributes.inside_out {
                    Outside::Same => Outside::Other,
                    Outside::Other => Outside::Same,
                    Outside::Left => Outside::Right,
                    Outside::Right => Outside::Left,
                }
            }
            "Sides" => {
                if request.numbers(1)?.0[0] != 2.0 {
                    self.leave_out("Sides 1 (surfaces are seen from both sides)".into(), request.line, path);
                }
            }
            "TextureCoordinates" => {
                let (n, _) = request.numbers(8)?;
                self.attributes.corners = std::array::from_fn(|k| Vec2::new(n[2 * k], n[2 * k + 1]));
            }
            "Basis" => self.attributes.bases = bases(request)?,
            "LightSource" | "AreaLightSource" => {
                let parameters = request.parameters(2, &self.declared)?;
                let name = request.text(0)?;
                if request.name == "AreaLightSource" {
                    let radiance = parameters.number("intensity", 1.0) * parameters.triple("lightcolor", Vec3::ONE);
                    if !radiance.is_finite() || radiance.min_element() < 0.0 {
                        return Err(format!("intensity times lightcolor is {radiance}"));
                    }
                    self.attributes.shining = Some(radiance).filter(|_| name != "null");
                    return Ok(true);
                }
                match shader::light(name, &parameters, self.placed())? {
                    Some(Source::Light(light)) => self.scene.lights.push(light),
                    Some(Source::Ambient(radiance)) => {
                        let before = self.scene.environment.radiance(Vec3::Y);
                        self.scene.environment = Environment::Constant(before + radiance);
                    }
                    None => self.leave_out(format!("LightSource {name:?}"), request.line, path),
                }
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Whether a surface's outside is not where its own orientation says.
    pub(super) fn is_inside_out(&self) -> bool {
        let left = self.transform.determinant() > 0.0;
        match self.attributes.inside_out {
            Outside::Same => false,
            Outside::Other => true,
            Outside::Left => !left,
            Outside::Right => left,
        }
    }

    /// The material of the current surface and colour.
    pub(super) fn material(&mut self, path: &Path) -> Checked<(usize, TextureMap)> {
        let Surface { name, parameters, line, folder, world_from_surface } = self.attributes.surface.clone();
        let color = self.attributes.color;
        // only a mapping depends on the coordinates
        let place = parameters.get("mapping").map(|_| world_from_surface);
        let key = format!("{name} {parameters:?} {color} {} {place:?}", folder.display());
        if let Some(found) = self.materials.get(&key) {
            return Ok(*found);
        }
        let mut texture = TextureMap::default();
        let (name, material): (String, Arc<dyn Material>) = if name == "loden" {
            let file = parameters.text("material").ok_or("Surface \"loden\" has no \"string material\"")?;
            texture = wearing::texture_map(&parameters, world_from_surface)?;
            let scheme = match parameters.text("interpolation") {
                None | Some("triangles") => Scheme::Triangles,
                Some("rings") => Scheme::Rings,
                Some(other) => return Err(format!("interpolation: found {other:?}, expected triangles or rings")),
            };
            let file = self.find(file, &folder);
            let material = self.scene.open_material(&file, scheme, None).map_err(|e| e.to_string())?;
            (file.display().to_string(), material)
        } else {
            let made = match shader::surface(&name, &parameters, color)? {
                Some(made) => made,
                None => {
                    self.leave_out(format!("Surface {name:?} (drawn as matte)"), line, path);
                    let matte = shader::surface("matte", &Parameters::default(), color)?;
                    matte.ok_or("there is no matte")?
                }
            };
            (name, Arc::new(made))
        };
        let found = (self.scene.materials.len(), texture);
        self.scene.materials.push(Named { name, material });
        self.materials.insert(key, found);
        Ok(found)
    }
}

/// Two bases with their steps; a basis is a name or 16 numbers.
fn bases(request: &Request) -> Checked<[Basis; 2]> {
    use request::Argument::{Number, Numbers, Text};
    let one = |at: usize| match (request.arguments.get(at), request.arguments.get(at + 1)) {
        (Some(basis), Some(Number(step))) if *step >= 1.0 && *step <= 4.0 => {
            let mut basis = match basis {
                Text(name) => Basis::named(name).ok_or_else(|| format!("there is no basis {name:?}"))?,
                Numbers(rows) => {
                    let rows = <[f32; 16]>::try_from(&rows[..]).map_err(|_| "a basis has 16 numbers".to_owned())?;
                    Basis::new(rows, 1)
                }
                other => return Err(format!("found {other:?}, expected a basis")),
            };
            basis.step = *step as usize;
            Ok(basis)
        }
        _ => Err("expected a basis and its step, twice".into()),
    };
    Ok([one(0)?, one(2)?])
}
