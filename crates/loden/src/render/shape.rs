//! The shapes of bodies.

mod disc;
mod sphere;

use std::sync::Arc;

use glam::Vec3;

pub use disc::Disc;
pub use sphere::Sphere;

use super::bounds::Ball;
use super::bvh::{Bundle, Intersection, Triangles};
use super::hit::Hit;
use super::instance::Instance;
use super::mesh::Mesh;
use super::ray::Ray;
use super::traced::{Surface, Traced};

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

impl Shape {
    /// The only place that lists all shapes.
    #[inline]
    fn traced(&self) -> &dyn Traced {
        match self {
            Self::Sphere(sphere) => sphere,
            Self::Disc(disc) => disc,
            Self::Mesh(mesh) => mesh.as_ref(),
            Self::Instance(instance) => instance.as_ref(),
        }
    }

    /// [`Traced::closest`].
    #[cfg(test)]
    pub(super) fn closest(&self, ray: &Ray, t_max: f32) -> Option<Intersection> {
        self.traced().closest(ray, t_max)
    }

    /// [`Traced::closest_of`].
    #[inline]
    pub(super) fn closest_of(&self, bundle: &mut Bundle, triangles: &mut Triangles) -> u16 {
        self.traced().closest_of(bundle, triangles)
    }

    /// [`Traced::occluded_of`].
    #[inline]
    pub(super) fn occluded_of(&self, bundle: &Bundle) -> u16 {
        self.traced().occluded_of(bundle)
    }

    /// [`Traced::surface`].
    #[inline]
    pub(super) fn surface(&self, ray: &Ray, at: &Intersection) -> Surface {
        self.traced().surface(ray, at)
    }

    /// The surface where a ray beside another hits what the other one hit: [`Traced::beside`].
    pub(super) fn beside(&self, ray: &Ray, other: &Intersection) -> Option<Hit> {
        let at = self.traced().beside(ray, other)?;
        Some(self.surface(ray, &at).hit(-ray.direction))
    }

    /// A bounding box with room for rounding: lowest and highest coordinates.
    pub(super) fn extent(&self) -> [Vec3; 2] {
        let [low, high] = self.traced().extent();
        let room = 1e-5 * low.abs().max(high.abs()).max_element();
        [low - room, high + room]
    }

    /// A bounding sphere.
    pub fn bounds(&self) -> Ball {
        self.traced().bounds()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::bvh::{Bundle, RAYS, Triangles};
    use crate::render::ray::Ray;
    use crate::render::traced::Traced;
    use glam::Vec3;

    #[test]
    fn rays_together_find_what_each_finds_alone() {
        let shapes: [&dyn Traced; 2] = [
            &Sphere { centre: Vec3::new(0.1, 0.2, 0.3), radius: 0.8, axis: Vec3::Y },
            &Disc { centre: Vec3::new(0.2, -0.1, 0.0), radius: 0.9 },
        ];
        let mut bundle = Bundle::EMPTY;
        for lane in 0..RAYS {
            let phi = lane as f32;
            // some begin within, some miss, some end too early
            let origin = Vec3::new(phi.cos(), 0.5, phi.sin()) * (lane % 4) as f32;
            let direction = (Vec3::new(0.3 * phi.sin(), 0.1, 0.2) - origin).normalize();
            bundle.set(lane, &Ray { origin, direction }, [f32::INFINITY, 2.0, 1.0][lane % 3]);
        }
        for shape in shapes {
            let mut shortened = bundle.clone();
            let hits = shape.closest_of(&mut shortened, &mut Triangles::none());
            assert!(hits != 0 && hits != u16::MAX);
            for lane in 0..RAYS {
                let t_max = bundle.t_max.0[lane];
                let alone = shape.closest(&bundle.ray(lane), t_max);
                assert_eq!(alone.map_or(t_max, |found| found.t), shortened.t_max.0[lane]);
                assert_eq!(alone.is_some(), hits >> lane & 1 == 1);
            }
        }
    }
}
