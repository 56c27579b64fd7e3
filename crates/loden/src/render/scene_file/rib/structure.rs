//! Requests that open and close blocks: frames, worlds, attributes, objects and inline archives.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec3};

use super::attributes::Attributes;
use super::request::{Request, RibResult};
use super::{MAX_BLOCKS, Reader};
use crate::render::scene_file::MAX_BODIES;
use crate::render::{Camera, Form, Settings};

/// An open block, with the state to restore at its end.
pub(super) struct Block {
    pub kind: &'static str,
    pub line: usize,
    transform: Mat4,
    attributes: Option<Attributes>,
    options: Option<Box<Options>>,
}

/// The options that `FrameBegin` saves besides the attributes.
struct Options {
    camera: Camera,
    settings: Settings,
    background: Option<Vec3>,
    pixel_aspect: f32,
    frame_aspect: Option<f32>,
    depth_only: bool,
}

impl Options {
    fn of(reader: &Reader) -> Self {
        Self {
            camera: reader.scene.camera,
            settings: reader.scene.settings,
            background: reader.scene.background,
            pixel_aspect: reader.pixel_aspect,
            frame_aspect: reader.frame_aspect,
            depth_only: reader.depth_only,
        }
    }

    fn restore(self, reader: &mut Reader) {
        reader.scene.camera = self.camera;
        reader.scene.settings = self.settings;
        reader.scene.background = self.background;
        reader.pixel_aspect = self.pixel_aspect;
        reader.frame_aspect = self.frame_aspect;
        reader.depth_only = self.depth_only;
    }
}

/// A shape of an object and its transform within the object.
pub(super) type Part = (Form, Mat4);

/// The object being defined; its shapes are drawn where it is instanced.
pub(super) struct Object {
    pub name: String,
    pub parts: Vec<Part>,
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
    requests: Vec<Request>,
    /// Number of archives open within it.
    open: usize,
}

impl Reader {
    /// Stores a request of an inline archive for later; `false` if no archive is open.
    pub(super) fn record(&mut self, request: &Request, path: &Path) -> RibResult<bool> {
        let Some(recording) = &mut self.recording else {
            let begins = request.name == "ArchiveBegin" && self.skipping.is_none();
            if begins {
                let name = request.handle(0)?;
                self.recording = Some(Recording { name, requests: Vec::new(), open: 0 });
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
    pub(super) fn block(&mut self, request: &Request, path: &Path) -> RibResult<bool> {
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
            "WorldBegin" if self.depth_only => {
                self.skipping = Some("WorldEnd");
                self.ignore("the world of a depth map (see its Display)".into(), request.line, path);
            }
            "WorldBegin" => {
                self.begin("World", request.line)?;
                self.camera_from_world = self.transform;
            }
            "AttributeEnd" => self.end("Attribute")?,
            "TransformEnd" => self.end("Transform")?,
            "FrameEnd" => self.end("Frame")?,
            "SolidEnd" => self.end("Solid")?,
            "WorldEnd" => {
                self.end("World")?;
                // What follows is another image, so the frame around this world need not be closed.
                self.ended = true;
                self.blocks.clear();
            }
            "ObjectBegin" => self.begin_object(request)?,
            "ObjectEnd" => self.end_object()?,
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
    fn begin(&mut self, kind: &'static str, line: usize) -> RibResult<()> {
        if self.blocks.len() >= MAX_BLOCKS {
            return Err(format!("blocks are nested more than {MAX_BLOCKS} deep"));
        }
        let attributes = (kind != "Transform").then(|| self.attributes.clone());
        let options = (kind == "Frame").then(|| Box::new(Options::of(self)));
        self.blocks.push(Block { kind, transform: self.transform, attributes, options, line });
        Ok(())
    }

    /// Closes a block and restores what it saved.
    fn end(&mut self, kind: &str) -> RibResult<()> {
        let block = self.blocks.pop().ok_or("no block is open")?;
        if block.kind != kind {
            return Err(format!("expected {}End, which closes the block of line {}", block.kind, block.line));
        }
        self.transform = block.transform;
        if let Some(attributes) = block.attributes {
            self.attributes = attributes;
        }
        if let Some(options) = block.options {
            options.restore(self);
        }
        Ok(())
    }

    fn begin_object(&mut self, request: &Request) -> RibResult<()> {
        if self.object.is_some() {
            return Err("an object cannot be defined within another object".into());
        }
        self.begin("Object", request.line)?;
        self.object = Some(Object { name: request.handle(0)?, parts: Vec::new(), start: self.transform });
        Ok(())
    }

    fn end_object(&mut self) -> RibResult<()> {
        self.end("Object")?;
        if let Some(object) = self.object.take() {
            self.objects.insert(object.name, object.parts);
        }
        Ok(())
    }

    fn instance(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        let name = request.handle(0)?;
        let parts = self.objects.get(&name).ok_or_else(|| format!("there is no object {name:?}"))?;
        // Objects of objects of objects can ask for any amount of memory.
        let defined = self.object.iter().map(|object| &object.parts).chain(self.objects.values());
        if defined.map(Vec::len).sum::<usize>() + parts.len() > MAX_BODIES {
            return Err(format!("the objects hold more than {MAX_BODIES} shapes"));
        }
        let parts = parts.clone();
        parts.into_iter().try_for_each(|(form, transform)| self.add(form, transform, path))
    }
}
