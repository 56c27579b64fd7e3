//! Discs.

use glam::{Vec2, Vec3};

use crate::render::bounds::Ball;
use crate::render::bvh::{Bundle, Intersection, Triangles};
use crate::render::hit::{Hit, offset};
use crate::render::ray::Ray;
use crate::render::traced::{Closed, Surface, Traced, shorten};

/// A horizontal disc that faces up; texture coordinates are x and -z in units of its radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Centre.
    pub centre: Vec3,
    /// Radius.
    pub radius: f32,
}

impl Disc {
    #[inline]
    fn hit(&self, position: Vec3, viewer: Vec3) -> Hit {
        let position = Vec3::new(position.x, self.centre.y, position.z);
        let p = (position - self.centre) / self.radius;
        let geometric = if viewer.y < 0.0 { -Vec3::Y } else { Vec3::Y };
        Hit {
            position,
            origin: offset(position, geometric, position.abs()),
            geometric,
            normal: Vec3::Y,
            tangent: Vec3::X,
            handedness: 1.0,
            uv: Vec2::new(p.x, -p.z),
        }
    }
}

impl Closed for Disc {
    #[inline(always)]
    fn distance(&self, ray: &Ray, t_max: f32) -> f32 {
        let t = (self.centre.y - ray.origin.y) / ray.direction.y;
        let p = ray.origin + ray.direction * t - self.centre;
        let within = t > 0.0 && t < t_max && p.x * p.x + p.z * p.z <= self.radius * self.radius;
        if within { t } else { f32::INFINITY }
    }
}

impl Traced for Disc {
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
        let reach = Vec3::new(self.radius, 0.0, self.radius);
        [self.centre - reach, self.centre + reach]
    }

    fn bounds(&self) -> Ball {
        Ball { centre: self.centre, radius: self.radius }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_end_at_their_radius() {
        let disc = Disc { centre: Vec3::new(0.0, -1.0, 0.0), radius: 2.0 };
        let ray = |x: f32| Ray { origin: Vec3::new(x, 1.0, 0.0), direction: -Vec3::Y };
        assert_eq!(disc.distance(&ray(1.9), f32::INFINITY), 2.0);
        assert_eq!(disc.distance(&ray(2.1), f32::INFINITY), f32::INFINITY);
        assert_eq!(disc.distance(&Ray { origin: Vec3::ZERO, direction: Vec3::X }, f32::INFINITY), f32::INFINITY);
    }
}
