//! A material of our own.

use std::f32::consts::PI;

use loden::glam::{Vec2, Vec3};
use loden::material::Material;

/// Velvet: a diffuse cloth with fibres that shine where it is seen or lit at grazing angles.
pub struct Velvet {
    /// Albedo of the cloth.
    pub colour: Vec3,
    /// How narrow the bright rim is.
    pub sharpness: f32,
}

impl Material for Velvet {
    fn apparent(&self, _: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return Vec3::ZERO;
        }
        let rim = (1.0 - wi.z).powf(self.sharpness) + (1.0 - wo.z).powf(self.sharpness);
        (self.colour + 0.25 * rim / PI) * wi.z
    }
}
