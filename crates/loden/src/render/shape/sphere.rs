//! Spheres.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::direction::Frame;
use crate::render::bounds::Ball;
use crate::render::bvh::{Bundle, Intersection, Triangles};
use crate::render::hit::{Hit, offset};
use crate::render::mesh::MeshData;
use crate::render::ray::Ray;
use crate::render::traced::{Closed, Surface, Traced, shorten};

/// A sphere with u around its axis (two repeats, so that a square texture stays square at the equator)
/// and v from pole to pole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub centre: Vec3,
    /// Radius.
    pub radius: f32,
    /// The axis, a unit vector; v grows along it.
    pub axis: Vec3,
}

impl Sphere {
    /// Triangles with its vertices and their normals and texture coordinates: `around` segments around the axis, half as many
    /// from pole to pole.
    pub fn triangles(&self, around: usize) -> MeshData {
        let (columns, rows) = (around.max(3), around.div_ceil(2).max(2));
        let frame = Frame::from_normal(self.axis);
        let mut data = MeshData::default();
        for (row, column) in (0..=rows).flat_map(|row| (0..=columns).map(move |column| (row, column))) {
            let (down, turn) = (row as f32 / rows as f32, column as f32 / columns as f32);
            let normal = frame.world(crate::direction::from_angles(PI * down, TAU * turn));
            data.positions.push(self.centre + normal * self.radius);
            data.normals.push(normal);
            data.uvs.push(Vec2::new(2.0 * turn, 1.0 - down));
        }
        let vertex = |row: usize, column: usize| (row * (columns + 1) + column) as u32;
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(down, right)| vertex(row + down, column + right));
            let [a, b, c, d] = corners;
            data.triangles.extend([[a, b, c], [a, c, d]]);
        }
        data
    }

    #[inline]
    fn hit(&self, position: Vec3, viewer: Vec3) -> Hit {
        let normal = (position - self.centre).normalize_or(self.axis);
        let position = self.centre + normal * self.radius;
        let frame = Frame::from_normal(self.axis);
        let local = frame.local(normal);
        let uv = Vec2::new(2.0 * crate::direction::phi(local) / TAU, 1.0 - crate::direction::theta(local) / PI);
        let geometric = if normal.dot(viewer) < 0.0 { -normal } else { normal };
        // where u grows: around the axis; v grows towards it, so (u, v, outwards) is right-handed
        let origin = offset(position, geometric, self.centre.abs() + self.radius);
        Hit { position, origin, geometric, normal, tangent: self.axis.cross(normal), handedness: 1.0, uv }
    }
}

impl Closed for Sphere {
    #[inline(always)]
    fn distance(&self, ray: &Ray, t_max: f32) -> f32 {
        // from the point nearest to the centre, where the difference of squares cancels least
        let to_centre = self.centre - ray.origin;
        let middle = to_centre.dot(ray.direction);
        let beside = to_centre - ray.direction * middle;
        // NaN for rays that miss, which fails every comparison
        let half = (self.radius * self.radius - beside.length_squared()).sqrt();
        let (near, far) = (middle - half, middle + half);
        let far = if far > 0.0 && far < t_max { far } else { f32::INFINITY };
        if near > 0.0 && near < t_max { near } else { far }
    }
}

impl Traced for Sphere {
    fn closest(&self, ray: &Ray, t_max: f32) -> Option<Intersection> {
        Intersection::within(self.distance(ray, t_max))
    }

    fn closest_of(&self, bundle: &mut Bundle, _triangles: &mut Triangles) -> u16 {
        shorten(self, bundle)
    }

    fn surface(&self, ray: &Ray, at: &Intersection) -> Surface {
        Surface::Smooth(self.hit(ray.origin + ray.direction * at.t, -ray.direction))
    }

    fn extent(&self) -> [Vec3; 2] {
        [self.centre - self.radius, self.centre + self.radius]
    }

    fn bounds(&self) -> Ball {
        Ball { centre: self.centre, radius: self.radius }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit() -> impl Strategy<Value = Vec3> {
        (0.0f32..3.1, 0.0f32..6.2).prop_map(|(t, p)| crate::direction::from_angles(t, p))
    }

    proptest! {
        #[test]
        fn frames_follow_the_texture_coordinates(at in unit(), axis in unit()) {
            prop_assume!(at.cross(axis).length() > 0.1);
            let sphere = Sphere { centre: Vec3::new(1.0, 2.0, 3.0), radius: 2.0, axis };
            let surface = |n: Vec3| sphere.hit(sphere.centre + 2.0 * n, n);
            let hit = surface(at);
            let frame = Frame::from_normal_tangent(hit.normal, hit.tangent);
            let step = |d: Vec3| surface((at + 1e-3 * d).normalize()).uv - hit.uv;
            let (along_u, along_v) = (step(frame.tangent), step(frame.bitangent));
            prop_assume!(along_u.length() < 0.5); // not across the seam
            prop_assert!(along_u.x > 0.0 && along_u.y.abs() < 0.02 * along_u.x, "{along_u}");
            prop_assert!(along_v.y > 0.0 && along_v.x.abs() < 0.02 * along_v.y, "{along_v}");
        }

        #[test]
        fn triangles_have_the_texture_coordinates_of_the_sphere_and_face_outwards(axis in unit()) {
            let sphere = Sphere { centre: Vec3::new(1.0, 2.0, 3.0), radius: 2.0, axis };
            let data = sphere.triangles(24);
            prop_assert_eq!((data.positions.len(), data.triangles.len()), (25 * 13, 2 * 24 * 12));
            for row in 1..12 {
                // away from the seam
                for k in (1..24).map(|column| row * 25 + column) {
                    let uv = sphere.hit(data.positions[k], data.normals[k]).uv;
                    prop_assert!(uv.distance(data.uvs[k]) < 1e-4, "{uv} {}", data.uvs[k]);
                }
            }
            for triangle in data.triangles {
                let [a, b, c] = triangle.map(|k| data.positions[k as usize]);
                prop_assert!((b - a).cross(c - a).dot(a + b + c - 3.0 * sphere.centre) > -1e-5);
            }
        }

        #[test]
        fn spheres_are_hit_on_their_surface(from in unit(), towards in unit(), distance in 0.0f32..30.0) {
            let sphere = Sphere { centre: Vec3::ZERO, radius: 1.5, axis: Vec3::Y };
            let ray = Ray { origin: from * distance, direction: (towards * 1.4 - from * distance).normalize() };
            let t = sphere.distance(&ray, f32::INFINITY);
            prop_assert!(t.is_finite());
            let p = ray.origin + ray.direction * t;
            prop_assert!((p.length() - 1.5).abs() < 1e-4);
        }
    }
}
