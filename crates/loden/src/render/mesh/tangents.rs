//! Vertex tangents by MikkTSpace.

use std::collections::HashMap;

use bevy_mikktspace::{Geometry, StdOps, TangentSpace, generate_tangents};
use glam::{Vec3, Vec4};

use super::MeshData;
use crate::direction::Frame;

/// Computes a tangent for every vertex from positions, normals and texture coordinates.
///
/// # Model
/// MikkTSpace, the standard that other programs bake and render with. Corners with the same position, normal, texture
/// coordinates and handedness share a tangent, weighted by angle. A vertex whose corners get different tangents, as on
/// the seam of a mirrored texture, is split.
///
/// # Limits
/// A vertex with degenerate texture coordinates gets an arbitrary tangent perpendicular to its normal.
///
/// # References
/// mikkelsen2008
pub(super) fn generate(data: &mut MeshData) {
    let mut corners = Corners { data, tangents: vec![None; 3 * data.triangles.len()] };
    // Fails only if there are no triangles.
    let generated = generate_tangents::<_, StdOps>(&mut corners);
    let tangents = if generated.is_ok() { corners.tangents } else { Vec::new() };
    let any = |normal: Vec3| Frame::from_normal_tangent(normal.normalize_or(Vec3::Y), Vec3::ZERO).tangent.extend(1.0);
    let mut of_vertex: Vec<Option<Vec4>> = vec![None; data.positions.len()];
    let mut split: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    for (corner, tangent) in tangents.into_iter().enumerate() {
        let index = &mut data.triangles[corner / 3][corner % 3];
        let vertex = *index as usize;
        let tangent = tangent.unwrap_or_else(|| of_vertex[vertex].unwrap_or_else(|| any(data.normals[vertex])));
        if *of_vertex[vertex].get_or_insert(tangent) != tangent {
            *index = *split.entry((*index, tangent.to_array().map(f32::to_bits))).or_insert_with(|| {
                data.positions.push(data.positions[vertex]);
                data.normals.push(data.normals[vertex]);
                data.uvs.push(data.uvs[vertex]);
                of_vertex.push(Some(tangent));
                (data.positions.len() - 1) as u32
            });
        }
    }
    data.tangents = of_vertex.iter().zip(&data.normals).map(|(t, &n)| t.unwrap_or_else(|| any(n))).collect();
}

/// The interface of a mesh to MikkTSpace: it reads corners and receives their tangents.
struct Corners<'a> {
    data: &'a MeshData,
    tangents: Vec<Option<Vec4>>,
}

impl Corners<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.data.triangles[face][corner] as usize
    }
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.data.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.data.positions[self.vertex(face, corner)].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.data.normals[self.vertex(face, corner)].normalize_or(Vec3::Y).to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        self.data.uvs[self.vertex(face, corner)].to_array()
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, corner: usize) {
        self.tangents[3 * face + corner] = tangent.map(|found| Vec4::from_array(found.tangent_encoded()));
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};

    use super::*;

    /// A strip of two squares; the texture of the second continues that of the first or mirrors it.
    fn strip(mirrored: bool) -> MeshData {
        let at = |i: usize| Vec3::new((i / 2) as f32, (i % 2) as f32, 0.0);
        let u = |i: usize| if mirrored && i >= 4 { 0.0 } else { (i / 2) as f32 };
        let mut data = MeshData {
            positions: (0..6).map(at).collect(),
            normals: vec![Vec3::Z; 6],
            tangents: Vec::new(),
            uvs: (0..6).map(|i| Vec2::new(u(i), (i % 2) as f32)).collect(),
            triangles: vec![[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]],
        };
        generate(&mut data);
        data
    }

    #[test]
    fn a_mirrored_texture_splits_the_vertices_of_its_seam() {
        let data = strip(true);
        assert_eq!((data.positions.len(), data.uvs.len(), data.tangents.len()), (8, 8, 8));
        for (face, triangle) in data.triangles.iter().enumerate() {
            let expected = if face < 2 { Vec4::new(1.0, 0.0, 0.0, 1.0) } else { Vec4::new(-1.0, 0.0, 0.0, -1.0) };
            for &i in triangle {
                assert!(
                    (data.tangents[i as usize] - expected).length() < 1e-6,
                    "{face}: {}",
                    data.tangents[i as usize]
                );
            }
        }
        assert_eq!(data.positions[6..], data.positions[2..4], "the two vertices of the seam");
    }

    #[test]
    fn a_continuous_texture_splits_no_vertices() {
        let data = strip(false);
        assert_eq!(data.positions.len(), 6);
        assert!(data.tangents.iter().all(|t| (*t - Vec4::new(1.0, 0.0, 0.0, 1.0)).length() < 1e-6));
    }

    #[test]
    fn a_texture_without_extent_still_has_tangents() {
        let mut data = strip(false);
        data.tangents.clear();
        data.uvs.fill(Vec2::ZERO);
        generate(&mut data);
        assert_eq!(data.tangents.len(), data.positions.len());
        let square = |t: &Vec4| t.is_finite() && (t.truncate().length() - 1.0).abs() < 1e-5 && t.z.abs() < 1e-5;
        assert!(data.tangents.iter().all(square), "{:?}", data.tangents);
    }

    #[test]
    fn a_turned_texture_turns_the_tangents() {
        let mut data = strip(false);
        data.tangents.clear();
        let turn = Vec2::from_angle(0.3);
        data.uvs.iter_mut().for_each(|uv| *uv = turn.rotate(*uv));
        generate(&mut data);
        // u increases in the direction of x rotated by the opposite angle.
        let expected = Vec3::new(turn.x, -turn.y, 0.0);
        assert!(data.tangents.iter().all(|t| (t.truncate() - expected).length() < 1e-5), "{:?}", data.tangents);
    }
}
