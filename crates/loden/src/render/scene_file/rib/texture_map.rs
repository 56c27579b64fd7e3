//! Texture mapping of a measured material, from the parameters of its surface shader.

use glam::{Mat4, Vec3};

use super::request::{Parameters, RibResult};
use crate::render::{Mapping, TextureMap, Wrap};

/// The texture map; points and vectors are in the coordinates of the surface.
pub(super) fn texture_map(parameters: &Parameters, world_from_surface: Mat4) -> RibResult<TextureMap> {
    let wrap = match parameters.text("wrap") {
        None | Some("repeat") => Wrap::Repeat,
        Some("mirror") => Wrap::Mirror,
        Some("clamp") => Wrap::Clamp,
        Some("black") => Wrap::Black,
        Some(other) => return Err(format!("wrap: found {other:?}, expected repeat, mirror, clamp or black")),
    };
    let texture = TextureMap {
        scale: parameters.number("scale", 1.0),
        rotation_degrees: parameters.number("rotation", 0.0),
        mapping: mapping(parameters, world_from_surface)?,
        wrap,
        samples: parameters.number("samples", 1.0) as u32,
    };
    texture.check().map_err(|e| e.to_string())?;
    Ok(texture)
}

fn mapping(parameters: &Parameters, world_from_surface: Mat4) -> RibResult<Mapping> {
    let point = |name: &str, default: Vec3| world_from_surface.transform_point3(parameters.triple(name, default));
    let vector = |name: &str, default: Vec3| world_from_surface.transform_vector3(parameters.triple(name, default));
    Ok(match parameters.text("mapping") {
        None | Some("surface") => Mapping::Surface,
        Some("sphere") => Mapping::Sphere { centre: point("centre", Vec3::ZERO), axis: vector("axis", Vec3::Z) },
        Some("cylinder") => Mapping::Cylinder { centre: point("centre", Vec3::ZERO), axis: vector("axis", Vec3::Z) },
        Some("plane") => {
            // a shader cannot have parameters called u and v
            let edge = |name: &str, other: &str, default: Vec3| match parameters.get(name) {
                Some(_) => vector(name, default),
                None => vector(other, default),
            };
            let (u, v) = (edge("u", "edgeu", Vec3::X), edge("v", "edgev", Vec3::Y));
            Mapping::Plane { origin: point("origin", Vec3::ZERO), u, v }
        }
        Some("camera") => Mapping::Camera {
            position: point("from", Vec3::ZERO),
            target: point("to", Vec3::Z),
            up: vector("up", Vec3::Y),
            field_of_view_degrees: parameters.number("fov", 90.0),
        },
        Some("triplanar") => {
            // The projections keep the axes of world space; only position and size follow the surface's coordinates.
            let scale = world_from_surface.determinant().abs().cbrt();
            let size = parameters.number("size", 0.0) * scale;
            Mapping::Triplanar { origin: point("origin", Vec3::ZERO), size }
        }
        Some(other) => {
            let kinds = "surface, sphere, cylinder, plane, camera or triplanar";
            return Err(format!("mapping: found {other:?}, expected {kinds}"));
        }
    })
}
