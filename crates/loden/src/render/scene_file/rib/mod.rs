//! Scene files in the RenderMan Interface Bytestream (RIB).
//!
//! # Model
//! The RenderMan camera looks along +z of a left-handed system, x to the right and y up. Ours looks along -z of a
//! right-handed system. World space is RenderMan's camera space with z negated: worlds of either handedness keep their
//! appearance, and the outside of a surface stays the outside. RenderMan's texture coordinate t points down, our v up.
//!
//! # Limits
//! `docs/scenes.md` lists the supported requests. Every other request gives one warning, with the line of its first use.
//!
//! # References
//! pixar2000

mod attributes;
mod emitter;
mod lexer;
mod meshes;
mod options;
mod request;
mod shader;
mod shapes;
mod structure;
#[cfg(test)]
mod tests;
mod texture_map;

use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use glam::{Mat4, Vec3};

use self::attributes::Attributes;
use self::request::{Declarations, Request, Requests, RibResult};
use self::structure::{Archive, Block, Inline, Object, Part, Recording};
use super::SceneFile;
use crate::memory::Memory;
use crate::render::{Camera, Projection, TextureMap};
use crate::{Error, Result};

/// Maximum size of a file, uncompressed, in bytes.
const MAX_BYTES: u64 = 1 << 30;
/// Maximum nesting depth of archives.
const MAX_DEPTH: usize = 32;
/// Maximum number of requests, archives included: archives that include each other grow exponentially.
const MAX_REQUESTS: usize = 1 << 24;
/// Maximum nesting depth of blocks.
const MAX_BLOCKS: usize = 1 << 12;

/// Reads a scene and the archives it includes.
pub(super) fn read(path: &Path, memory: Option<Memory>) -> Result<SceneFile> {
    let mut reader = Reader::new();
    reader.scene.memory = memory;
    reader.file(path, 0)?;
    reader.finish(path)
}

/// The transform from RenderMan's left-handed camera space to our world space.
fn world_from_camera() -> Mat4 {
    Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0))
}

struct Reader {
    scene: SceneFile,
    declared: Declarations,
    attributes: Attributes,
    /// From the current coordinates to camera space.
    transform: Mat4,
    camera_from_world: Mat4,
    named_transforms: HashMap<String, Mat4>,
    blocks: Vec<Block>,
    objects: HashMap<String, Vec<Part>>,
    /// The object being defined.
    object: Option<Object>,
    archives: HashMap<String, Inline>,
    /// The inline archive being read.
    recording: Option<Recording>,
    materials: HashMap<String, (usize, TextureMap)>,
    search_paths: Vec<PathBuf>,
    /// Ignored requests: location of the first and number of occurrences, by description.
    ignored: BTreeMap<String, (String, usize)>,
    requests: usize,
    pixel_aspect: f32,
    frame_aspect: Option<f32>,
    /// Whether the next world is a depth map.
    depth_only: bool,
    /// Skip all requests up to this one.
    skipping: Option<&'static str>,
    /// Within a motion block: whether its first request has been read.
    in_motion: Option<bool>,
    /// Whether the world has ended.
    ended: bool,
}

/// Requests that are ignored without a warning.
const WITHOUT_EFFECT: &[&str] = &["version"];
/// Requests whose first argument names their kind, which warnings include.
const NAMED: &[&str] =
    &["Attribute", "Geometry", "Displacement", "Atmosphere", "Hider", "Bxdf", "Light", "Pattern", "Integrator"];

impl Reader {
    fn new() -> Self {
        // RenderMan's default camera: a parallel projection of -1..1.
        let camera = Camera {
            projection: Projection::Orthographic { height: 2.0 },
            ..Camera::pinhole(Vec3::ZERO, -Vec3::Z, 90.0)
        };
        let mut scene = SceneFile::empty(camera);
        scene.background = Some(Vec3::ZERO);
        Self {
            scene,
            declared: Declarations::default(),
            attributes: Attributes::default(),
            transform: Mat4::IDENTITY,
            camera_from_world: Mat4::IDENTITY,
            named_transforms: HashMap::new(),
            blocks: Vec::new(),
            objects: HashMap::new(),
            object: None,
            archives: HashMap::new(),
            recording: None,
            materials: HashMap::new(),
            search_paths: Vec::new(),
            ignored: BTreeMap::new(),
            requests: 0,
            pixel_aspect: 1.0,
            frame_aspect: None,
            depth_only: false,
            skipping: None,
            in_motion: None,
            ended: false,
        }
    }

    fn file(&mut self, path: &Path, depth: usize) -> Result<()> {
        let mut requests = Requests::new(load(path)?);
        while !self.ended {
            let request = requests
                .next()
                .map_err(|problem| Error::invalid(path, format!("line {}", requests.line()), problem))?;
            let Some(request) = request else { break };
            self.run(&request, path, depth)?;
        }
        Ok(())
    }

