//! The worlds of a file, and which of them is drawn.

use std::path::Path;

use glam::Vec3;

use super::Reader;
use super::request::{Request, RibResult, Step};
use super::structure::shape_requests;
use crate::render::scene_file::SceneFile;
use crate::render::{Environment, Light};

/// What a world is for, by its `Display`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A picture.
    Picture,
    /// A depth map or shadow map.
    Depth,
    /// No picture: textures or point clouds are computed.
    Bake,
}

impl Kind {
    /// By the type and the mode of a `Display`.
    pub(super) fn of_display(kind: &str, mode: &str) -> Self {
        match (kind, mode) {
            ("zfile" | "shadow" | "deepshad" | "zframebuffer", _) | (_, "z") => Self::Depth,
            ("null", _) => Self::Bake,
            _ => Self::Picture,
        }
    }
}

/// A world of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct World {
    pub kind: Kind,
    pub line: usize,
    /// Number of requests that draw something.
    pub shapes: usize,
}

/// The world to draw of those in a file: the last picture with shapes, else the last world with shapes.
pub(super) fn choose(worlds: &[World]) -> Option<usize> {
    let last = |accept: &dyn Fn(&World) -> bool| worlds.iter().rposition(|world| world.shapes > 0 && accept(world));
    last(&|world| world.kind == Kind::Picture).or_else(|| last(&|_| true))
}

impl Reader {
    /// Whether the requests of the current world are skipped.
    pub(super) fn is_skipped(&self) -> bool {
        self.in_other_world || self.branches.last().is_some_and(|branch| !branch.active)
    }

    /// Counts a request of a world that is not drawn.
    pub(super) fn count(&mut self, request: &Request) {
        if request.name == "WorldEnd" {
            self.in_other_world = false;
        } else if let Some(world) = self.worlds.last_mut() {
            world.shapes += usize::from(shape_requests(&request.name));
        }
    }

    pub(super) fn begin_world(&mut self, request: &Request, path: &Path) -> Step<()> {
        let number = self.worlds.len();
        self.worlds.push(World { kind: self.kind, line: request.line, shapes: 0 });
        let is_drawn = match self.wanted {
            Some(wanted) => wanted == number,
            None => self.drawn.is_none() && self.kind == Kind::Picture,
        };
        if !is_drawn {
            if self.kind == Kind::Depth && self.drawn.is_none() {
                self.ignore("the world of a depth map (see its Display)".into(), request.line, path);
            }
            self.in_other_world = true;
            return Ok(());
        }
        self.begin("World", request.line)?;
        self.camera_from_world = self.transform;
        Ok(())
    }

    /// Ends the world that is drawn. What follows is another picture.
    pub(super) fn end_world(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        if !self.blocks.iter().any(|block| block.kind == "World") {
            return Err("there is no WorldBegin before it".into());
        }
        // close what is still open while it can be noted
        while let Some(block) = self.blocks.last()
            && block.kind != "World"
        {
            let (kind, line) = (block.kind, block.line);
            self.note(format!("WorldEnd closes the {kind}Begin of line {line}"), request.line, path);
            self.end(kind, request, path)?;
        }
        if self.scene.bodies.is_empty() && self.scene.lights.iter().all(|light| !matches!(light, Light::Area(_))) {
            if self.wanted.is_none() {
                // another world may have shapes
                return self.end("World", request, path);
            }
        } else if let Some(world) = self.worlds.last_mut() {
            world.shapes += 1;
        }
        let scene = self.complete(path)?;
        let (camera, settings, background) = (scene.camera, scene.settings, scene.background);
        self.drawn = Some(scene);
        self.scene = SceneFile::empty(camera);
        (self.scene.settings, self.scene.background) = (settings, background);
        (self.ambient, self.scene.environment) = (Vec3::ZERO, Environment::Dark);
        self.ended = self.wanted.is_some() && !self.counts_worlds;
        self.end("World", request, path)
    }
}
