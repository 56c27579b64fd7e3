//! Requests that open and close blocks: frames, attributes, objects and inline archives.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec3};

use super::attributes::Attributes;
use super::materials::Own;
use super::request::{Fault, Request, RibResult, Step};
use super::worlds::Kind;
use super::{MAX_BLOCKS, Reader};
use crate::render::scene_file::MAX_BODIES;
use crate::render::{Camera, Environment, Form, Settings};

/// An open block, with the state to restore at its end.
pub(super) struct Block {
    pub kind: &'static str,
    pub line: usize,
    transform: Mat4,
    attributes: Option<Attributes>,
    options: Option<Box<Options>>,
}

/// The options and lights that `FrameBegin` saves besides the attributes.
struct Options {
    camera: Camera,
    settings: Settings,
    background: Option<Vec3>,
    pixel_aspect: f32,
    frame_aspect: Option<f32>,
    kind: Kind,
    lights: usize,
    ambient: Vec3,
    environment: Environment,
}

impl Options {
    fn of(reader: &Reader) -> Self {
        Self {
            camera: reader.scene.camera,
            settings: reader.scene.settings,
            background: reader.scene.background,
            pixel_aspect: reader.pixel_aspect,
            frame_aspect: reader.frame_aspect,
            kind: reader.kind,
            lights: reader.scene.lights.len(),
            ambient: reader.ambient,
            environment: reader.scene.environment.clone(),
        }
    }

    fn restore(self, reader: &mut Reader) {
        reader.scene.camera = self.camera;
        reader.scene.settings = self.settings;
        reader.scene.background = self.background;
        reader.pixel_aspect = self.pixel_aspect;
        reader.frame_aspect = self.frame_aspect;
        reader.kind = self.kind;
        reader.scene.lights.truncate(self.lights);
        reader.ambient = self.ambient;
        reader.scene.environment = self.environment;
    }
}

/// Whether a request draws something.
pub(super) fn shape_requests(name: &str) -> bool {
    const NAMES: &[&str] = &[
        "Sphere",
        "Cone",
        "Cylinder",
        "Disk",
        "Torus",
        "Paraboloid",
        "Hyperboloid",
        "Polygon",
        "GeneralPolygon",
        "PointsPolygons",
        "PointsGeneralPolygons",
        "Patch",
        "PatchMesh",
        "NuPatch",
        "SubdivisionMesh",
        "Curves",
        "Points",
        "Blobby",
        "Geometry",
        "ObjectInstance",
        "ReadArchive",
        "Procedural",
        "Procedural2",
    ];
    NAMES.contains(&name)
}

/// A part of an object, with its transform within the object.
pub(super) enum Part {
    /// A shape, and what it overrides of the attributes where it is placed.
    Shape(Form, Mat4, Own),
    /// Another object.
    Object(Arc<Parts>, Mat4),
}

/// The parts of an object.
#[derive(Default)]
pub(super) struct Parts {
    /// None of them is an empty object.
    list: Vec<Part>,
    /// Number of shapes, those of objects within included.
    shapes: usize,
    /// How deep objects are nested within.
    depth: usize,
}

impl Parts {
    /// Adds a shape.
    pub(super) fn push(&mut self, form: Form, transform: Mat4, own: Own) {
        self.list.push(Part::Shape(form, transform, own));
        self.shapes += 1;
    }
}

/// Maximum depth of objects within objects.
const MAX_NESTED_OBJECTS: usize = 256;

/// The object being defined; its shapes are drawn where it is instanced.
pub(super) struct Object {
    pub name: String,
    pub parts: Parts,
    /// The current transform at `ObjectBegin`.
    pub start: Mat4,
}

/// The requests of an inline archive, with the file they were read from.
pub(super) type Inline = Arc<(PathBuf, Vec<Request>)>;

/// The archive that a request includes.
pub(super) enum Archive {
    File(PathBuf),
    Inline(Inline),
}

/// An inline archive that is still open.
pub(super) struct Recording {
    pub name: String,
    pub line: usize,
    requests: Vec<Request>,
    /// Number of archives open within it.
    open: usize,
}

impl Reader {
    /// Stores a request of an inline archive for later; `false` if no archive is open.
    pub(super) fn record(&mut self, request: &Request, path: &Path) -> RibResult<bool> {
        let Some(recording) = &mut self.recording else {
            let begins = request.name == "ArchiveBegin" && !self.is_skipped();
            if begins {
                let name = request.handle(0)?;
                self.recording = Some(Recording { name, line: request.line, requests: Vec::new(), open: 0 });
            }
            return Ok(begins);
        };
        match request.name.as_str() {
            "ArchiveBegin" => recording.open += 1,
            "ArchiveEnd" if recording.open > 0 => recording.open -= 1,
            "ArchiveEnd" => {
                if let Some(Recording { name, requests, .. }) = self.recording.take() {
                    self.archives.insert(name, Arc::new((path.into(), requests)));
                }
                return Ok(true);
            }
            _ => {}
        }
        recording.requests.push(request.clone());
        Ok(true)
    }

