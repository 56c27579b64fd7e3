//! Surface points hit by rays.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

/// A surface point hit by a ray.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Hit {
    /// On the surface.
    pub position: Vec3,
    /// Origin of the rays that leave, before the offset against rounding.
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

/// A corner of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Corner {
    /// Position, world coordinates.
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

/// A point on a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Place {
    /// Of the triangle.
    pub corners: [Corner; 3],
    /// Barycentric weights of the second and the third corner.
    pub weights: Vec2,
}

impl Place {
    /// The surface there, from the unit vector `viewer`. Rays that leave start where the smooth surface would be, so
    /// that a coarse mesh does not shadow itself where its normals say that it is lit.
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