    /// Executes a request, and the requests of the archive that it includes.
    fn run(&mut self, request: &Request, path: &Path, depth: usize) -> Result<()> {
        self.requests += 1;
        if self.requests > MAX_REQUESTS {
            let field = format!("line {}: number of requests, archives included", request.line);
            let (path, found) = (path.into(), self.requests as u64);
            return Err(Error::Limit { path, field, found, limit: MAX_REQUESTS as u64 });
        }
        let invalid =
            |problem: String| Error::invalid(path, format!("line {}: {}", request.line, request.name), problem);
        if self.record(request, path).map_err(invalid)? {
            return Ok(());
        }
        if self.skipping.is_some() || !matches!(request.name.as_str(), "ReadArchive" | "Procedural") {
            return self.request(request, path).map_err(invalid);
        }
        let Some(archive) = self.archive(request, path).map_err(invalid)? else { return Ok(()) };
        if depth >= MAX_DEPTH {
            return Err(invalid(format!("archives are nested more than {MAX_DEPTH} deep")));
        }
        match archive {
            Archive::File(archive) => self.file(&archive, depth + 1),
            Archive::Inline(archive) => {
                let (path, requests) = archive.as_ref();
                requests.iter().try_for_each(|request| self.run(request, path, depth + 1))
            }
        }
    }

    /// The archive that a request includes; `None` if the kind of procedure is not supported.
    fn archive(&mut self, request: &Request, path: &Path) -> RibResult<Option<Archive>> {
        let mut name = request.text(0)?;
        if request.name == "Procedural" {
            if name != "DelayedReadArchive" {
                self.ignore(format!("Procedural {name:?}"), request.line, path);
                return Ok(None);
            }
            name = match request.arguments.get(1) {
                Some(request::Argument::Texts(names)) if !names.is_empty() => &names[0],
                _ => request.text(1)?,
            };
        }
        if let Some(archive) = self.archives.get(name) {
            return Ok(Some(Archive::Inline(archive.clone())));
        }
        Ok(Some(Archive::File(self.find(name, path.parent().unwrap_or(Path::new(""))))))
    }

    /// Finds a file in the folder of the file that names it, then in the search path. May return a missing file.
    fn find(&self, name: &str, folder: &Path) -> PathBuf {
        let beside = folder.join(name);
        let others = self.search_paths.iter().map(|other| folder.join(other).join(name));
        std::iter::once(beside.clone()).chain(others).find(|path| path.exists()).unwrap_or(beside)
    }

    fn ignore(&mut self, what: String, line: usize, path: &Path) {
        self.ignored.entry(what).or_insert_with(|| (format!("{}: line {line}", path.display()), 0)).1 += 1;
    }

    /// The transform from the current coordinates to world space.
    fn world_from_current(&self) -> Mat4 {
        world_from_camera() * self.transform
    }

    /// Executes a request that includes no archive.
    fn request(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        if let Some(end) = self.skipping {
            if request.name == end {
                self.skipping = None;
            }
            return Ok(());
        }
        // Within a motion block, use only the first time.
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
        let what = match (request.name.as_str(), request.text(0)) {
            ("Attribute", Ok("identifier")) => return Ok(()),
            (name, _) if WITHOUT_EFFECT.contains(&name) => return Ok(()),
            (name, Ok(kind)) if NAMED.contains(&name) => format!("{name} {kind:?}"),
            (name, _) => name.to_owned(),
        };
        self.ignore(what, request.line, path);
        Ok(())
    }

    /// Executes a transform request; `false` if the request is not one.
    fn transform_request(&mut self, request: &Request) -> RibResult<bool> {
        let change = match request.name.as_str() {
            "Translate" => Mat4::from_translation(triple(request)?),
            "Scale" => Mat4::from_scale(triple(request)?),
            "Rotate" => {
                let (n, _) = request.numbers(4)?;
                let axis = Vec3::from_slice(&n[1..]).try_normalize().ok_or("the axis has length 0")?;
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
                    _ => *self
                        .named_transforms
                        .get(&name)
                        .ok_or_else(|| format!("there is no coordinate system {name:?}"))?,
                };
                return Ok(true);
            }
            _ => return Ok(false),
        };
        self.transform *= change;
        Ok(true)
    }

    /// Checks that all blocks are closed, then completes the camera and the warnings.
    fn finish(mut self, path: &Path) -> Result<SceneFile> {
        if let Some(block) = self.blocks.last() {
            let field = format!("line {}: {}Begin", block.line, block.kind);
            // An archive that is opened by itself may have no world, but its blocks must be closed.
            return Err(Error::invalid(path, field, "the block is not closed"));
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
        if let Some(recording) = &self.recording {
            let problem = format!("{}: the archive {:?} is not closed", path.display(), recording.name);
            self.scene.warnings.push(problem);
        }
        if self.scene.bodies.is_empty() {
            self.scene.warnings.push(format!("{}: the scene has no shapes", path.display()));
        }
        let warning = |(what, (location, count)): (&String, &(String, usize))| match count {
            1 => format!("{location}: ignored {what}"),
            count => format!("{location}: ignored {what} ({count} times)"),
        };
        self.scene.warnings.extend(self.ignored.iter().map(warning));
        Ok(self.scene)
    }
}

/// The bytes of a file, decompressed if it is a gzip file.
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

fn triple(request: &Request) -> RibResult<Vec3> {
    Ok(Vec3::from_slice(&request.numbers(3)?.0))
}
