//! Texture mappings: texture coordinates from positions in world space.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::direction::Frame;
use crate::render::hit::Hit;
use crate::{Error, Result};

/// A texture mapping. Positions and lengths are in world units.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Mapping {
    /// The texture coordinates of the shape.
    #[default]
    Surface,
    /// Spherical: u repeats twice around the axis, so squares stay square at the equator; v runs from pole to pole.
    Sphere {
        /// Centre of the sphere.
        centre: Vec3,
        /// Direction from the lower to the upper pole, of any length.
        axis: Vec3,
    },
    /// Cylindrical: u repeats twice around the axis, v runs along it.
    Cylinder {
        /// The point where v = 0.
        centre: Vec3,
        /// Vector to the point where v = 1.
        axis: Vec3,
    },
    /// Planar: a parallel projection; one repeat of the material spans `u` and `v`.
    Plane {
        /// The point where u = v = 0.
        origin: Vec3,
        /// Edge of one repeat along u.
        u: Vec3,
        /// Edge of one repeat along v, perpendicular to `u`.
        v: Vec3,
    },
    /// Projective: one repeat of the material, projected as by a slide projector.
    Camera {
        /// Position of the projector.
        position: Vec3,
        /// The point that the centre of the material is projected to.
        target: Vec3,
        /// The up direction of the material.
        up: Vec3,
        /// Full angle of the projection, degrees.
        field_of_view_degrees: f32,
    },
    /// Triplanar: parallel projections along the three axes, blended by the direction of the normal.
    Triplanar {
        /// The point where u = v = 0.
        origin: Vec3,
        /// Length of one repeat.
        size: f32,
    },
}

/// Texture coordinates and their gradients in space.
struct Gradients {
    uv: Vec2,
    u: Vec3,
    v: Vec3,
}

impl Mapping {
    pub(super) fn check(&self) -> Result<()> {
        let (finite, extended) = match *self {
            Self::Surface => (true, true),
            Self::Sphere { centre, axis } | Self::Cylinder { centre, axis } => {
                (centre.is_finite() && axis.is_finite(), axis.length_squared().is_normal())
            }
            Self::Plane { origin, u, v } => {
                let square = u.dot(v).abs() < 1e-4 * u.length() * v.length();
                (
                    origin.is_finite() && u.is_finite() && v.is_finite(),
                    square && u.cross(v).length_squared().is_normal(),
                )
            }
            Self::Camera { position, target, up, field_of_view_degrees: fov } => {
                let view = target - position;
                let around = view.cross(up).length_squared().is_normal();
                (position.is_finite() && view.is_finite() && up.is_finite(), around && (0.1..=170.0).contains(&fov))
            }
            Self::Triplanar { origin, size } => (origin.is_finite(), size.is_normal() && size > 0.0),
        };
        if finite && extended {
            return Ok(());
        }
        let problem = format!(
            "found {self:?}, expected finite numbers, no zero lengths, no parallel directions, and u perpendicular to v"
        );
        Err(Error::parameter("mapping", problem))
    }

    /// The texture coordinates of a hit, the direction along the surface in which u increases and v is constant, and
    /// the handedness: 1 if v increases towards normal x tangent, else -1.
    ///
    /// # Model
    /// With the gradients g_u and g_v of the texture coordinates and the normal n, the direction is sign(s) g_v x n,
    /// where s = g_u . (g_v x n). The handedness is sign(s).
    pub(super) fn project(&self, hit: &Hit, random: impl FnOnce() -> f32) -> (Vec2, Vec3, f32) {
        let Gradients { uv, u, v } = self.gradients(hit, random);
        let along = v.cross(hit.normal);
        let side = u.dot(along);
        if !side.is_normal() {
            return (uv, hit.tangent, hit.handedness);
        }
        (uv, along * side.signum(), side.signum())
    }

    fn gradients(&self, hit: &Hit, random: impl FnOnce() -> f32) -> Gradients {
        let p = hit.position;
        match *self {
            Self::Surface => Gradients { uv: hit.uv, u: Vec3::ZERO, v: Vec3::ZERO },
            Self::Sphere { centre, axis } => {
                let (from, axis) = (p - centre, axis.normalize());
                let (turn, around) = around(from, axis);
                let out = from.normalize_or(axis);
                let theta = out.dot(axis).clamp(-1.0, 1.0).acos();
                let towards_pole = axis - out * out.dot(axis);
                let per_length = 1.0 / (PI * from.length().max(1e-20));
                let v = towards_pole.normalize_or_zero() * per_length;
                Gradients { uv: Vec2::new(2.0 * turn, 1.0 - theta / PI), u: around, v }
            }
            Self::Cylinder { centre, axis } => {
                let (from, square) = (p - centre, axis.length_squared());
                let (turn, around) = around(from, axis.normalize());
                Gradients { uv: Vec2::new(2.0 * turn, from.dot(axis) / square), u: around, v: axis / square }
            }
            Self::Plane { origin, u, v } => {
                let (u, v) = (u / u.length_squared(), v / v.length_squared());
                Gradients { uv: Vec2::new((p - origin).dot(u), (p - origin).dot(v)), u, v }
            }
            Self::Camera { position, target, up, field_of_view_degrees } => {
                let forward = (target - position).normalize();
                let right = forward.cross(up).normalize();
                let up = right.cross(forward);
                let depth = (p - position).dot(forward);
                let width = 2.0 * (0.5 * field_of_view_degrees.to_radians()).tan() * depth;
                let (x, y) = ((p - position).dot(right) / width, (p - position).dot(up) / width);
                let slope = forward / depth;
                // Nothing is projected behind the projector.
                let uv = if depth > 0.0 { Vec2::new(0.5 + x, 0.5 + y) } else { Vec2::splat(-1.0) };
                Gradients { uv, u: right / width - x * slope, v: up / width - y * slope }
            }
            Self::Triplanar { origin, size } => triplanar((p - origin) / size, hit.normal, random()),
        }
    }
}

