//! What rays hit: analytic shapes and meshes.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use bytemuck::Zeroable;
use glam::{Vec2, Vec3};

use super::Ray;
use super::bvh::{Bundle, RAYS, TriangleHit, Triangles};
use super::instance::Instance;
use super::mesh::Mesh;
use super::surface::{Hit, Place};
use crate::direction::Frame;

/// Centre and radius of a ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    /// Centre, world coordinates.
    pub centre: Vec3,
    /// Radius.
    pub radius: f32,
}

impl Ball {
    /// A ball around points, centred on their box.
    pub fn around(points: &[Vec3]) -> Self {
        let [low, high] = super::mesh::extent(points);
        let centre = if points.is_empty() { Vec3::ZERO } else { 0.5 * (low + high) };
        let radius = points.iter().map(|p| p.distance(centre)).fold(0.0, f32::max);
        Self { centre, radius }
    }
}

/// A shape in world coordinates.
#[derive(Debug, Clone)]
pub enum Shape {
    /// A sphere.
    Sphere(Sphere),
    /// A horizontal disc.
    Disc(Disc),
    /// A triangle mesh; shared, because it may be large.
    Mesh(Arc<Mesh>),
    /// A mesh moved by a transform.
    Instance(Box<Instance>),
}

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

/// A horizontal disc that faces up; texture coordinates are x and -z in units of its radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Centre.
    pub centre: Vec3,
    /// Radius.
    pub radius: f32,
}

/// Where a ray met a shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Meeting {
    /// At this distance.
    At(f32),
    /// On this triangle.
    Triangle(TriangleHit),
}

impl Meeting {
    #[inline]
    pub(super) fn t(&self) -> f32 {
        match self {
            Self::At(t) => *t,
            Self::Triangle(hit) => hit.t,
        }
    }
}

impl Shape {
    /// The nearest meeting with 0 < t < `t_max`.
    #[inline]
    pub(super) fn closest(&self, ray: &Ray, t_max: f32) -> Option<Meeting> {
        match self {
            Self::Sphere(sphere) => sphere.closest(ray, t_max).map(Meeting::At),
            Self::Disc(disc) => disc.closest(ray, t_max).map(Meeting::At),
            Self::Mesh(mesh) => mesh.closest(ray, t_max).map(Meeting::Triangle),
            Self::Instance(instance) => instance.closest(ray, t_max).map(Meeting::Triangle),
        }
    }

    /// Shortens the rays of a bundle to their nearest meetings; a bit for each that met the shape. Of triangles it says
    /// which.
    pub(super) fn closest_of(&self, bundle: &mut Bundle, met: &mut Triangles) -> u16 {
        let mut one_by_one = |closest: &dyn Fn(&Ray, f32) -> Option<f32>| {
            let mut hits = 0;
            for lane in 0..RAYS {
                if let Some(t) = closest(&bundle.ray(lane), bundle.t_max.0[lane]) {
                    bundle.t_max.0[lane] = t;
                    hits |= 1 << lane;
                }
            }
            hits
        };
        match self {
            Self::Sphere(sphere) => one_by_one(&|ray, t_max| sphere.closest(ray, t_max)),
            Self::Disc(disc) => one_by_one(&|ray, t_max| disc.closest(ray, t_max)),
            Self::Mesh(mesh) => mesh.closest_of(bundle, met),
            Self::Instance(instance) => instance.closest_of(bundle, met),
        }
    }

    /// A bit for each ray of a bundle that meets the shape.
    pub(super) fn occluded_of(&self, bundle: &Bundle) -> u16 {
        match self {
            Self::Sphere(_) | Self::Disc(_) => self.closest_of(&mut bundle.clone(), &mut Triangles::none()),
            Self::Mesh(mesh) => mesh.occluded_of(bundle),
            Self::Instance(instance) => instance.occluded_of(bundle),
        }
    }

    /// The surface at a meeting of this shape with this ray.
    #[inline]
    pub(super) fn surface(&self, ray: &Ray, meeting: &Meeting) -> Hit {
        let position = ray.origin + ray.direction * meeting.t();
        match (self, meeting) {
            (Self::Sphere(sphere), Meeting::At(_)) => sphere.surface(position, -ray.direction),
            (Self::Disc(disc), Meeting::At(_)) => disc.surface(position, -ray.direction),
            (shape, Meeting::Triangle(hit)) => shape.place(hit).surface(-ray.direction),
            (Self::Mesh(_) | Self::Instance(_), Meeting::At(_)) => unreachable!("a mesh is met on a triangle"),
        }
    }

    /// A place on a triangle of this shape, in world coordinates.
    #[inline(always)]
    pub(super) fn place(&self, hit: &TriangleHit) -> Place {
        match self {
            Self::Mesh(mesh) => mesh.place(hit),
            Self::Instance(instance) => instance.place(hit),
            Self::Sphere(_) | Self::Disc(_) => Place::zeroed(),
        }
    }

    /// The surface where a ray meets it beside another: of a mesh the plane of the triangle that the other one met.
    pub(super) fn beside(&self, ray: &Ray, meeting: &Meeting) -> Option<Hit> {
        let meeting = match (self, meeting) {
            (Self::Mesh(mesh), Meeting::Triangle(hit)) => Meeting::Triangle(mesh.plane(ray, hit.triangle)?),
            (Self::Instance(instance), Meeting::Triangle(hit)) => Meeting::Triangle(instance.plane(ray, hit.triangle)?),
            _ => self.closest(ray, f32::INFINITY)?,
        };
        Some(self.surface(ray, &meeting))
    }

