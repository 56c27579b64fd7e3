//! Surface points hit by rays.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

/// A surface point hit by a ray.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Hit {
    /// Position.
    pub position: Vec3,
    /// Origin of the rays that leave on the viewer's side.
    pub origin: Vec3,
    /// Unit normal of the surface itself, on the viewer's side.
    pub geometric: Vec3,
    /// Unit shading normal, outwards.
    pub normal: Vec3,
    /// Vector along dP/du, of any length.
    pub tangent: Vec3,
    /// 1 if dP/dv is on the side of normal x tangent, else -1.
    pub handedness: f32,
    /// Texture coordinate.
    pub uv: Vec2,
}

/// Offset of the origins of rays from the surface, relative to the coordinates that the surface is computed from.
/// Coordinates and the planes of triangles are accurate to about a tenth of it.
const OFFSET: f32 = 32.0 * f32::EPSILON;

/// Minimum of the offset, relative to that along an axis where coordinates are largest.
const LEAST_OFFSET: f32 = 1.0 / 64.0;

/// Moves a point off a surface along its unit normal, far enough that rounding cannot put a ray's origin behind the
/// surface. `reach` holds the largest coordinates that the point is computed from; along the normal, only their
/// components in its direction count, so a wide floor at height 0 has a small offset.
///
/// # References
/// waechter2019, whose offset depends on the coordinates of the point alone
#[inline(always)]
pub(super) fn offset(point: Vec3, normal: Vec3, reach: Vec3) -> Vec3 {
    let along = normal.abs().dot(reach).max(LEAST_OFFSET * reach.max_element());
    point + normal * (OFFSET * along)
}

/// Minimum cosine between a corner's normal and the triangle's for the corner to lift the origins of rays.
const LIFTING: f32 = 0.5;

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
    /// Index of the triangle.
    pub corners: [Corner; 3],
    /// Barycentric weights of the second and the third corner.
    pub weights: Vec2,
    /// The largest coordinates that the corners are computed from, in world units.
    pub reach: Vec3,
}

impl Place {
    /// The surface at this point, seen from the unit vector `viewer`. Rays that leave start where the smooth surface
    /// would be, so that a coarse mesh does not shadow itself where its normals say that it is lit.
    ///
    /// # Model
    /// Each corner's normal is turned to the viewer's side of the triangle; the winding plays no role. The point is
    /// projected onto each corner's tangent plane if it lies below, and the projections are interpolated. A corner
    /// whose normal is more than 60 degrees from the triangle's is ignored, since its tangent plane says nothing
    /// about the surface here. The lift therefore points to the viewer's side and is shorter than the longest edge.
    ///
    /// # References
    /// hanika2021; we add the sides and the limit
    #[inline(always)]
    pub(super) fn surface(&self, viewer: Vec3) -> Hit {
        let ([a, b, c], [wb, wc]) = (&self.corners, self.weights.to_array());
        let wa = 1.0 - wb - wc;
        let position = a.position * wa + b.position * wb + c.position * wc;
        let (ab, ac) = (b.position - a.position, c.position - a.position);
        // Divide by the size, rounded to a power of two: the squared area of a tiny triangle is too small for single
        // precision.
        let size = f32::from_bits(ab.abs().max(ac.abs()).max_element().to_bits() & 0x7f80_0000);
        let normal = (ab / size).cross(ac / size).normalize_or(Vec3::Y);
        let geometric = if normal.dot(viewer) < 0.0 { -normal } else { normal };
        let lift = |corner: &Corner, weight: f32| {
            let cosine = corner.normal.dot(geometric);
            let side = 1.0f32.copysign(cosine);
            let depth = (side * (corner.position - position).dot(corner.normal)).max(0.0);
            let depth = if cosine.abs() < LIFTING { 0.0 } else { depth };
            corner.normal * (side * depth * weight)
        };
        let lifted = position + lift(a, wa) + lift(b, wb) + lift(c, wc);
        let shading = a.normal * wa + b.normal * wb + c.normal * wc;
        Hit {
            position,
            origin: offset(lifted, geometric, self.reach),
            geometric,
            normal: shading.normalize_or(normal),
            tangent: a.tangent * wa + b.tangent * wb + c.tangent * wc,
            handedness: 1.0f32.copysign(a.handedness * wa + b.handedness * wb + c.handedness * wc),
            uv: a.uv * wa + b.uv * wb + c.uv * wc,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vec3> {
        [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0].prop_map(Vec3::from)
    }

    fn corner() -> impl Strategy<Value = Corner> {
        (vector(), vector()).prop_map(|(position, normal)| Corner {
            position,
            normal: normal.normalize_or(Vec3::Y),
            tangent: Vec3::X,
            handedness: 1.0,
            uv: Vec2::ZERO,
        })
    }

    proptest! {
        #[test]
        fn rays_start_near_and_on_the_side_of_the_viewer(
            corners in [corner(), corner(), corner()], weights in [0.0f32..0.5, 0.0f32..0.5], viewer in vector(),
            exponent in -8i32..7,
        ) {
            let scale = 10f32.powi(exponent);
            let corners = corners.map(|c| Corner { position: c.position * scale, ..c });
            let edges = [[0, 1], [1, 2], [2, 0]].map(|[i, j]: [usize; 2]| corners[i].position - corners[j].position);
            let longest = edges.map(Vec3::length).into_iter().fold(0.0, f32::max);
            prop_assume!((edges[0] / scale).cross(edges[1] / scale).length() > 0.05);
            let hit = Place { corners, weights: weights.into(), reach: Vec3::splat(scale) }.surface(viewer.normalize_or(Vec3::Y));
            let lift = hit.origin - hit.position;
            prop_assert!(hit.geometric.dot(viewer) >= 0.0);
            prop_assert!(lift.dot(hit.geometric) > 0.0, "{lift}");
            prop_assert!(lift.length() < longest, "{lift}");
        }

        #[test]
        fn neither_winding_nor_the_sense_of_normals_matters(
            corners in [corner(), corner(), corner()], weights in [0.0f32..0.5, 0.0f32..0.5], viewer in vector(),
        ) {
            let at = |[a, b, c]: [Corner; 3], [wb, wc]: [f32; 2]| {
                Place { corners: [a, b, c], weights: Vec2::new(wb, wc), reach: Vec3::ONE }.surface(viewer).origin
            };
            let ([a, b, c], [wb, wc]) = (corners, weights);
            let turned = corners.map(|c| Corner { normal: -c.normal, ..c });
            let expected = at(corners, weights);
            prop_assert!((at([a, c, b], [wc, wb]) - expected).length() < 1e-5);
            prop_assert!((at(turned, weights) - expected).length() < 1e-5);
        }
    }

    #[test]
    fn wide_floors_have_small_offsets() {
        let corner = |x: f32, z: f32| Corner {
            position: Vec3::new(x, 0.3, z),
            normal: Vec3::Y,
            tangent: Vec3::X,
            handedness: 1.0,
            uv: Vec2::ZERO,
        };
        let corners = [corner(-1e5, -1e5), corner(1e5, -1e5), corner(0.0, 1e5)];
        let hit = Place { corners, weights: Vec2::splat(0.3), reach: Vec3::new(1e5, 0.3, 1e5) }.surface(Vec3::Y);
        let lift = hit.origin.y - hit.position.y;
        assert!(lift > 0.0 && lift < 0.01, "{lift}");
    }
}
