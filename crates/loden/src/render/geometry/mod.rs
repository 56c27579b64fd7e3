//! Surfaces other than triangles, cut into triangles: quadrics, polygons, patches, subdivision surfaces.
//!
//! All are in the coordinates of an object; positions on a curved surface, its normals and tangents are exact, between
//! them they are interpolated. The outside is where dP/du x dP/dv points, and from where a polygon's corners count
//! counter-clockwise.

mod patch;
mod polygon;
mod quadric;
mod subdivision;

pub use patch::{Basis, Patch, bicubic_mesh, bilinear_mesh};
pub use polygon::polygons;
pub use quadric::Quadric;
pub use subdivision::{Control, Crease, subdivide};

use glam::{Vec2, Vec3, Vec4};

use super::MeshData;

/// A point of a parametric surface.
#[derive(Debug, Clone, Copy)]
struct At {
    position: Vec3,
    /// dP/du.
    along_u: Vec3,
    /// dP/dv.
    along_v: Vec3,
    /// Texture coordinate.
    uv: Vec2,
}

/// Adds a grid of `steps` quadrilaterals over the unit square of parameters.
fn tessellate(data: &mut MeshData, steps: [usize; 2], surface: impl Fn(f32, f32) -> At) {
    let first = data.positions.len() as u32;
    for (i, j) in (0..=steps[1]).flat_map(|j| (0..=steps[0]).map(move |i| (i, j))) {
        let (u, v) = (i as f32 / steps[0] as f32, j as f32 / steps[1] as f32);
        let at = surface(u, v);
        let (normal, tangent) = frame(&at).unwrap_or_else(|| {
            // a pole or a corner drawn together: as it is just beside it
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

/// Unit normal and tangent; none where the surface is drawn together.
fn frame(at: &At) -> Option<(Vec3, Vec3)> {
    let (u, v) = (at.along_u.try_normalize()?, at.along_v.try_normalize()?);
    let normal = u.cross(v);
    (normal.length_squared() > 1e-8).then(|| (normal.normalize(), u))
}

/// Turns a mesh inside out.
pub fn reverse(data: &mut MeshData) {
    data.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    data.normals.iter_mut().for_each(|n| *n = -*n);
    // the handedness counts from the normal
    data.tangents.iter_mut().for_each(|t| *t *= Vec4::new(1.0, 1.0, 1.0, -1.0));
}
