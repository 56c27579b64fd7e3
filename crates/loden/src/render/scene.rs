//! Bodies, lights and a camera.

use glam::Vec3;

use super::camera::Camera;
use super::environment::Environment;
use super::light::Light;
use super::shape::Shape;
use super::texture::TextureMap;
use crate::material::Material;

/// Everything a picture is made from.
pub struct Scene<'a> {
    /// What can be seen.
    pub bodies: Vec<Body<'a>>,
    /// What sheds light.
    pub lights: Vec<Light>,
    /// Light from all around.
    pub environment: Environment,
    /// The radiance the camera sees where there is nothing, if it is not that of the environment.
    pub background: Option<Vec3>,
    /// From where it is seen.
    pub camera: Camera,
}

/// A shape wearing a material.
pub struct Body<'a> {
    /// Where rays hit it.
    pub shape: Shape,
    /// What it wears.
    pub material: &'a dyn Material,
    /// What errors call the material.
    pub material_name: String,
    /// How the material lies on the shape.
    pub texture: TextureMap,
}
