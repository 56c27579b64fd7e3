//! Area lights from shapes.

use glam::{Mat4, Vec3};

use crate::render::geometry::Quadric;
use crate::render::{Emitter, Flat};

/// The emitter of a full disk or sphere; `None` for other quadrics and non-uniformly scaled spheres.
pub(super) fn of_quadric(quadric: &Quadric, world_from_object: Mat4, inside_out: bool) -> Option<Emitter> {
    match *quadric {
        Quadric::Disk { height, radius, sweep } if sweep.abs() >= 360.0 => {
            let [x, y] = [Vec3::X, Vec3::Y].map(|axis| world_from_object.transform_vector3(axis * radius));
            let centre = world_from_object.transform_point3(Vec3::Z * height);
            flat(centre, x, y, world_from_object, inside_out).map(Emitter::Disk)
        }
        Quadric::Sphere { radius, z_min, z_max, sweep }
            if z_min <= -radius && z_max >= radius && sweep.abs() >= 360.0 =>
        {
            let lengths = [Vec3::X, Vec3::Y, Vec3::Z].map(|a| world_from_object.transform_vector3(a * radius));
            let [a, b, c] = lengths;
            let radius = a.length();
            let even = |v: f32| v.abs() < 1e-4 * radius;
            let is_round = even(b.length() - radius) && even(c.length() - radius);
            let is_right = [a.dot(b), b.dot(c), c.dot(a)].iter().all(|d| d.abs() < 1e-4 * radius * radius);
            let centre = world_from_object.transform_point3(Vec3::ZERO);
            (is_round && is_right && !inside_out && radius > 0.0).then_some(Emitter::Sphere { centre, radius })
        }
        _ => None,
    }
}

/// The emitter of a parallelogram; `None` for other polygons.
pub(super) fn of_polygon(corners: &[Vec3], world_from_object: Mat4, inside_out: bool) -> Option<Emitter> {
    let [a, b, c, d] = <[Vec3; 4]>::try_from(corners).ok()?.map(|p| world_from_object.transform_point3(p));
    let (x, y) = (0.5 * (b - a), 0.5 * (d - a));
    let is_parallelogram = (a + c - b - d).length() <= 1e-4 * (x.length() + y.length());
    let flat = flat(0.5 * (a + c), x, y, world_from_object, inside_out).filter(|_| is_parallelogram)?;
    Some(Emitter::Rectangle(flat))
}

/// A flat emitter whose lit side is the outside of the shape, even if the transform mirrors.
fn flat(centre: Vec3, x: Vec3, y: Vec3, world_from_object: Mat4, inside_out: bool) -> Option<Flat> {
    let mirrored = world_from_object.determinant() < 0.0;
    let [x, y] = if mirrored != inside_out { [y, x] } else { [x, y] };
    x.cross(y).length_squared().is_normal().then_some(Flat { centre, x, y })
}
