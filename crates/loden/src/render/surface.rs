//! The surface where rays meet it.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

use super::bvh::{Bundle, RAYS, lanes};
use super::scene::Scene;
use super::shape::Meeting;
use super::texture::{Mapping, Shading, TextureTransform};
use super::tracer::Met;
use crate::simd::many::Many;

/// The surface where a ray met it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Hit {
    /// On the surface.
    pub position: Vec3,
    /// Where rays that leave start from, before the offset against rounding.
    pub lifted: Vec3,
    /// Unit normal of the surface itself, on the viewer's side.
    pub geometric: Vec3,
    /// Unit shading normal, outwards.
    pub normal: Vec3,
    /// Along dP/du, of any length.
    pub tangent: Vec3,
    /// 1 if dP/dv is on the side of normal x tangent, else -1.
    pub handedness: f32,
    /// Texture coordinate.
    pub uv: Vec2,
}

/// A corner of a triangle: all in one place, because a hit needs all of it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Corner {
    /// Where it is.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Unit dP/du.
    pub tangent: Vec3,
    /// The sign that makes `handedness * normal x tangent` point along dP/dv.
    pub handedness: f32,
    /// Texture coordinate.
    pub uv: Vec2,
}

/// A place on a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Place {
    /// Of the triangle.
    pub corners: [Corner; 3],
    /// Barycentric weights of the second and the third corner.
    pub weights: Vec2,
}

impl Place {
    /// The surface there, from the unit vector `viewer`. Rays that leave start where the smooth surface would be, so that
    /// a coarse mesh does not shadow itself where its normals say that it is lit.
    ///
    /// # References
    /// hanika2021
    #[inline(always)]
    pub(super) fn surface(&self, viewer: Vec3) -> Hit {
        let ([a, b, c], [wb, wc]) = (&self.corners, self.weights.to_array());
        let wa = 1.0 - wb - wc;
        let position = a.position * wa + b.position * wb + c.position * wc;
        let geometric = (b.position - a.position).cross(c.position - a.position).normalize_or(Vec3::Y);
        let side = if geometric.dot(viewer) < 0.0 { -1.0 } else { 1.0 };
        let lift = |at: &Corner| at.normal * (side * (position - at.position).dot(at.normal)).min(0.0);
        let lifted = position - side * (lift(a) * wa + lift(b) * wb + lift(c) * wc);
        let normal = a.normal * wa + b.normal * wb + c.normal * wc;
        Hit {
            position,
            lifted,
            geometric: geometric * side,
            normal: normal.normalize_or(geometric),
            tangent: a.tangent * wa + b.tangent * wb + c.tangent * wc,
            handedness: 1.0f32.copysign(a.handedness * wa + b.handedness * wb + c.handedness * wc),
            uv: a.uv * wa + b.uv * wb + c.uv * wc,
        }
    }
}

/// The surfaces where the rays of a bundle met bodies.
pub(super) struct Surfaces {
    places: Many<Place, 38>,
    /// With the texture coordinates of the mapping.
    pub hits: Many<Hit, 18>,
    transforms: Many<TextureTransform, 3>,
    /// Before they are wrapped.
    pub shadings: Many<Shading, 17>,
}

impl Surfaces {
    pub(super) fn new() -> Self {
        Self { places: Many::ZERO, hits: Many::ZERO, transforms: Many::ZERO, shadings: Many::ZERO }
    }

    /// Finds those of some `lanes`. `random` gives a number in [0, 1) for a lane.
    #[inline(always)]
    pub(super) fn find(
        &mut self,
        scene: &Scene,
        bundle: &Bundle,
        met: &Met,
        bodies: u16,
        mut random: impl FnMut(usize) -> f32,
    ) {
        let Self { places, hits, transforms, shadings } = self;
        for lane in lanes(bodies) {
            let Some(body) = met.body(scene, lane) else { continue };
            transforms.set(lane, body.texture.transform());
            if let Meeting::Triangle(hit) = met.meeting(&body.shape, bundle, lane) {
                places.set(lane, body.shape.place(&hit));
            }
        }
        for lane in 0..RAYS {
            hits.set(lane, places.get(lane).surface(-bundle.ray(lane).direction));
        }
        for lane in lanes(bodies) {
            let Some(body) = met.body(scene, lane) else { continue };
            if let meeting @ Meeting::At(_) = met.meeting(&body.shape, bundle, lane) {
                hits.set(lane, body.shape.surface(&bundle.ray(lane), &meeting));
            }
            if body.texture.mapping != Mapping::Surface {
                hits.set(lane, body.texture.mapped(&hits.get(lane), || random(lane)));
            }
        }
        for lane in 0..RAYS {
            shadings.set(lane, transforms.get(lane).shading(&hits.get(lane), -bundle.ray(lane).direction));
        }
    }
}
