//! RenderMan Interface Bytestream files.
//!
//! # Model
//! The interface's camera looks along +z of a left-handed system with x to the right and y up. We look along -z of a
//! right-handed one: our world is the camera's system with z turned around, so a world of any handedness keeps its
//! look, and the outside of a surface stays outside. Texture coordinate t runs down, our v up.
//!
//! # Limits
//! The file docs/scenes.md lists what is understood. Everything else is said once, with its first line.
//!
//! # References
//! pixar2000

mod emitter;
mod lexer;
mod request;
mod shader;
mod surface;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::read::MultiGzDecoder;
use glam::{Mat4, Vec3};

use self::request::{Checked, Class, Declarations, Parameters, Request, Requests};
use self::shader::Source;
use self::surface::{CORNERS, Corners};
use super::{Meshes, Named, SceneFile, check_texture};
use crate::direction::Scheme;
use crate::material::Material;
use crate::render::geometry::{self, Basis, Quadric};
use crate::render::{AreaLight, Camera, Emitter, Environment, Lens, Light, Mesh, MeshData, Projection, TextureMap};
use crate::{Error, Result};

/// The largest file, uncompressed.
const MAX_BYTES: u64 = 1 << 30;
/// Archives within archives.
const MAX_DEPTH: usize = 32;
/// Requests in all archives together; archives that read each other double.
const MAX_REQUESTS: usize = 1 << 24;
/// Blocks within blocks.
const MAX_BLOCKS: usize = 1 << 12;

/// Reads a scene with its archives.
pub(super) fn read(path: &Path) -> Result<SceneFile> {
    let mut reader = Reader::new();
    reader.file(path, 0)?;
    reader.finish(path)
}

/// From the interface's left-handed camera to our world.
fn world_from_camera() -> Mat4 {
    Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0))
}

/// What AttributeBegin saves.
#[derive(Clone)]
struct Attributes {
    color: Vec3,
    surface: Surface,
    corners: Corners,
    bases: [Basis; 2],
    inside_out: Outside,
    /// The radiance of area lights to come.
    shining: Option<Vec3>,
}

/// A surface shader with its parameters and the line it stands on.
#[derive(Clone)]
struct Surface {
    name: String,
    parameters: Parameters,
    line: usize,
    folder: PathBuf,
}

/// Which side of a surface is the outside.
#[derive(Clone, Copy, PartialEq)]
enum Outside {
    Same,
    Other,
    /// That of a left-handed system.
    Left,
    Right,
}

/// What a block that ends restores.
struct Block {
    kind: &'static str,
    transform: Mat4,
    attributes: Option<Attributes>,
    line: usize,
}

struct Reader {
    scene: SceneFile,
    meshes: Meshes,
    declared: Declarations,
    attributes: Attributes,
    /// From the current coordinates to the camera's.
    transform: Mat4,
    camera_from_world: Mat4,
    named_transforms: HashMap<String, Mat4>,
    blocks: Vec<Block>,
    objects: HashMap<String, Vec<(Arc<Mesh>, Mat4)>>,
    /// The object being defined, with the transform where it began.
    object: Option<(String, Vec<(Arc<Mesh>, Mat4)>, Mat4)>,
    materials: HashMap<String, (usize, TextureMap)>,
    search: Vec<PathBuf>,
    /// What was left out: (file and line of the first, how often), by what it was.
    left_out: BTreeMap<String, (String, usize)>,
    requests: usize,
    pixel_aspect: f32,
    frame_aspect: Option<f32>,
    /// A request that skips everything to its end: the end's name.
    skipping: Option<&'static str>,
    in_motion: Option<bool>,
    ended: bool,
}

/// Requests that change nothing here, for reasons the documentation gives.
const WITHOUT_EFFECT: &[&str] = &["version"];

