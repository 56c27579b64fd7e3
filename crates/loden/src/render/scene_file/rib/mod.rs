//! Scene files in the RenderMan Interface Bytestream (RIB).
//!
//! # Model
//! The RenderMan camera looks along +z of a left-handed system, x to the right and y up. Ours looks along -z of a
//! right-handed system. World space is RenderMan's camera space with z negated: worlds of either handedness keep their
//! appearance, and the outside of a surface stays the outside. RenderMan's texture coordinate t points down, our v up.
//!
//! # Limits
//! `docs/scenes.md` lists the supported requests. Every other request gives one warning, with the line of its first use.
//! A request that is wrong is skipped with a warning; only a wrong measured material and a limit end the scene.
//!
//! # References
//! pixar2000

mod archive;
mod attributes;
mod blobs;
mod bxdf;
mod condition;
mod detail;
mod emitter;
mod lexer;
mod lights;
mod materials;
mod meshes;
mod notes;
mod options;
mod paint;
mod request;
mod shaded;
mod shapes;
mod strands;
mod structure;
mod surface;
#[cfg(test)]
mod tests;
mod texture_map;
mod transform;
mod worlds;

use std::collections::HashMap;
use std::f32::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec3};

use self::archive::SearchPath;
use self::attributes::Attributes;
use self::bxdf::Patterns;
use self::condition::{Branch, Value};
use self::lights::Decay;
use self::notes::{Notes, kind_of};
use self::request::{Argument, Declarations, Fault, Request, Requests, RibResult, Step};
use self::shaded::Shade;
use self::structure::{Archive, Block, Inline, Object, Parts, Recording};
use self::worlds::{Kind, World};
use super::{Reading, SceneFile, Shadows};
use crate::picture::Picture;
use crate::render::{Camera, Environment, Light, Projection, TextureMap};
use crate::{Error, Result};

/// Radiance of a white surface in the middle of the scene below which a light of unknown decay has none.
const DARK: f32 = 0.05;
/// Maximum nesting depth of archives.
const MAX_DEPTH: usize = 32;
/// Maximum number of requests, archives included: archives that include each other grow exponentially.
const MAX_REQUESTS: usize = 1 << 24;
/// Maximum nesting depth of blocks.
const MAX_BLOCKS: usize = 1 << 12;

/// Reads a scene and the archives it includes.
pub(super) fn read(path: &Path, reading: &Reading) -> Result<SceneFile> {
    let mut reader = Reader::new(reading);
    reader.counts_worlds = reading.world.is_none();
    if let Some(number) = reading.world {
        reader.wanted = Some(number.checked_sub(1).ok_or_else(|| Error::parameter("world", "worlds count from 1"))?);
    }
    reader.file(archive::load(path)?, path, 0)?;
    if !reader.knows_requests {
        return Err(Error::invalid(path, "content", "found no request of RIB"));
    }
    let worlds = std::mem::take(&mut reader.worlds);
    if let Some(number) = reading.world {
        if reader.drawn.is_none() {
            let problem = format!("found {number}, but {} has {} worlds", path.display(), worlds.len());
            return Err(Error::parameter("world", problem));
        }
        return reader.finish(path);
    }
    let chosen = worlds::choose(&worlds);
    if chosen.is_some() && chosen != reader.drawn_world {
        reader = Reader::new(reading);
        reader.wanted = chosen;
        reader.file(archive::load(path)?, path, 0)?;
    }
    let mut scene = reader.finish(path)?;
    if let (Some(chosen), true) = (chosen, worlds.len() > 1) {
        let World { kind, line, .. } = worlds[chosen];
        let what = if kind == Kind::Picture { "" } else { ", no world is a picture" };
        scene.warnings.insert(
            0,
            format!(
                "{}: found {} worlds{what}: number {} (line {line}) is drawn; --world chooses another",
                path.display(),
                worlds.len(),
                chosen + 1
            ),
        );
    }
    Ok(scene)
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
    objects: HashMap<String, Arc<Parts>>,
    /// The object being defined.
    object: Option<Object>,
    archives: HashMap<String, Inline>,
    /// The inline archive being read.
    recording: Option<Recording>,
    /// Materials by what they are made of, and what keeps the addresses in these keys in use.
    materials: HashMap<String, (usize, TextureMap)>,
    kept_paints: Vec<Arc<Picture>>,
    kept_patterns: Vec<Patterns>,
    shades: Vec<Shade>,
    /// Pictures of textures, or why they cannot be read.
    textures: HashMap<PathBuf, RibResult<Arc<Picture>>>,
    archives_path: SearchPath,
    textures_path: SearchPath,
    /// Options that conditions may ask for.
    variables: HashMap<String, Value>,
    branches: Vec<Branch>,
    notes: Notes,
    requests: usize,
    /// Whether a request of the interface has been found.
    knows_requests: bool,
    pixel_aspect: f32,
    frame_aspect: Option<f32>,
    /// Whether the file may limit the memory of images: the caller did not.
    may_limit: bool,
    /// Sum of all ambient lights.
    ambient: Vec3,
    /// Lights that do not fall off with the square of the distance, or may not.
    even_lights: Vec<(usize, Decay)>,
    /// Whether all lights cast shadows.
    all_shadows: bool,
    /// What the next world is for.
    kind: Kind,
    worlds: Vec<World>,
    /// The index of the world to draw; the first picture if `None`.
    wanted: Option<usize>,
    /// Whether reading goes on after the world that is drawn.
    counts_worlds: bool,
    /// Within a world that is not drawn.
    in_other_world: bool,
    /// The scene of the world that was drawn, and its index.
    drawn: Option<SceneFile>,
    drawn_world: Option<usize>,
    /// Whether a trimming curve was given.
    trimmed: bool,
    /// Within a motion block: whether its first request has been read.
    in_motion: Option<bool>,
    /// Whether reading has ended.
    ended: bool,
}

