//! Bodies, lights and a camera.

use glam::Vec3;

use super::camera::Camera;
use super::environment::Environment;
use super::light::Light;
use super::shape::Shape;
use super::texture::TextureMap;
use crate::material::Material;

/// Everything that is rendered.
pub struct Scene<'a> {
    /// Bodies.
    pub bodies: Vec<Body<'a>>,
    /// Light sources.
    pub lights: Vec<Light>,
    /// Light from infinitely far away, from all directions.
    pub environment: Environment,
    /// Radiance of camera rays that hit nothing; `None` for that of the environment.
    pub background: Option<Vec3>,
    /// Camera.
    pub camera: Camera,
}

/// A shape wearing a material.
pub struct Body<'a> {
    /// Shape.
    pub shape: Shape,
    /// Material.
    pub material: &'a dyn Material,
    /// Name of the material in errors.
    pub material_name: String,
    /// Texture mapping of the material.
    pub texture: TextureMap,
}