impl Reader {
    fn new() -> Self {
        // the interface's own defaults: a parallel projection of -1..1
        let camera = Camera {
            projection: Projection::Orthographic { height: 2.0 },
            ..Camera::pinhole(Vec3::ZERO, -Vec3::Z, 90.0)
        };
        let surface =
            Surface { name: "matte".into(), parameters: Parameters::default(), line: 0, folder: PathBuf::new() };
        let mut scene = SceneFile::empty(camera);
        scene.background = Some(Vec3::ZERO);
        Self {
            scene,
            meshes: Meshes::default(),
            declared: Declarations::default(),
            attributes: Attributes {
                color: Vec3::ONE,
                surface,
                corners: CORNERS,
                bases: [Basis::BEZIER; 2],
                inside_out: Outside::Same,
                shining: None,
            },
            transform: Mat4::IDENTITY,
            camera_from_world: Mat4::IDENTITY,
            named_transforms: HashMap::new(),
            blocks: Vec::new(),
            objects: HashMap::new(),
            object: None,
            materials: HashMap::new(),
            search: Vec::new(),
            left_out: BTreeMap::new(),
            requests: 0,
            pixel_aspect: 1.0,
            frame_aspect: None,
            skipping: None,
            in_motion: None,
            ended: false,
        }
    }

    fn file(&mut self, path: &Path, depth: usize) -> Result<()> {
        let mut requests = Requests::new(load(path)?);
        let invalid = |line: usize, what: &str, problem: String| {
            Error::invalid(
                path,
                if what.is_empty() { format!("line {line}") } else { format!("line {line}: {what}") },
                problem,
            )
        };
        while !self.ended {
            let request = requests.next().map_err(|problem| invalid(requests.line(), "", problem))?;
            let Some(request) = request else { break };
            self.requests += 1;
            if self.requests > MAX_REQUESTS {
                let field = format!("line {}: number of requests, archives included", request.line);
                return Err(Error::Limit {
                    path: path.into(),
                    field,
                    found: self.requests as u64,
                    limit: MAX_REQUESTS as u64,
                });
            }
            match request.name.as_str() {
                "ReadArchive" | "Procedural" if self.skipping.is_none() => {
                    let archive = self.archive(&request, path).map_err(|p| invalid(request.line, &request.name, p))?;
                    let Some(archive) = archive else { continue };
                    if depth >= MAX_DEPTH {
                        let problem = format!("archives are read within archives more than {MAX_DEPTH} deep");
                        return Err(invalid(request.line, &request.name, problem));
                    }
                    self.file(&archive, depth + 1)?;
                }
                _ => self.request(&request, path).map_err(|problem| invalid(request.line, &request.name, problem))?,
            }
        }
        Ok(())
    }

    /// The file that a request reads, if it can be read; to leave a missing one out would not be the scene.
    fn archive(&mut self, request: &Request, path: &Path) -> Checked<Option<PathBuf>> {
        let mut name = request.text(0)?;
        if request.name == "Procedural" {
            if name != "DelayedReadArchive" {
                self.leave_out(format!("Procedural {name:?}"), request.line, path);
                return Ok(None);
            }
            name = match request.arguments.get(1) {
                Some(request::Argument::Texts(names)) if !names.is_empty() => &names[0],
                _ => request.text(1)?,
            };
        }
        Ok(Some(self.find(name, path.parent().unwrap_or(Path::new("")))))
    }

    /// A file beside the one that names it, or in the search path.
    fn find(&self, name: &str, folder: &Path) -> PathBuf {
        let beside = folder.join(name);
        let others = self.search.iter().map(|other| folder.join(other).join(name));
        std::iter::once(beside.clone()).chain(others).find(|path| path.exists()).unwrap_or(beside)
    }

    fn leave_out(&mut self, what: String, line: usize, path: &Path) {
        self.left_out.entry(what).or_insert_with(|| (format!("{}: line {line}", path.display()), 0)).1 += 1;
    }

    /// The transform from the current coordinates to our world.
    fn placed(&self) -> Mat4 {
        world_from_camera() * self.transform
    }

    fn request(&mut self, request: &Request, path: &Path) -> Checked<()> {
        if let Some(end) = self.skipping {
            if request.name == end {
                self.skipping = None;
            }
            return Ok(());
        }
        // of a motion block the first time alone is taken
        if let Some(seen) = &mut self.in_motion {
            if request.name == "MotionEnd" {
                self.in_motion = None;
                return Ok(());
            }
            if std::mem::replace(seen, true) {
                return Ok(());
            }
        }
        if self.transform_request(request)? || self.option(request, path)? || self.attribute(request, path)? {
            return Ok(());
        }
        if self.block(request, path)? || self.geometry(request, path)? {
            return Ok(());
        }
        if !WITHOUT_EFFECT.contains(&request.name.as_str()) {
            self.leave_out(request.name.clone(), request.line, path);
        }
        Ok(())
    }

