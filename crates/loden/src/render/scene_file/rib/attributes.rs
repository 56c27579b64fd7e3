//! Attribute requests: colour, surface, orientation, texture coordinates, lights.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec2, Vec3};

use super::meshes::{CORNERS, Corners};
use super::request::{self, Parameters, Request, RibResult};
use super::shader::{self, Source};
use super::{Reader, texture_map, triple};
use crate::direction::Scheme;
use crate::material::Material;
use crate::render::geometry::Basis;
use crate::render::scene_file::SceneMaterial;
use crate::render::{Environment, TextureMap};

/// The current attributes, which `AttributeBegin` saves.
#[derive(Clone)]
pub(super) struct Attributes {
    pub color: Vec3,
    pub surface: Surface,
    pub corners: Corners,
    pub bases: [Basis; 2],
    pub orientation: Orientation,
    /// Radiance of the shapes that follow, if they are area lights.
    pub area_light_radiance: Option<Vec3>,
}

/// A surface shader with its parameters, its line, and the folder of its file.
#[derive(Clone)]
pub(super) struct Surface {
    pub name: String,
    pub parameters: Parameters,
    pub line: usize,
    pub folder: PathBuf,
    /// Transform that was current at the `Surface` request.
    pub world_from_surface: Mat4,
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
            orientation: Orientation::Outside,
            area_light_radiance: None,
        }
    }
}

impl Reader {
    /// Executes an attribute request; `false` if the request is not an attribute.
    pub(super) fn attribute(&mut self, request: &Request, path: &Path) -> RibResult<bool> {
        if self.object.is_some() && matches!(request.name.as_str(), "Color" | "Surface") {
            // An instance takes the attributes that are current where it is placed.
            self.ignore(format!("{} within ObjectBegin", request.name), request.line, path);
            return Ok(true);
        }
        match request.name.as_str() {
            "Color" => self.attributes.color = triple(request)?,
            "Surface" => {
                let parameters = request.parameters(1, &self.declared)?;
                let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
                let (name, world_from_surface) = (request.text(0)?.to_owned(), self.world_from_current());
                self.attributes.surface = Surface { name, parameters, line: request.line, folder, world_from_surface };
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
            "LightSource" => self.light_source(request, path)?,
            "AreaLightSource" => self.attributes.area_light_radiance = self.area_light_source(request)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn light_source(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        let parameters = request.parameters(2, &self.declared)?;
        let name = request.text(0)?;
        match shader::light(name, &parameters, self.world_from_current())? {
            Some(Source::Light(light)) => self.scene.lights.push(light),
            Some(Source::Ambient(radiance)) => {
                let before = self.scene.environment.radiance(Vec3::Y);
                self.scene.environment = Environment::Constant(before + radiance);
            }
            None => self.ignore(format!("LightSource {name:?}"), request.line, path),
        }
        Ok(())
    }

    /// The radiance of the shapes that follow; `None` if they are not lights.
    fn area_light_source(&self, request: &Request) -> RibResult<Option<Vec3>> {
        let parameters = request.parameters(2, &self.declared)?;
        let name = request.text(0)?;
        let radiance = shader::emitted(&parameters)?;
        Ok(Some(radiance).filter(|_| name != "null"))
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

    /// The index of the material for the current surface and colour, and its texture map.
    pub(super) fn material(&mut self, path: &Path) -> RibResult<(usize, TextureMap)> {
        let Surface { name, parameters, line, folder, world_from_surface } = self.attributes.surface.clone();
        let color = self.attributes.color;
        // Only a mapping depends on the coordinates of the surface.
        let coordinates = parameters.get("mapping").map(|_| world_from_surface);
        let key = format!("{name} {parameters:?} {color} {} {coordinates:?}", folder.display());
        if let Some(found) = self.materials.get(&key) {
            return Ok(*found);
        }
        let mut texture = TextureMap::default();
        let (name, material): (String, Arc<dyn Material>) = if name == "loden" {
            let file = parameters.text("material").ok_or("Surface \"loden\" has no \"string material\"")?;
            texture = texture_map::texture_map(&parameters, world_from_surface)?;
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
                    self.ignore(format!("Surface {name:?} (matte is used)"), line, path);
                    let matte = shader::surface("matte", &Parameters::default(), color)?;
                    matte.ok_or("the surface \"matte\" is missing")?
                }
            };
            (name, Arc::new(made))
        };
        let found = (self.scene.materials.len(), texture);
        self.scene.materials.push(SceneMaterial { name, material });
        self.materials.insert(key, found);
        Ok(found)
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
