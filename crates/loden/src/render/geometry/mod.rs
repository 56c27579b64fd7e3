//! Surfaces by their parameters: quadrics, and tessellations of polygons, patches and subdivision surfaces.
//!
//! All are in object coordinates. Vertices lie exactly on the surface, with exact normals and tangents, except for
//! subdivision surfaces. The outside is the side of dP/du x dP/dv, or the side from which the corners of a polygon run
//! counter-clockwise.

mod implicit;
mod nurbs;
mod patch;
mod polygon;
mod quadric;
mod subdivision;

pub use implicit::{Instruction, implicit_mesh};
pub use nurbs::{NurbsAxis, nurbs_mesh};
pub use patch::{Basis, Patch, bicubic_mesh, bilinear_mesh};
pub use polygon::polygons;
pub(super) use quadric::Outline;
pub use quadric::Quadric;
pub use subdivision::{ControlMesh, Crease, max_levels, subdivide};

use glam::{Vec2, Vec3, Vec4};

use super::MeshData;

/// A point on a parametric surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfacePoint {
    pub position: Vec3,
    /// dP/du, of any length.
    pub dpdu: Vec3,
    /// dP/dv, of any length.
    pub dpdv: Vec3,
    /// Texture coordinate.
    pub uv: Vec2,
}

/// Appends a grid of `steps` quadrilaterals over the unit square of parameters.
fn tessellate(data: &mut MeshData, steps: [usize; 2], surface: impl Fn(f32, f32) -> SurfacePoint) {
    let first = data.positions.len() as u32;
    for (i, j) in (0..=steps[1]).flat_map(|j| (0..=steps[0]).map(move |i| (i, j))) {
        let (u, v) = (i as f32 / steps[0] as f32, j as f32 / steps[1] as f32);
        let at = surface(u, v);
        let (normal, tangent) = frame(&at).unwrap_or_else(|| {
            // At a pole or a collapsed edge, use the frame of a point nearby.
            let inwards = |x: f32| x + 1e-3 * (0.5 - x);
            frame(&surface(inwards(u), inwards(v))).unwrap_or((Vec3::Z, Vec3::X))
        });
        data.positions.push(at.position);
        data.normals.push(normal);
        data.tangents.push(tangent.extend(1.0));
        data.uvs.push(at.uv);
    }
    let at = |i: usize, j: usize| first + (j * (steps[0] + 1) + i) as u32;
    for (i, j) in (0..steps[1]).flat_map(|j| (0..steps[0]).map(move |i| (i, j))) {
        for triangle in [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]] {
            let [a, b, c] = triangle.map(|k| data.positions[k as usize]);
            if (b - a).cross(c - a) != Vec3::ZERO {
                data.triangles.push(triangle);
            }
        }
    }
}

/// Unit normal and tangent; `None` where the surface is degenerate.
fn frame(at: &SurfacePoint) -> Option<(Vec3, Vec3)> {
    let (u, v) = (at.dpdu.try_normalize()?, at.dpdv.try_normalize()?);
    let normal = u.cross(v);
    (normal.length_squared() > 1e-8).then(|| (normal.normalize(), u))
}

/// Turns a mesh inside out.
pub(crate) fn reverse(data: &mut MeshData) {
    data.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    data.normals.iter_mut().for_each(|n| *n = -*n);
    // The handedness is relative to the normal.
    data.tangents.iter_mut().for_each(|t| *t *= Vec4::new(1.0, 1.0, 1.0, -1.0));
}
