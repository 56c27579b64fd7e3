//! The interface of a shape that can be traced.

use glam::Vec3;

use super::bounds::Ball;
use super::bvh::{Bundle, Intersection, RAYS, Row, Triangles};
use super::hit::{Hit, Place};
use super::ray::Ray;
use crate::simd::wide;

/// A shape in world coordinates.
pub(super) trait Traced {
    /// The nearest intersection with 0 < t < `t_max`.
    fn closest(&self, ray: &Ray, t_max: f32) -> Option<Intersection>;

    /// Shortens the rays of a bundle to their nearest intersections. Returns a bit for each ray that hit the shape.
    /// Shapes made of triangles record which triangles were hit.
    fn closest_of(&self, bundle: &mut Bundle, _triangles: &mut Triangles) -> u16 {
        let mut hits = 0;
        for lane in 0..RAYS {
            if let Some(found) = self.closest(&bundle.ray(lane), bundle.t_max.0[lane]) {
                bundle.t_max.0[lane] = found.t;
                hits |= 1 << lane;
            }
        }
        hits
    }

    /// Returns a bit for each ray of a bundle that hits the shape.
    fn occluded_of(&self, bundle: &Bundle) -> u16 {
        self.closest_of(&mut bundle.clone(), &mut Triangles::none())
    }

    /// The surface at an intersection with this ray.
    fn surface(&self, ray: &Ray, at: &Intersection) -> Surface;

    /// The intersection of a neighbouring ray with the surface hit by a camera ray; for a mesh, with the plane of the
    /// triangle.
    fn beside(&self, ray: &Ray, _other: &Intersection) -> Option<Intersection> {
        self.closest(ray, f32::INFINITY)
    }

    /// The bounding box: lowest and highest coordinates.
    fn extent(&self) -> [Vec3; 2];

    /// A bounding sphere.
    fn bounds(&self) -> Ball;
}

/// A shape that one formula without branches finds, so that a loop over rays vectorises.
pub(super) trait Closed {
    /// The nearest distance along a ray with 0 < t < `t_max`, otherwise infinity.
    fn distance(&self, ray: &Ray, t_max: f32) -> f32;
}

wide! {
    fn distances<S: Closed>(shape: &S, bundle: &Bundle, found: &mut Row) {
        for lane in 0..RAYS {
            found.0[lane] = shape.distance(&bundle.ray(lane), bundle.t_max.0[lane]);
        }
    }
}

/// [`Traced::closest_of`] for all rays together.
pub(super) fn shorten<S: Closed>(shape: &S, bundle: &mut Bundle) -> u16 {
    let mut found = Row::ZERO;
    distances(shape, bundle, &mut found);
    let mut hits = 0;
    for (lane, (t_max, t)) in bundle.t_max.0.iter_mut().zip(found.0).enumerate() {
        hits |= u16::from(t < *t_max) << lane;
        *t_max = t_max.min(t);
    }
    hits
}

/// The surface at an intersection. Triangles are interpolated for all rays of a bundle together.
pub(super) enum Surface {
    /// On a triangle.
    Triangle(Place),
    /// On a shape without triangles.
    Smooth(Hit),
}

impl Surface {
    /// The surface as seen from the unit vector `viewer`.
    pub(super) fn hit(&self, viewer: Vec3) -> Hit {
        match self {
            Self::Triangle(place) => place.surface(viewer),
            Self::Smooth(hit) => *hit,
        }
    }
}