    fn transform_request(&mut self, request: &Request) -> Checked<bool> {
        let change = match request.name.as_str() {
            "Translate" => Mat4::from_translation(triple(request)?),
            "Scale" => Mat4::from_scale(triple(request)?),
            "Rotate" => {
                let (n, _) = request.numbers(4)?;
                let axis = Vec3::from_slice(&n[1..]).try_normalize().ok_or("its axis has no direction")?;
                Mat4::from_axis_angle(axis, n[0].to_radians())
            }
            "ConcatTransform" => request.matrix()?,
            "Transform" => {
                self.transform = self.camera_from_world * request.matrix()?;
                return Ok(true);
            }
            "Identity" => {
                self.transform = self.camera_from_world;
                return Ok(true);
            }
            "CoordinateSystem" => {
                self.named_transforms.insert(request.handle(0)?, self.transform);
                return Ok(true);
            }
            "CoordSysTransform" => {
                let name = request.handle(0)?;
                self.transform = match name.as_str() {
                    "world" => self.camera_from_world,
                    "camera" => Mat4::IDENTITY,
                    _ => *self.named_transforms.get(&name).ok_or_else(|| format!("there is no system {name:?}"))?,
                };
                return Ok(true);
            }
            _ => return Ok(false),
        };
        self.transform *= change;
        Ok(true)
    }