    /// Executes a request that begins or ends a block, or places an object; `false` if it is none of them.
    pub(super) fn block(&mut self, request: &Request, path: &Path) -> Step<bool> {
        match request.name.as_str() {
            "AttributeBegin" => self.begin("Attribute", request.line)?,
            "TransformBegin" => self.begin("Transform", request.line)?,
            "FrameBegin" => self.begin("Frame", request.line)?,
            "SolidBegin" => {
                if request.text(0)? != "primitive" {
                    self.ignore(format!("SolidBegin {:?}", request.text(0)?), request.line, path);
                }
                self.begin("Solid", request.line)?;
            }
            "WorldBegin" => self.begin_world(request, path)?,
            "AttributeEnd" => self.end("Attribute", request, path)?,
            "TransformEnd" => self.end("Transform", request, path)?,
            "FrameEnd" => self.end("Frame", request, path)?,
            "SolidEnd" => self.end("Solid", request, path)?,
            "WorldEnd" => self.end_world(request, path)?,
            "ObjectBegin" => self.begin_object(request)?,
            "ObjectEnd" => self.end_object(request, path)?,
            "ObjectInstance" => self.instance(request, path)?,
            "MotionBegin" => {
                self.in_motion = Some(false);
                self.ignore("motion blur (the first time of MotionBegin is used)".into(), request.line, path);
            }
            "MotionEnd" => {}
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Opens a block. A transform block saves the transform, a frame also the options, all others the attributes.
    pub(super) fn begin(&mut self, kind: &'static str, line: usize) -> Step<()> {
        if self.blocks.len() >= MAX_BLOCKS {
            return Err(Fault::Stop(format!("blocks are nested more than {MAX_BLOCKS} deep")));
        }
        let attributes = (kind != "Transform").then(|| self.attributes.clone());
        let options = (kind == "Frame").then(|| Box::new(Options::of(self)));
        self.blocks.push(Block { kind, transform: self.transform, attributes, options, line });
        Ok(())
    }

    /// Closes a block and restores what it saved. Blocks within it that are still open are closed, too.
    pub(super) fn end(&mut self, kind: &'static str, request: &Request, path: &Path) -> RibResult<()> {
        let open = self.blocks.iter().rposition(|block| block.kind == kind);
        let open = open.ok_or_else(|| format!("there is no {kind}Begin before it"))?;
        while self.blocks.len() > open {
            let Some(block) = self.blocks.pop() else { break };
            if block.kind != kind {
                let what = format!("{kind}End closes the {}Begin of line {}", block.kind, block.line);
                self.note(what, request.line, path);
            }
            self.transform = block.transform;
            if let Some(attributes) = block.attributes {
                self.attributes = attributes;
            }
            if let Some(options) = block.options {
                options.restore(self);
            }
            if block.kind == "Object" && kind != "Object" {
                self.object = None;
            }
        }
        Ok(())
    }

    fn begin_object(&mut self, request: &Request) -> Step<()> {
        if self.object.is_some() {
            return Err("an object cannot be defined within another object".into());
        }
        self.begin("Object", request.line)?;
        self.object = Some(Object { name: request.handle(0)?, parts: Parts::default(), start: self.transform });
        Ok(())
    }

    fn end_object(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        self.end("Object", request, path)?;
        if let Some(object) = self.object.take() {
            self.objects.insert(object.name, Arc::new(object.parts));
        }
        Ok(())
    }

    fn instance(&mut self, request: &Request, path: &Path) -> Step<()> {
        let name = request.handle(0)?;
        let parts = self.objects.get(&name).ok_or_else(|| format!("there is no object {name:?}"))?.clone();
        if parts.shapes == 0 {
            return Ok(());
        }
        // Objects of objects of objects can stand for any number of shapes: count before placing them.
        let known = self.object.as_ref().map_or(self.scene.bodies.len(), |object| object.parts.shapes);
        if known.saturating_add(parts.shapes) > MAX_BODIES {
            return Err(Fault::Stop(format!("the objects hold more than {MAX_BODIES} shapes")));
        }
        let Some(object) = &mut self.object else { return self.place_all(&parts, Mat4::IDENTITY, request, path) };
        let within = &mut object.parts;
        within.depth = within.depth.max(parts.depth + 1);
        if within.depth > MAX_NESTED_OBJECTS {
            return Err(Fault::Stop(format!("objects are nested more than {MAX_NESTED_OBJECTS} deep")));
        }
        within.shapes += parts.shapes;
        within.list.push(Part::Object(parts, object.start.inverse() * self.transform));
        Ok(())
    }

    /// Adds all shapes of an object to the scene.
    fn place_all(&mut self, parts: &Parts, transform: Mat4, request: &Request, path: &Path) -> Step<()> {
        for part in &parts.list {
            match part {
                Part::Shape(form, within, own) => {
                    self.add(form.clone(), transform * *within, own.clone(), request, path)?;
                }
                Part::Object(parts, within) => self.place_all(parts, transform * *within, request, path)?,
            }
        }
        Ok(())
    }
}
