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

mod attributes;
mod emitter;
mod lexer;
mod options;
mod request;
mod shader;
mod shapes;
mod surface;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::read::MultiGzDecoder;
use glam::{Mat4, Vec3};

use self::attributes::Attributes;
use self::request::{Checked, Declarations, Request, Requests};
use super::{Meshes, SceneFile};
use crate::material::Memory;
use crate::render::{Camera, Mesh, Projection, TextureMap};
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
pub(super) fn read(path: &Path, memory: Option<Memory>) -> Result<SceneFile> {
    let mut reader = Reader::new();
    reader.scene.memory = memory;
    reader.file(path, 0)?;
    reader.finish(path)
}

/// From the interface's left-handed camera to our world.
fn world_from_camera() -> Mat4 {
    Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0))
}

/// What a block that ends restores.
struct Block {
    kind: &'static str,
    transform: Mat4,
    attributes: Option<Attributes>,
    line: usize,
}

/// A mesh of an object, with its transform there.
type Part = (Arc<Mesh>, Mat4);

/// Shapes that are drawn where they are instanced.
struct Object {
    name: String,
    parts: Vec<Part>,
    /// The transform where it began.
    start: Mat4,
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
    objects: HashMap<String, Vec<Part>>,
    /// The object being defined.
    object: Option<Object>,
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
        let mut scene = SceneFile::empty(camera);
        scene.background = Some(Vec3::ZERO);
        Self {
            scene,
            meshes: Meshes::default(),
            declared: Declarations::default(),
            attributes: Attributes::default(),
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
                self.object = Some(Object { name: request.handle(0)?, parts: Vec::new(), start: self.transform });
            }
            "ObjectEnd" => {
                self.end("Object")?;
                if let Some(object) = self.object.take() {
                    self.objects.insert(object.name, object.parts);
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