    fn option(&mut self, request: &Request, path: &Path) -> Checked<bool> {
        match request.name.as_str() {
            "Format" => {
                let (n, _) = request.numbers(3)?;
                let side =
                    |v: f32| if v >= 1.0 && v <= 65_536.0 { Ok(v as usize) } else { Err(format!("a side is {v}")) };
                (self.scene.settings.width, self.scene.settings.height) = (side(n[0])?, side(n[1])?);
                self.pixel_aspect = if n[2] > 0.0 { n[2] } else { 1.0 };
            }
            "FrameAspectRatio" => {
                let aspect = request.numbers(1)?.0[0];
                if aspect <= 0.0 || !aspect.is_finite() {
                    return Err(format!("found {aspect}, expected more than 0"));
                }
                self.frame_aspect = Some(aspect);
            }
            "ScreenWindow" => {
                self.scene.camera.window = Some(request.numbers(4)?.0.try_into().map_err(|_| "four numbers")?)
            }
            "Projection" => {
                let parameters = request.parameters(1, &self.declared)?;
                self.scene.camera.projection = match request.text(0)? {
                    "perspective" => Projection::Perspective { field_of_view_degrees: parameters.number("fov", 90.0) },
                    "orthographic" => Projection::Orthographic { height: 2.0 },
                    other => return Err(format!("found {other:?}, expected perspective or orthographic")),
                };
                // from here on transforms place the camera
                self.transform = Mat4::IDENTITY;
            }
            "DepthOfField" => {
                if request.arguments.is_empty() {
                    self.scene.camera.lens = Lens::PINHOLE;
                    return Ok(true);
                }
                let (n, _) = request.numbers(3)?;
                let radius = 0.5 * n[1] / n[0];
                self.scene.camera.lens = if radius.is_finite() && radius > 0.0 && n[2].is_finite() {
                    Lens { radius, focus: n[2] }
                } else {
                    Lens::PINHOLE
                };
            }
            "Declare" => self.declared.declare(request.text(0)?, request.text(1)?),
            "Option" => {
                let parameters = request.parameters(1, &self.declared)?;
                for parameter in &parameters.0 {
                    if request.text(0)? == "searchpath" && parameter.name == "archive" {
                        let paths = parameter.texts.iter().flat_map(|text| text.split(':'));
                        self.search
                            .extend(paths.filter(|p| !p.is_empty() && *p != "&" && *p != "@").map(PathBuf::from));
                    } else {
                        let what = format!("Option {:?} {:?}", request.text(0)?, parameter.name);
                        self.leave_out(what, request.line, path);
                    }
                }
            }
            "Imager" => {
                let parameters = request.parameters(1, &self.declared)?;
                if request.text(0)? == "background" {
                    let black = parameters.triple("bgcolor", Vec3::ZERO);
                    self.scene.background = Some(parameters.triple("background", parameters.triple("color", black)));
                } else {
                    self.leave_out(format!("Imager {:?}", request.text(0)?), request.line, path);
                }
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn attribute(&mut self, request: &Request, path: &Path) -> Checked<bool> {
        match request.name.as_str() {
            "Color" => self.attributes.color = triple(request)?,
            "Surface" => {
                let parameters = request.parameters(1, &self.declared)?;
                let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
                let name = request.text(0)?.to_owned();
                self.attributes.surface = Surface { name, parameters, line: request.line, folder };
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
                self.attributes.corners = std::array::from_fn(|k| glam::Vec2::new(n[2 * k], n[2 * k + 1]));
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

    fn block(&mut self, request: &Request, path: &Path) -> Checked<bool> {
        let begin = |this: &mut Self, kind: &'static str, attributes: bool| {
            if this.blocks.len() >= MAX_BLOCKS {
                return Err(format!("blocks are nested more than {MAX_BLOCKS} deep"));
            }
            let attributes = attributes.then(|| this.attributes.clone());
            this.blocks.push(Block { kind, transform: this.transform, attributes, line: request.line });
            Ok(())
        };
        match request.name.as_str() {
            "AttributeBegin" => begin(self, "Attribute", true)?,
            "TransformBegin" => begin(self, "Transform", false)?,
            "SolidBegin" => {
                if request.text(0)? != "primitive" {
                    self.leave_out(format!("SolidBegin {:?}", request.text(0)?), request.line, path);
                }
                begin(self, "Solid", true)?;
            }
            "FrameBegin" => begin(self, "Frame", true)?,
            "WorldBegin" => {
                begin(self, "World", true)?;
                self.camera_from_world = self.transform;
            }
            "AttributeEnd" => self.end("Attribute")?,
            "TransformEnd" => self.end("Transform")?,
            "SolidEnd" => self.end("Solid")?,
            "WorldEnd" => {
                self.end("World")?;
                // what follows is another picture
                self.ended = true;
            }
            "FrameEnd" => self.end("Frame")?,
            "ObjectBegin" => {
                if self.object.is_some() {
                    return Err("an object is defined within an object".into());
                }
                begin(self, "Object", true)?;
                self.object = Some((request.handle(0)?, Vec::new(), self.transform));
            }
            "ObjectEnd" => {
                self.end("Object")?;
                if let Some((name, parts, _)) = self.object.take() {
                    self.objects.insert(name, parts);
                }
            }
            "ObjectInstance" => {
                let name = request.handle(0)?;
                let parts = self.objects.get(&name).ok_or_else(|| format!("there is no object {name:?}"))?.clone();
                for (mesh, own) in parts {
                    self.add(mesh, own, path)?;
                }
            }
            "MotionBegin" => {
                self.in_motion = Some(false);
                self.leave_out("MotionBegin (the first time is taken)".into(), request.line, path);
            }
            "MotionEnd" => {}
            "ArchiveBegin" => {
                self.skipping = Some("ArchiveEnd");
                self.leave_out("ArchiveBegin".into(), request.line, path);
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn end(&mut self, kind: &str) -> Checked<()> {
        let block = self.blocks.pop().ok_or("no block is open")?;
        if block.kind != kind {
            return Err(format!("the block open is {}Begin of line {}", block.kind, block.line));
        }
        self.transform = block.transform;
        if let Some(attributes) = block.attributes {
            self.attributes = attributes;
        }
        Ok(())
    }

    fn geometry(&mut self, request: &Request, path: &Path) -> Checked<bool> {
        let inside_out = self.is_inside_out();
        if let Some((quadric, list)) = surface::quadric(request)? {
            let parameters = request.parameters(list, &self.declared)?;
            self.leave_out_parameters(&parameters, request.line, path);
            if self.shine(&emitter::of_quadric(&quadric, self.placed(), inside_out)) {
                return Ok(true);
            }
            self.warn_of_light(request, path);
            let (quadric, unit) = of_unit_size(quadric);
            let corners = match parameters.texture() {
                Some((st, _)) => Corners::try_from(st).map_err(|st| format!("found {} st, expected 4", st.len()))?,
                None => self.attributes.corners,
            };
            let mesh = self.meshes.get(surface::key(&quadric, &corners, inside_out), || {
                let mut data = quadric.mesh()?;
                surface::map_texture(&mut data, &corners);
                Ok(turned(data, inside_out))
            });
            self.add(mesh.map_err(|e| e.to_string())?, unit, path)?;
            return Ok(true);
        }
        let data = if let Some(list) = surface::list_of_polygons(&request.name) {
            let parameters = request.parameters(list, &self.declared)?;
            self.leave_out_parameters(&parameters, request.line, path);
            let points = parameters.points()?;
            let Some(loops) = surface::loops(request, points.len())? else { return Ok(false) };
            if let [outline] = &loops[..]
                && let [outline] = &outline[..]
                && let Some(corners) =
                    outline.iter().map(|&i| points.get(i as usize).copied()).collect::<Option<Vec<_>>>()
                && self.shine(&emitter::of_polygon(&corners, self.placed(), inside_out))
            {
                return Ok(true);
            }
            surface::polygons(&loops, &parameters)?
        } else if let Some(list) = surface::list_of_patches(&request.name) {
            let parameters = request.parameters(list, &self.declared)?;
            self.leave_out_parameters(&parameters, request.line, path);
            surface::patches(request, &parameters, &self.attributes.bases, &self.attributes.corners)?
        } else if request.name == "SubdivisionMesh" {
            let parameters = request.parameters(surface::subdivision_list(request), &self.declared)?;
            self.leave_out_parameters(&parameters, request.line, path);
            let (data, unknown) = surface::subdivision(request, &parameters)?;
            unknown.into_iter().for_each(|what| self.leave_out(format!("SubdivisionMesh {what}"), request.line, path));
            data
        } else {
            return Ok(false);
        };
        self.warn_of_light(request, path);
        let mesh = Mesh::new(turned(data, inside_out)).map_err(|e| e.to_string())?;
        self.add(mesh.into(), Mat4::IDENTITY, path)?;
        Ok(true)
    }

    /// Says which parameters of a shape are not used.
    fn leave_out_parameters(&mut self, parameters: &Parameters, line: usize, path: &Path) {
        for parameter in &parameters.0 {
            let used = ["P", "Pw", "N", "Np", "st", "s", "t"].contains(&parameter.name.as_str());
            // a projective control point bends a patch
            let bent = parameter.name == "Pw" && parameter.numbers.chunks_exact(4).any(|p| p[3] != 1.0);
            if !used || bent {
                let what = match parameter.class {
                    _ if bent => "Pw with a last coordinate other than 1 (the point is divided by it)".into(),
                    Class::Uniform | Class::Constant => format!("the parameter {:?} of a shape", parameter.name),
                    _ => format!("the parameter {:?} that varies over a shape", parameter.name),
                };
                self.leave_out(what, line, path);
            }
        }
    }

    /// Whether a surface's outside is not where its own orientation says.
    fn is_inside_out(&self) -> bool {
        let left = self.transform.determinant() > 0.0;
        match self.attributes.inside_out {
            Outside::Same => false,
            Outside::Other => true,
            Outside::Left => !left,
            Outside::Right => left,
        }
    }

    /// Makes an area light of a shape that can be one, if one is wanted.
    fn shine(&mut self, shape: &Option<Emitter>) -> bool {
        let (Some(radiance), Some(shape), None) = (self.attributes.shining, shape, &self.object) else { return false };
        self.scene.lights.push(Light::Area(AreaLight { shape: *shape, radiance }));
        true
    }

    fn warn_of_light(&mut self, request: &Request, path: &Path) {
        if self.attributes.shining.is_some() {
            let what = format!("AreaLightSource on {} (disks, parallelograms and spheres shine)", request.name);
            self.leave_out(what, request.line, path);
        }
    }

    /// Adds a mesh with the current attributes, or to the object being defined.
    fn add(&mut self, mesh: Arc<Mesh>, own: Mat4, path: &Path) -> Checked<()> {
        if let Some((_, parts, start)) = &mut self.object {
            parts.push((mesh, start.inverse() * self.transform * own));
            return Ok(());
        }
        let (material, texture) = self.material(path)?;
        let transform = self.placed() * own;
        self.scene.place(mesh, transform, material, texture).map_err(|e| e.to_string())
    }

    /// The material of the current surface and colour.
    fn material(&mut self, path: &Path) -> Checked<(usize, TextureMap)> {
        let Surface { name, parameters, line, folder } = self.attributes.surface.clone();
        let color = self.attributes.color;
        let key = format!("{name} {parameters:?} {color} {}", folder.display());
        if let Some(found) = self.materials.get(&key) {
            return Ok(*found);
        }
        let mut texture = TextureMap::default();
        let (name, material): (String, Arc<dyn Material>) = if name == "loden" {
            let file = parameters.text("material").ok_or("Surface \"loden\" has no \"string material\"")?;
            texture = TextureMap {
                scale: parameters.number("scale", 1.0),
                rotation_degrees: parameters.number("rotation", 0.0),
            };
            let scheme = match parameters.text("interpolation") {
                None | Some("triangles") => Scheme::Triangles,
                Some("rings") => Scheme::Rings,
                Some(other) => return Err(format!("interpolation: found {other:?}, expected triangles or rings")),
            };
            let file = self.find(file, &folder);
            let material = self.scene.open_material(&file, scheme).map_err(|e| e.to_string())?;
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
        let texture = check_texture(texture).map_err(|e| e.to_string())?;
        let found = (self.scene.materials.len(), texture);
        self.scene.materials.push(Named { name, material });
        self.materials.insert(key, found);
        Ok(found)
    }

    fn finish(mut self, path: &Path) -> Result<SceneFile> {
        if let Some(block) = self.blocks.last() {
            let field = format!("line {}: {}Begin", block.line, block.kind);
            // the world of an archive read by itself may be missing, but what begins must end
            return Err(Error::invalid(path, field, "it has no end"));
        }
        let settings = &self.scene.settings;
        if self.scene.camera.window.is_none() {
            let aspect = settings.width as f32 / settings.height as f32 * self.pixel_aspect;
            let frame = self.frame_aspect.unwrap_or(aspect);
            if self.pixel_aspect != 1.0 || self.frame_aspect.is_some() {
                let (x, y) = if frame >= 1.0 { (frame, 1.0) } else { (1.0, 1.0 / frame) };
                self.scene.camera.window = Some([-x, x, -y, y]);
            }
        }
        let said = |(what, (place, count)): (&String, &(String, usize))| match count {
            1 => format!("{place}: left out: {what}"),
            count => format!("{place}: left out: {what}, {count} times in all"),
        };
        self.scene.warnings.extend(self.left_out.iter().map(said));
        Ok(self.scene)
    }
}

/// The bytes of a file, uncompressed.
fn load(path: &Path) -> Result<Vec<u8>> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let mut plain = Vec::new();
    let read = MultiGzDecoder::new(&bytes[..]).take(MAX_BYTES + 1).read_to_end(&mut plain);
    let length = read.map_err(|e| Error::invalid(path, "gzip", e.to_string()))? as u64;
    if length > MAX_BYTES {
        return Err(Error::Limit {
            path: path.into(),
            field: "uncompressed size".into(),
            found: length,
            limit: MAX_BYTES,
        });
    }
    Ok(plain)
}

fn triple(request: &Request) -> Checked<Vec3> {
    Ok(Vec3::from_slice(&request.numbers(3)?.0))
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

fn turned(mut data: MeshData, inside_out: bool) -> MeshData {
    if inside_out {
        geometry::reverse(&mut data);
    }
    data
}

/// A full sphere of radius 1 and how to scale it, so that spheres of all sizes share a mesh.
fn of_unit_size(quadric: Quadric) -> (Quadric, Mat4) {
    match quadric {
        Quadric::Sphere { radius, z_min, z_max, sweep } if radius > 0.0 && z_min <= -radius && z_max >= radius => {
            let unit = Quadric::Sphere { radius: 1.0, z_min: -1.0, z_max: 1.0, sweep };
            (unit, Mat4::from_scale(Vec3::splat(radius)))
        }
        other => (other, Mat4::IDENTITY),
    }
}
