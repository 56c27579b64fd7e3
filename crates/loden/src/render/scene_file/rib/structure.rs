//! Requests that begin and end: frames, worlds, blocks, objects, archives within a file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec3};

use super::attributes::Attributes;
use super::request::{Checked, Request};
use super::{MAX_BLOCKS, Reader};
use crate::render::{Camera, Mesh, Settings};

/// What a block that ends restores.
pub(super) struct Block {
    pub kind: &'static str,
    pub line: usize,
    transform: Mat4,
    attributes: Option<Attributes>,
    options: Option<Box<Options>>,
}

/// What FrameBegin saves beside attributes.
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

/// A mesh of an object, with its transform there.
pub(super) type Part = (Arc<Mesh>, Mat4);

/// Shapes that are drawn where they are instanced.
pub(super) struct Object {
    pub name: String,
    pub parts: Vec<Part>,
    /// The transform where it began.
    pub start: Mat4,
}

/// Requests kept for later, with the file that they stand in.
pub(super) type Inline = Arc<(PathBuf, Vec<Request>)>;

/// What is read as if it stood in the place of the request.
pub(super) enum Archive {
    File(PathBuf),
    Inline(Inline),
}

/// An archive within a file that has not ended yet.
pub(super) struct Recording {
    pub name: String,
    requests: Vec<Request>,
    /// Archives that began within it.
    open: usize,
}

impl Reader {
    /// Whether the request belongs to an archive within the file, which then is kept.
    pub(super) fn record(&mut self, request: &Request, path: &Path) -> Checked<bool> {
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

    pub(super) fn block(&mut self, request: &Request, path: &Path) -> Checked<bool> {
        let begin = |this: &mut Self, kind: &'static str, attributes: bool| {
            if this.blocks.len() >= MAX_BLOCKS {
                return Err(format!("blocks are nested more than {MAX_BLOCKS} deep"));
            }
            let attributes = attributes.then(|| this.attributes.clone());
            let options = (kind == "Frame").then(|| Box::new(Options::of(this)));
            this.blocks.push(Block { kind, transform: this.transform, attributes, options, line: request.line });
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
            "WorldBegin" if self.depth_only => {
                self.skipping = Some("WorldEnd");
                self.leave_out("WorldBegin of a depth map (by its Display)".into(), request.line, path);
            }
            "WorldBegin" => {
                begin(self, "World", true)?;
                self.camera_from_world = self.transform;
            }
            "AttributeEnd" => self.end("Attribute")?,
            "TransformEnd" => self.end("Transform")?,
            "SolidEnd" => self.end("Solid")?,
            "WorldEnd" => {
                self.end("World")?;
                // what follows is another picture, and frames around this one need not end
                self.ended = true;
                self.blocks.clear();
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
        if let Some(options) = block.options {
            options.restore(self);
        }
        Ok(())
    }
}
