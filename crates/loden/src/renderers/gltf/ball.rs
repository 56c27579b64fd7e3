//! The ball of the test scene as triangles, with texture coordinates as those of our own.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3, Vec4};
use serde_json::{Value, json};

use super::glb::Glb;
use crate::direction::from_angles;
use crate::renderers::scene::REPEATS;

/// Segments around the axis; from pole to pole there are half as many.
const AROUND: usize = 96;

/// A primitive of the first material, with positions, normals, tangents, texture coordinates and indices in `glb`.
pub(super) fn primitive(glb: &mut Glb) -> Value {
    let (columns, rows) = (AROUND, AROUND / 2);
    let (mut normals, mut tangents, mut uvs): (Vec<Vec3>, Vec<Vec4>, Vec<Vec2>) = Default::default();
    for (row, column) in (0..=rows).flat_map(|row| (0..=columns).map(move |column| (row, column))) {
        let (down, turn) = (row as f32 / rows as f32, column as f32 / columns as f32);
        normals.push(from_angles(PI * down, TAU * turn).normalize());
        // where u grows; the bitangent points where v of the picture shrinks, upwards
        let (sin, cos) = (TAU * turn).sin_cos();
        tangents.push(Vec4::new(-sin, cos, 0.0, 1.0));
        // pictures begin at the top left
        uvs.push(Vec2::new(2.0 * turn, down) * REPEATS);
    }
    let vertex = |row: usize, column: usize| (row * (columns + 1) + column) as u16;
    let quads = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
    let indices: Vec<u16> = quads
        .flat_map(|(row, column)| {
            let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(y, x)| vertex(row + y, column + x));
            // at the poles one of the two triangles has no area
            let upper = (row > 0).then_some([a, c, d]);
            (row + 1 < rows).then_some([a, b, c]).into_iter().chain(upper).flatten().collect::<Vec<_>>()
        })
        .collect();
    let count = normals.len();
    let vectors = |glb: &mut Glb, bytes: &[u8], kind: &str, range: Option<f32>| {
        let range = range.map(|r| json!({ "min": [-r, -r, -r], "max": [r, r, r] }));
        glb.accessor(bytes, kind, 5126, count, range)
    };
    let flat: Vec<f32> = normals.iter().flat_map(Vec3::to_array).collect();
    let position = vectors(glb, bytemuck::cast_slice(&flat), "VEC3", Some(1.0));
    let normal = vectors(glb, bytemuck::cast_slice(&flat), "VEC3", None);
    let flat: Vec<f32> = tangents.iter().flat_map(Vec4::to_array).collect();
    let tangent = vectors(glb, bytemuck::cast_slice(&flat), "VEC4", None);
    let flat: Vec<f32> = uvs.iter().flat_map(Vec2::to_array).collect();
    let uv = vectors(glb, bytemuck::cast_slice(&flat), "VEC2", None);
    let triangles = glb.accessor(bytemuck::cast_slice(&indices), "SCALAR", 5123, indices.len(), None);
    json!({
        "attributes": { "POSITION": position, "NORMAL": normal, "TANGENT": tangent, "TEXCOORD_0": uv },
        "indices": triangles,
        "material": 0,
    })
}