    /// The corners of a box that holds the shape with room for rounding: lowest and highest coordinates.
    pub(super) fn extent(&self) -> [Vec3; 2] {
        let [low, high] = match self {
            Self::Sphere(s) => [s.centre - s.radius, s.centre + s.radius],
            Self::Disc(d) => {
                let reach = Vec3::new(d.radius, 0.0, d.radius);
                [d.centre - reach, d.centre + reach]
            }
            Self::Mesh(mesh) => mesh.extent(),
            Self::Instance(instance) => instance.extent(),
        };
        let room = 1e-5 * low.abs().max(high.abs()).max_element();
        [low - room, high + room]
    }

    /// A ball that holds the shape.
    pub fn bounds(&self) -> Ball {
        match self {
            Self::Sphere(s) => Ball { centre: s.centre, radius: s.radius },
            Self::Disc(d) => Ball { centre: d.centre, radius: d.radius },
            Self::Mesh(mesh) => mesh.bounds(),
            Self::Instance(instance) => instance.bounds(),
        }
    }
}

impl Sphere {
    #[inline]
    pub(super) fn closest(&self, ray: &Ray, t_max: f32) -> Option<f32> {
        // from the point nearest to the centre, where the difference of squares loses least
        let to_centre = self.centre - ray.origin;
        let middle = to_centre.dot(ray.direction);
        let beside = to_centre - ray.direction * middle;
        let rest = self.radius * self.radius - beside.length_squared();
        if rest < 0.0 {
            return None;
        }
        let half = rest.sqrt();
        let within = |t: &f32| *t > 0.0 && *t < t_max;
        Some(middle - half).filter(within).or(Some(middle + half).filter(within))
    }

    #[inline]
    fn surface(&self, position: Vec3, viewer: Vec3) -> Hit {
        let normal = (position - self.centre).normalize_or(self.axis);
        let position = self.centre + normal * self.radius;
        let frame = Frame::from_normal(self.axis);
        let local = frame.local(normal);
        let uv = Vec2::new(2.0 * crate::direction::phi(local) / TAU, 1.0 - crate::direction::theta(local) / PI);
        let geometric = if normal.dot(viewer) < 0.0 { -normal } else { normal };
        // where u grows: around the axis; v grows towards it, so (u, v, outwards) is right-handed
        Hit { position, lifted: position, geometric, normal, tangent: self.axis.cross(normal), handedness: 1.0, uv }
    }
}

impl Disc {
    #[inline]
    fn closest(&self, ray: &Ray, t_max: f32) -> Option<f32> {
        let t = (self.centre.y - ray.origin.y) / ray.direction.y;
        let p = ray.origin + ray.direction * t - self.centre;
        (t > 0.0 && t < t_max && p.x * p.x + p.z * p.z <= self.radius * self.radius).then_some(t)
    }

    #[inline]
    fn surface(&self, position: Vec3, viewer: Vec3) -> Hit {
        let position = Vec3::new(position.x, self.centre.y, position.z);
        let p = (position - self.centre) / self.radius;
        let geometric = if viewer.y < 0.0 { -Vec3::Y } else { Vec3::Y };
        Hit {
            position,
            lifted: position,
            geometric,
            normal: Vec3::Y,
            tangent: Vec3::X,
            handedness: 1.0,
            uv: Vec2::new(p.x, -p.z),
        }
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
            let surface = |n: Vec3| sphere.surface(sphere.centre + 2.0 * n, n);
            let hit = surface(at);
            let frame = Frame::from_normal_tangent(hit.normal, hit.tangent);
            let step = |d: Vec3| surface((at + 1e-3 * d).normalize()).uv - hit.uv;
            let (along_u, along_v) = (step(frame.tangent), step(frame.bitangent));
            prop_assume!(along_u.length() < 0.5); // not across the seam
            prop_assert!(along_u.x > 0.0 && along_u.y.abs() < 0.02 * along_u.x, "{along_u}");
            prop_assert!(along_v.y > 0.0 && along_v.x.abs() < 0.02 * along_v.y, "{along_v}");
        }

        #[test]
        fn spheres_are_hit_on_their_surface(from in unit(), towards in unit(), distance in 0.0f32..30.0) {
            let sphere = Sphere { centre: Vec3::ZERO, radius: 1.5, axis: Vec3::Y };
            let ray = Ray { origin: from * distance, direction: (towards * 1.4 - from * distance).normalize() };
            let t = sphere.closest(&ray, f32::INFINITY);
            prop_assert!(t.is_some());
            let p = ray.origin + ray.direction * t.unwrap_or(0.0);
            prop_assert!((p.length() - 1.5).abs() < 1e-4);
        }
    }

    #[test]
    fn discs_end_at_their_radius() {
        let disc = Disc { centre: Vec3::new(0.0, -1.0, 0.0), radius: 2.0 };
        let ray = |x: f32| Ray { origin: Vec3::new(x, 1.0, 0.0), direction: -Vec3::Y };
        assert_eq!(disc.closest(&ray(1.9), f32::INFINITY), Some(2.0));
        assert_eq!(disc.closest(&ray(2.1), f32::INFINITY), None);
        assert_eq!(disc.closest(&Ray { origin: Vec3::ZERO, direction: Vec3::X }, f32::INFINITY), None);
    }
}
