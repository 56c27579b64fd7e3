//! The built-in sphere.

use glam::Vec3;

use super::{BuiltIn, Object};
use crate::render::{Camera, Shape, Sphere};

pub(super) const SPHERE: BuiltIn = BuiltIn {
    name: "sphere",
    doc: "A sphere; its texture wraps around a horizontal axis, so that the poles are hidden.",
    build: || {
        let shape = Shape::Sphere(Sphere { centre: Vec3::ZERO, radius: 1.0, axis: Vec3::X });
        let camera = Camera::around(Vec3::new(0.02, -0.10, 0.0), 1.0, 20.0, 0.0, 0.72);
        // u runs around the axis, downwards in front
        Ok(Object { camera, turn_degrees: 90.0, ..Object::standing(shape, -1.0, Vec::new()) })
    },
};