/// Requests that are ignored without a warning.
const WITHOUT_EFFECT: &[&str] = &["version"];
/// Requests whose first argument names their kind, which warnings include.
const NAMED: &[&str] = &["Displacement", "Displace", "Atmosphere", "Interior", "Exterior", "Hider", "Integrator"];

impl Reader {
    fn new(reading: &Reading) -> Self {
        // RenderMan's default camera: a parallel projection of -1..1.
        let camera = Camera {
            projection: Projection::Orthographic { height: 2.0 },
            ..Camera::pinhole(Vec3::ZERO, -Vec3::Z, 90.0)
        };
        let mut scene = SceneFile::empty(camera);
        scene.background = Some(Vec3::ZERO);
        scene.memory = reading.memory;
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
            kept_paints: Vec::new(),
            kept_patterns: Vec::new(),
            shades: Vec::new(),
            textures: HashMap::new(),
            archives_path: SearchPath::default(),
            textures_path: SearchPath::default(),
            variables: HashMap::new(),
            branches: Vec::new(),
            notes: Notes::default(),
            requests: 0,
            knows_requests: false,
            pixel_aspect: 1.0,
            may_limit: reading.memory.is_none(),
            frame_aspect: None,
            ambient: Vec3::ZERO,
            even_lights: Vec::new(),
            all_shadows: reading.shadows == Some(Shadows::All),
            kind: Kind::Picture,
            worlds: Vec::new(),
            wanted: None,
            counts_worlds: false,
            in_other_world: false,
            drawn: None,
            drawn_world: None,
            trimmed: false,
            in_motion: None,
            ended: false,
        }
    }

    /// Executes the requests of a file.
    fn file(&mut self, bytes: Vec<u8>, path: &Path, depth: usize) -> Result<()> {
        let mut requests = Requests::new(bytes);
        while !self.ended {
            match requests.next() {
                Ok(Some(request)) => self.run(&request, path, depth)?,
                Ok(None) => break,
                Err(problem) => self.note(format!("skipped up to the next request: {problem}"), requests.line(), path),
            }
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
        match self.step(request, path) {
            Ok(None) => Ok(()),
            Ok(Some(archive)) => self.include(archive, request, path, depth),
            Err(Fault::Skip(problem)) => {
                self.knows_requests = true;
                self.note(format!("skipped {}: {problem}", request.name), request.line, path);
                Ok(())
            }
            Err(Fault::Stop(problem)) => {
                Err(Error::invalid(path, format!("line {}: {}", request.line, request.name), problem))
            }
        }
    }

    /// Executes the requests of an archive. One that is missing or cannot be read is skipped.
    fn include(&mut self, included: Archive, request: &Request, path: &Path, depth: usize) -> Result<()> {
        if depth >= MAX_DEPTH {
            let field = format!("line {}: {}", request.line, request.name);
            return Err(Error::invalid(path, field, format!("archives are nested more than {MAX_DEPTH} deep")));
        }
        match included {
            Archive::File(file) => match archive::load(&file) {
                Ok(bytes) => self.file(bytes, &file, depth + 1),
                Err(error) => {
                    self.note(format!("skipped {}: {error}", request.name), request.line, path);
                    Ok(())
                }
            },
            Archive::Inline(archive) => {
                let (path, requests) = archive.as_ref();
                requests.iter().try_for_each(|request| self.run(request, path, depth + 1))
            }
        }
    }

    /// The archive that a request includes; `None` if the kind of procedure is not supported.
    fn archive(&mut self, request: &Request, path: &Path) -> RibResult<Option<Archive>> {
        let mut name = request.text(0)?.to_owned();
        if request.name != "ReadArchive" {
            if !matches!(name.as_str(), "DelayedReadArchive" | "DelayedReadArchive2") {
                self.ignore(format!("{} {name:?}", request.name), request.line, path);
                return Ok(None);
            }
            name = match request.arguments.get(1) {
                Some(Argument::Texts(names)) if !names.is_empty() => names[0].clone(),
                _ if request.name == "Procedural2" => {
                    let parameters = request.parameters(2, &self.declared)?;
                    parameters.any_text(&["filename", "file"]).ok_or("it names no file")?.to_owned()
                }
                _ => request.text(1)?.to_owned(),
            };
        }
        if let Some(archive) = self.archives.get(&name) {
            return Ok(Some(Archive::Inline(archive.clone())));
        }
        let folder = materials::folder_of(path);
        if let Some(file) = self.archives_path.find(&name, folder) {
            return Ok(Some(Archive::File(file)));
        }
        // Scenes of several passes have a search path that another file sets.
        let file = archive::below(&name, folder).ok_or_else(|| format!("the archive {name:?} is missing"))?;
        let what = format!("the archive {name:?} is not in the search path: {} is read", file.display());
        self.notes.add(what.clone(), what, request.line, path);
        Ok(Some(Archive::File(file)))
    }

    /// Warns that a request is ignored.
    fn ignore(&mut self, what: String, line: usize, path: &Path) {
        if self.drawn.is_none() {
            let text = format!("ignored {what}");
            self.notes.add(text.clone(), text, line, path);
        }
    }

    /// Adds a warning.
    fn note(&mut self, text: String, line: usize, path: &Path) {
        if self.drawn.is_none() {
            self.notes.add(kind_of(&text), text, line, path);
        }
    }

    /// Executes a request. Returns the archive that it includes.
    fn step(&mut self, request: &Request, path: &Path) -> Step<Option<Archive>> {
        if self.record(request, path)? {
            self.knows_requests = true;
            return Ok(None);
        }
        if self.in_other_world {
            self.count(request);
            return Ok(None);
        }
        if self.condition(request, path)? {
            return Ok(None);
        }
        // Within a motion block, use only the first time.
        if let Some(seen) = &mut self.in_motion {
            if request.name == "MotionEnd" {
                self.in_motion = None;
                return Ok(None);
            }
            if std::mem::replace(seen, true) {
                return Ok(None);
            }
        }
        if matches!(request.name.as_str(), "ReadArchive" | "Procedural" | "Procedural2") {
            self.knows_requests = true;
            return Ok(self.archive(request, path)?);
        }
        let done = self.transform_request(request)?
            || self.option(request, path)?
            || self.attribute(request, path)?
            || self.block(request, path)?
            || self.geometry(request, path)?
            || WITHOUT_EFFECT.contains(&request.name.as_str());
        self.knows_requests |= done;
        if !done {
            self.trimmed |= request.name == "TrimCurve";
            let what = match (request.name.as_str(), request.text(0)) {
                (name, Ok(kind)) if NAMED.contains(&name) => format!("{name} {kind:?}"),
                (name, _) => name.to_owned(),
            };
            self.ignore(what, request.line, path);
        }
        Ok(None)
    }

    /// The transform from the current coordinates to world space.
    fn world_from_current(&self) -> Mat4 {
        world_from_camera() * self.transform
    }

    /// The scene read so far, with its camera and its materials under the lights.
    fn complete(&mut self, path: &Path) -> RibResult<SceneFile> {
        let settings = &self.scene.settings;
        if self.scene.camera.window.is_none() {
            let aspect = settings.width as f32 / settings.height as f32 * self.pixel_aspect;
            let frame = self.frame_aspect.unwrap_or(aspect);
            if self.pixel_aspect != 1.0 || self.frame_aspect.is_some() {
                let (x, y) = if frame >= 1.0 { (frame, 1.0) } else { (1.0, 1.0 / frame) };
                self.scene.camera.window = Some([-x, x, -y, y]);
            }
        }
        self.set_even_lights();
        let is_lit = self.ambient != Vec3::ZERO
            || !self.scene.lights.is_empty()
            || !matches!(self.scene.environment, Environment::Dark)
            || self.shades.iter().any(Shade::emits);
        if !is_lit && self.scene.bodies.iter().any(|body| self.shades[body.material].needs_light()) {
            self.scene.warnings.push(format!(
                "{}: the world has no light; its shapes are shown as RenderMan's default surface shows them, which needs none",
                path.display()
            ));
        }
        self.make_materials(is_lit.then_some(self.ambient))?;
        if self.scene.bodies.is_empty() {
            self.scene.warnings.push(format!("{}: the scene has no shapes", path.display()));
        }
        self.drawn_world = self.worlds.len().checked_sub(1);
        let camera = self.scene.camera;
        Ok(std::mem::replace(&mut self.scene, SceneFile::empty(camera)))
    }

    /// Gives lights without decay the intensity at which they are as bright as they should be in the middle of the
    /// scene.
    fn set_even_lights(&mut self) {
        let extents = self.scene.bodies.iter().map(|body| body.shape.bounds());
        let (sum, count) = extents.fold((Vec3::ZERO, 0.0), |(sum, count), ball| (sum + ball.centre, count + 1.0));
        let middle = sum / f32::max(count, 1.0);
        for (index, decay) in std::mem::take(&mut self.even_lights) {
            let factor = |position: Vec3, intensity: Vec3| {
                let squared = position.distance_squared(middle);
                let is_dark = intensity.max_element() < DARK * PI * squared;
                if decay == Decay::None || is_dark { squared } else { 1.0 }
            };
            let light = match self.scene.lights.get_mut(index) {
                Some(Light::Shadowless(light)) => Some(light.as_mut()),
                other => other,
            };
            match light {
                Some(Light::Point(light)) => light.intensity *= factor(light.position, light.intensity),
                Some(Light::Spot(light)) => light.intensity *= factor(light.position, light.intensity),
                _ => {}
            }
        }
    }

    /// The scene that was drawn, or what the file holds outside of worlds, with all warnings.
    fn finish(mut self, path: &Path) -> Result<SceneFile> {
        let mut scene = match self.drawn.take() {
            Some(scene) => scene,
            None => {
                for (kind, line) in self.blocks.iter().map(|block| (block.kind, block.line)).collect::<Vec<_>>() {
                    self.note(format!("{kind}Begin is not closed"), line, path);
                }
                self.complete(path).map_err(|problem| Error::invalid(path, "scene", problem))?
            }
        };
        for line in self.branches.iter().map(|branch| branch.line).collect::<Vec<_>>() {
            self.note("IfBegin is not closed".into(), line, path);
        }
        if let Some(Recording { name, line, .. }) = self.recording.take() {
            self.note(format!("the archive {name:?} is not closed"), line, path);
        }
        scene.warnings.splice(0..0, self.notes.sentences());
        Ok(scene)
    }
}

fn triple(request: &Request) -> RibResult<Vec3> {
    Ok(Vec3::from_slice(&request.numbers(3)?.0))
}