/// The fraction of a turn around an axis, 0 to 1, and the gradient of twice that fraction.
fn around(from: Vec3, axis: Vec3) -> (f32, Vec3) {
    let turn = crate::direction::phi(Frame::from_normal(axis).local(from)) / TAU;
    let across = axis.cross(from);
    (turn, across / (PI * across.length_squared().max(1e-20)))
}

/// Draws one of the three projections with the fourth powers of the normal's components; the expectation is their
/// blend.
fn triplanar(p: Vec3, normal: Vec3, random: f32) -> Gradients {
    let weight = (normal * normal) * (normal * normal);
    let at = random * weight.element_sum();
    let axis = if at < weight.x {
        0
    } else if at < weight.x + weight.y {
        1
    } else {
        2
    };
    let side = 1.0f32.copysign(normal[axis]);
    // Seen from outside, v points up and u to the right.
    let (u, v) = [(-Vec3::Z * side, Vec3::Y), (Vec3::X, -Vec3::Z * side), (Vec3::X * side, Vec3::Y)][axis];
    Gradients { uv: Vec2::new(p.dot(u), p.dot(v)), u, v }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit() -> impl Strategy<Value = Vec3> {
        (0.0f32..3.1, 0.0f32..6.2).prop_map(|(t, p)| crate::direction::from_angles(t, p))
    }

    fn hit(position: Vec3, normal: Vec3) -> Hit {
        let uv = Vec2::ZERO;
        Hit { position, origin: position, geometric: normal, normal, tangent: Vec3::X, handedness: 1.0, uv }
    }

    fn mappings() -> [Mapping; 5] {
        let (position, target, up) = (Vec3::new(0.0, 1.0, 6.0), Vec3::ZERO, Vec3::Y);
        let axis = Vec3::new(0.3, 1.4, 0.2);
        [
            Mapping::Sphere { centre: Vec3::new(0.1, 0.2, 0.0), axis },
            Mapping::Cylinder { centre: Vec3::new(0.1, 0.2, 0.0), axis },
            Mapping::Plane { origin: Vec3::ONE, u: Vec3::new(2.0, 0.0, 0.0), v: Vec3::new(0.0, 0.5, 0.5) },
            Mapping::Camera { position, target, up, field_of_view_degrees: 40.0 },
            Mapping::Triplanar { origin: Vec3::ONE, size: 0.7 },
        ]
    }

    proptest! {
        #[test]
        fn frames_follow_the_coordinates(at in unit(), normal in unit(), random in 0.0f32..1.0) {
            for mapping in mappings() {
                let project = |p: Vec3| mapping.project(&hit(p, normal), || random);
                let (uv, tangent, side) = project(at);
                let frame = Frame::from_normal_tangent(normal, tangent);
                let step = |d: Vec3| (project(at + 2e-3 * d).0 - uv) / 2e-3;
                let (along_u, along_v) = (step(frame.tangent), step(side * frame.bitangent));
                // Skip seams and surfaces seen edge-on.
                prop_assume!(along_u.length() < 20.0 && along_v.length() < 20.0 && along_u.x.abs() > 0.05);
                prop_assume!(along_v.y.abs() > 0.05);
                prop_assert!(along_u.x > 0.0 && along_u.y.abs() < 0.05, "{mapping:?}: {along_u}");
                prop_assert!(along_v.y > 0.0, "{mapping:?}: {along_v}");
            }
        }
    }

    #[test]
    fn texture_coordinates_of_known_points() {
        let [sphere, cylinder, plane, camera, triplanar] = mappings();
        let uv = |mapping: &Mapping, p: Vec3, n: Vec3| mapping.project(&hit(p, n), || 0.5).0;
        let near = |a: Vec2, b: Vec2| assert!((a - b).length() < 1e-5, "{a}, not {b}");
        let (centre, axis) = (Vec3::new(0.1, 0.2, 0.0), Vec3::new(0.3, 1.4, 0.2));
        assert!((uv(&sphere, centre + axis, axis.normalize()).y - 1.0).abs() < 1e-3);
        assert!((uv(&cylinder, centre + 0.25 * axis, Vec3::X).y - 0.25).abs() < 1e-5);
        near(uv(&plane, Vec3::new(2.0, 1.25, 1.25), Vec3::Z), Vec2::splat(0.5));
        near(uv(&camera, Vec3::ZERO, Vec3::Z), Vec2::splat(0.5));
        let edge = 20f32.to_radians().tan() * 37f32.sqrt();
        near(uv(&camera, Vec3::new(edge, 0.0, 0.0), Vec3::Z), Vec2::new(1.0, 0.5));
        near(uv(&triplanar, Vec3::new(1.35, 1.7, 9.0), Vec3::Z), Vec2::new(0.5, 1.0));
        near(uv(&triplanar, Vec3::new(1.35, 1.7, 9.0), -Vec3::Z), Vec2::new(-0.5, 1.0));
        mappings().iter().for_each(|mapping| mapping.check().unwrap());
        for wrong in [
            Mapping::Sphere { centre: Vec3::ZERO, axis: Vec3::ZERO },
            Mapping::Plane { origin: Vec3::ZERO, u: Vec3::X, v: Vec3::X },
            Mapping::Triplanar { origin: Vec3::ZERO, size: 0.0 },
            Mapping::Triplanar { origin: Vec3::NAN, size: 1.0 },
        ] {
            assert!(wrong.check().unwrap_err().to_string().starts_with("mapping"));
        }
    }
}
