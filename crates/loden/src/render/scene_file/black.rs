//! Explains why the picture of a scene is black.

use glam::{Vec2, Vec3};

use super::SceneFile;
use crate::material::{Material, OwnLight};
use crate::picture::Picture;
use crate::progress::Silent;
use crate::render::{Ball, Body, Environment, Scene, Settings, render};

/// Pixels below this are black.
const DARK: f32 = 0.01;

/// A picture is not black if one in this many pixels is brighter.
const ONE_IN: usize = 500;

/// Width and height of the picture for testing whether shapes are in view.
const TRIAL: usize = 64;

/// A material that makes its shape visible.
struct White;

impl Material for White {
    fn apparent(&self, _: Vec2, _: Vec3, _: Vec3) -> Vec3 {
        Vec3::ZERO
    }

    fn only_reflects(&self) -> bool {
        false
    }

    fn own(&self, _: Vec2, _: Vec3) -> OwnLight {
        OwnLight { shown: Vec3::ONE, ..OwnLight::NONE }
    }
}

impl SceneFile {
    /// The reason why a picture of the scene shows nothing; `None` if it shows something.
    pub fn why_black(&self, picture: &Picture) -> Option<String> {
        let bright = picture.rgb.iter().filter(|c| c.max_element() >= DARK).count();
        let is_even = picture.rgb.iter().all(|c| *c == picture.rgb[0]);
        if bright * ONE_IN >= picture.rgb.len() && !is_even {
            return None;
        }
        let what = if bright > 0 { "the picture has one colour" } else { "the picture is black" };
        if self.bodies.is_empty() {
            return Some(format!("{what}: the scene has no shapes"));
        }
        let scene = self.scene();
        let white = |body: Body<'_>| Body {
            shape: body.shape,
            material: &White,
            material_name: String::new(),
            texture: Default::default(),
        };
        let shown = Scene {
            bodies: scene.bodies.into_iter().map(white).collect(),
            lights: Vec::new(),
            environment: Environment::Dark,
            background: Some(Vec3::ZERO),
            camera: self.camera,
        };
        let settings = Settings { width: TRIAL, height: TRIAL, spp: 1, depth: 1, seed: 0 };
        let seen = render(&shown, &settings, &Silent).ok()?.rgb.iter().filter(|c| **c != Vec3::ZERO).count();
        let [_, _, backward] = self.camera.axes();
        let is_behind = |ball: &Ball| (ball.centre - self.camera.position).dot(backward) > ball.radius;
        Some(match (seen, self.lights.len(), &self.environment) {
            (0, ..) if self.bodies.iter().all(|body| is_behind(&body.shape.bounds())) => {
                format!("{what}: all shapes lie behind the camera")
            }
            (0, ..) => format!("{what}: the camera sees none of the shapes"),
            _ if bright > 0 => format!("{what}: shapes fill {} % of it", (100 * seen).div_ceil(TRIAL * TRIAL)),
            (_, 0, Environment::Dark) => format!("{what}: the shapes in view are black, and there is no light"),
            _ => format!("{what}: shapes fill {} % of it, but they are black, or no light reaches them", {
                (100 * seen).div_ceil(TRIAL * TRIAL)
            }),
        })
    }
}
